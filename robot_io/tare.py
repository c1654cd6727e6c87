"""What the ankle sensors of one robot read when nothing touches its feet.

The offsets stand in a file beside the robot file and are taken off where readings enter
the bus, by the robot's driver: stabilizer, recorder and checks see none of them. The
simulated robot has its offsets from the scenario and no such file.
"""

from __future__ import annotations

import os
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
import tomli_w

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Vec6
from surefoot.schemas.toml_file import FileStruct, convert, read_toml

Offsets = Annotated[list[float], msgspec.Meta(min_length=6, max_length=6)]


class Tare(FileStruct, frozen=True, kw_only=True):
    """Offsets of both ankle sensors, [force; moment] in the sensor's own frame."""

    left: Offsets = msgspec.field(default_factory=lambda: [0.0] * 6)
    """Left ankle [N, N m]."""
    right: Offsets = msgspec.field(default_factory=lambda: [0.0] * 6)
    """Right ankle [N, N m]."""

    @property
    def is_zero(self) -> bool:
        """Whether there is nothing to take off."""
        return not any((*self.left, *self.right))

    def plus(self, left: Vec6, right: Vec6) -> Tare:
        """Return the offsets with what a new measurement found left of them."""
        return Tare(
            left=(np.array(self.left) + left).round(4).tolist(),
            right=(np.array(self.right) + right).round(4).tolist(),
        )

    def taken_off(self, snapshot: Snapshot) -> Snapshot:
        """Return a reading without the offsets."""
        if self.is_zero:
            return snapshot
        return replace(
            snapshot,
            ft_left=snapshot.ft_left - np.array(self.left),
            ft_right=snapshot.ft_right - np.array(self.right),
        )


def tare_path(robot_path: Path) -> Path:
    """Return where the offsets of a robot file's robot stand."""
    return robot_path.with_name(f"{robot_path.stem}.tare.toml")


def load_tare(robot_path: Path) -> Tare:
    """Read the offsets beside a robot file; none when there is no such file.

    Raises:
        FileFormatError: the file is malformed.
    """
    path = tare_path(robot_path)
    if not path.exists():
        return Tare()
    return convert(read_toml(path), Tare, source=str(path))


def save_tare(robot_path: Path, tare: Tare) -> Path:
    """Write the offsets, all at once or not at all; return where.

    Raises:
        OSError: it cannot be written there.
    """
    path = tare_path(robot_path)
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".toml")
    try:
        with os.fdopen(handle, "wb") as file:
            tomli_w.dump(msgspec.to_builtins(tare), file)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    return path
