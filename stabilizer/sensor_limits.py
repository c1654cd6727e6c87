"""How far a tick's numbers are from their limits: range, and change in one tick."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.linalg.blas import idamax

from robot_io.robot import Robot
from robot_io.snapshot import Snapshot
from schemas.arrays import Array
from schemas.settings import SafetySettings

ATTITUDE_NORM: Final = (0.9, 1.1)
"""Square of an attitude's norm; beyond it, it is no attitude."""
SPEED_SHARE: Final = 5.0
"""No joint can turn at so many times its velocity limit, whatever its encoder says."""


class SensorLimits:
    """Holds one tick's numbers against limits, all at once.

    In a row: joint positions and velocities; rate of turn and specific force; force and
    moment of the left and of the right ankle.
    """

    def __init__(self, robot: Robot, settings: SafetySettings) -> None:
        """Lays out the row.

        Args:
            robot: ranges and velocity limits of its joints.
            settings: limits.
        """
        n_a, force = robot.n_a, (settings.force_range_n, settings.moment_range_nm)
        half = 0.5 * (robot.upper - robot.lower) + settings.joint_margin_rad
        imu_range = (settings.gyro_range_rad_s, settings.accel_range_m_s2)
        imu_jump = (settings.gyro_jump_rad_s, settings.accel_jump_m_s2)
        jump = (settings.force_jump_n, settings.moment_jump_nm)
        speeds = SPEED_SHARE * robot.velocity_limit
        others = np.repeat((*imu_range, *force, *force), 3)
        ranges = np.concatenate((half, speeds, others))
        joint_jumps = np.repeat((settings.joint_jump_rad, np.inf), n_a)
        jumps = np.concatenate((joint_jumps, np.repeat((*imu_jump, *jump, *jump), 3)))
        middle = 0.5 * (robot.upper + robot.lower)
        self._middle = np.concatenate((middle, np.zeros(ranges.size - n_a)))
        self._per_range, self._per_jump = 1.0 / ranges, 1.0 / jumps
        n_j = 2 * n_a
        edges = (0, n_j, n_j + 6, n_j + 12, n_j + 18)
        self._rows = tuple(map(slice, edges[:-1], edges[1:]))
        self._now, self._last = np.zeros(ranges.size), np.zeros(ranges.size)
        self._place, self._change = np.zeros(ranges.size), np.zeros(ranges.size)
        self._is_attitude = True
        self._joints, self._speeds = self._now[:n_a], self._now[n_a:n_j]
        self._gyro, self._accel = self._now[n_j:][:3], self._now[n_j:][3:6]
        self._left, self._right = self._now[n_j:][6:12], self._now[n_j:][12:]

    def measure(self, snapshot: Snapshot) -> bool:
        """Takes a tick's numbers; believes nothing yet.

        Returns:
            Whether every number is within its range and near its last believed value.
        """
        self._fill(snapshot)
        place, change, now = self._place, self._change, self._now
        np.subtract(now, self._middle, out=place)
        np.multiply(place, self._per_range, out=place)
        np.subtract(now, self._last, out=change)
        np.multiply(change, self._per_jump, out=change)
        quat = snapshot.quat_xyzw
        self._is_attitude = bool(ATTITUDE_NORM[0] < quat.dot(quat) < ATTITUDE_NORM[1])
        # A number that is none would hide from the search for the largest.
        return bool(
            self._is_attitude
            and place.dot(place) < np.inf
            and -1.0 <= place[idamax(place)] <= 1.0
            and -1.0 <= change[idamax(change)] <= 1.0
        )

    def believe_measured(self) -> None:
        """The numbers last measured are what the next ones are compared with."""
        np.copyto(self._last, self._now)

    def believe(self, snapshot: Snapshot) -> None:
        """A snapshot's numbers are what the next ones are compared with."""
        self._fill(snapshot)
        self.believe_measured()

    def is_beyond(self, index: int) -> bool:
        """Whether a sensor, in the order of ``TICK_SENSORS``, is beyond its range."""
        is_imu_without_attitude = index == 1 and not self._is_attitude
        return is_imu_without_attitude or _exceeds(self._place[self._rows[index]])

    def has_jumped(self, index: int) -> bool:
        """Whether a sensor changed by more than it can in one tick."""
        return _exceeds(self._change[self._rows[index]])

    def _fill(self, snapshot: Snapshot) -> None:
        self._joints[:] = snapshot.q
        self._speeds[:] = snapshot.dq
        self._gyro[:] = snapshot.angular_velocity
        self._accel[:] = snapshot.linear_acceleration
        self._left[:] = snapshot.ft_left
        self._right[:] = snapshot.ft_right


def _exceeds(shares: Array) -> bool:
    return bool(np.abs(shares).max() > 1.0)
