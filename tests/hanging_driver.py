"""A driver of a robot whose right foot hangs free, with offsets in its ankle sensors.

python tests/hanging_driver.py ENDPOINTS ROBOT
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from surefoot.robot_io.robot import load_robot
from surefoot.robot_io.robot_side.driver import drive
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.stabilizer.model import GRAVITY, RobotModel

OFFSET = [3.0, -4.0, 30.0, 0.5, 1.0, -0.2]
STANDING_N = 600.0


class HangingRobot:
    """A robot at rest in the nominal posture that stands on its left foot."""

    def __init__(self, model: RobotModel) -> None:
        """Compute the sensors' readings."""
        from tests.stabilizer.standing_snapshot import airborne_snapshot

        reading = airborne_snapshot(model)
        plate = model.plates[1]
        weight = np.array([0.0, 0.0, -plate.mass * GRAVITY])
        hanging = np.concatenate((weight, np.cross(plate.com, weight)))
        left = np.array([0.0, 0.0, STANDING_N, 0.0, 0.0, 0.0])
        self._reading = replace(reading, ft_left=left, ft_right=hanging + OFFSET)

    def read(self, tick: int, stamp_ns: int) -> Snapshot:
        """Return the readings, with the present stamp."""
        return replace(self._reading, tick=tick, stamp_ns=stamp_ns)

    def write(self, q_command: Array) -> None:
        """Ignore the command."""


if __name__ == "__main__":
    robot = load_robot(sys.argv[2])
    drive(HangingRobot(RobotModel(robot)), robot, sys.argv[1])
