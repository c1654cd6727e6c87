"""What of a snapshot arrives, without a bus."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from robot_io.snapshot import Snapshot
from schemas.topics import TICK_SENSORS

FIELDS = {
    "joints": ("q", "dq", "effort"),
    "imu": ("quat_xyzw", "angular_velocity", "linear_acceleration"),
    "left_ankle_ft": ("ft_left",),
    "right_ankle_ft": ("ft_right",),
}
"""What of a snapshot each channel carries."""


class Delivery:
    """Joins readings as the client does: a missing one keeps its last value."""

    def __init__(self) -> None:
        """Nothing has come yet."""
        self._last: Snapshot | None = None
        self._ticks = dict.fromkeys(TICK_SENSORS, 0)

    def deliver(
        self, snapshot: Snapshot, missing: tuple[str, ...]
    ) -> tuple[Snapshot, tuple[int, int, int, int]]:
        """What the controller gets.

        Args:
            snapshot: as the robot took it.
            missing: channels whose message does not come, or cannot be read.

        Returns:
            The snapshot to use, and the age of each channel in ticks.
        """
        tick = snapshot.tick
        old: dict[str, Any] = {}
        for name in TICK_SENSORS:
            if name in missing and self._last is not None:
                old.update((f, getattr(self._last, f)) for f in FIELDS[name])
            else:
                self._ticks[name] = tick
        self._last = replace(snapshot, **old) if old else snapshot
        joints, imu, left, right = (tick - self._ticks[name] for name in TICK_SENSORS)
        return self._last, (joints, imu, left, right)
