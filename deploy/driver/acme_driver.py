"""A driver for a vendor's robot: its SDK put behind the bus. Copy it and change it.

python deploy/driver/acme_driver.py deploy/loopback.toml
surefoot check-robot --endpoints deploy/loopback.toml
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from acme_sdk import AcmeRobot

from surefoot.errors import UsageError, complain
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.robot_io.robot_side.driver import drive
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array

STANDARD_GRAVITY_M_S2 = 9.80665
# The vendor counts legs first, then arms, then the head; we: head, left, right.
LEGS_ARMS_HEAD = [*range(2, 8), *range(15, 21), *range(8, 15), *range(21, 28), 0, 1]
RIGHT = "right_"


class AcmeAdapter:
    """Turns the vendor's order, degrees, signs and g into ours, and back."""

    def __init__(self, robot: Robot) -> None:
        """Connect to the vendor's robot."""
        self._ours = np.array(LEGS_ARMS_HEAD)  # ours[i] is our index of their motor i
        names = [robot.joint_names[i] for i in self._ours]
        # Their right side counts the other way round.
        self._sign = np.array([-1.0 if n.startswith(RIGHT) else 1.0 for n in names])
        self._sdk = AcmeRobot(self._to_vendor(robot.nominal))
        self._q = robot.nominal.copy()
        self._period_s = robot.period_s

    def read(self, tick: int, stamp_ns: int) -> Snapshot:
        """Read all sensors, in SI units and in our order, frames and signs."""
        q = self._from_vendor(self._sdk.get_motor_degrees())
        dq, self._q = (q - self._q) / self._period_s, q
        imu, cells = self._sdk.get_imu(), self._sdk.get_load_cells()
        w, x, y, z = imu["quat_wxyz"]
        return Snapshot(
            tick=tick,
            stamp_ns=stamp_ns,
            q=q,
            dq=dq,
            effort=np.zeros_like(q),  # this SDK does not report it
            quat_xyzw=np.array([x, y, z, w]),
            angular_velocity=np.radians(imu["gyro_deg_s"]),
            linear_acceleration=STANDARD_GRAVITY_M_S2 * np.array(imu["accel_g"]),
            # Theirs is foot on ground in kgf, ours ground on foot in N.
            ft_left=-STANDARD_GRAVITY_M_S2 * np.array(cells["L"]),
            ft_right=-STANDARD_GRAVITY_M_S2 * np.array(cells["R"]),
        )

    def write(self, q_command: Array) -> None:
        """Send joint positions to the motors; the gate has already checked them."""
        self._sdk.set_motor_degrees(self._to_vendor(q_command))

    def _to_vendor(self, q: Array) -> list[float]:
        degrees: list[float] = np.degrees(q[self._ours] * self._sign).tolist()
        return degrees

    def _from_vendor(self, degrees: list[float]) -> Array:
        q = np.empty(len(degrees))
        q[self._ours] = np.radians(degrees) * self._sign
        return q


def main() -> None:
    """Serve the robot until Ctrl-C: endpoint file, and a robot file of your own."""
    if len(sys.argv) not in (2, 3):
        raise UsageError("usage: acme_driver.py ENDPOINTS.toml [ROBOT]")
    robot = load_robot(sys.argv[2] if len(sys.argv) > 2 else "walker")
    adapter = AcmeAdapter(robot)
    drive(adapter, robot, sys.argv[1])


if __name__ == "__main__":
    complain(main)
