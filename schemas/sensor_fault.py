"""Sensor faults a scenario may inject."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from schemas.robot_file import NonNegative, Positive
from schemas.toml_file import FileStruct

SensorName = Literal["joints", "imu", "left_ankle_ft", "right_ankle_ft"]
FaultKind = Literal["drop", "freeze", "nan", "jump", "range"]
JUMP_SIZES = {
    "joints": 0.3,
    "imu": 5.0,
    "left_ankle_ft": 2500.0,
    "right_ankle_ft": 2500.0,
}
"""Offset of a jump by sensor, where the file gives none: positions [rad], gyroscope
[rad/s], vertical force [N]."""


class SensorFault(FileStruct, frozen=True, kw_only=True):
    """One sensor fails for a while.

    ``drop``: its messages are not sent. ``freeze``: it repeats its last reading.
    ``nan``: it reports no numbers. ``jump``: an offset appears at once. ``range``: it
    reports a value that it cannot have measured.
    """

    sensor: SensorName
    """Which one fails."""
    kind: FaultKind
    """How it fails, see above."""
    start_s: NonNegative
    """When it begins."""
    duration_s: Annotated[float, msgspec.Meta(gt=0.0, le=3600.0)]
    """How long it lasts."""
    size: Positive | None = None
    """Of a jump, in the sensor's unit; see JUMP_SIZES."""

    def __post_init__(self) -> None:
        """Checks that only a jump has a size."""
        if self.size is not None and self.kind != "jump":
            raise ValueError(f"kind {self.kind!r} takes no `size`; only `jump` does")

    @property
    def offset(self) -> float:
        """Offset of a jump."""
        return JUMP_SIZES[self.sensor] if self.size is None else self.size
