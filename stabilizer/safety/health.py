"""Watches each sensor alone: missing, not a number, out of range, jumping, frozen.

A reading that cannot be right is bridged with the last good one for a few
milliseconds; then the sensor is lost. Pure: the same snapshots give the same verdicts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

import numpy as np
from scipy.linalg.blas import idamax

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import SafetySettings
from surefoot.schemas.topics import TICK_SENSORS

Ages = tuple[int, int, int, int]
FRESH: Ages = (0, 0, 0, 0)
JOINTS, IMU, LEFT_FT, RIGHT_FT = range(4)
FIELDS = (
    ("q", "dq", "effort"),
    ("quat_xyzw", "angular_velocity", "linear_acceleration"),
    ("ft_left",),
    ("ft_right",),
)
"""What of a snapshot each sensor tells, in the order of ``TICK_SENSORS``."""
JUMP, OVERLOAD = "jumped", "overloaded"
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
        """Lay out the row.

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
        """Take a tick's numbers; believes nothing yet.

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


class SensorHealth:
    """Judges snapshots, and mends what is missing for a moment.

    All numbers of a tick, and their change since the last believed ones, are held
    against their limits at once; only a doubt looks at each sensor.

    Attributes:
        lost: per sensor, in the order of ``TICK_SENSORS``, why it is lost; empty for
            a sensor that is believed.
        overload_ticks: for how many ticks the left and the right foot have been
            reporting a force that lasts only if it is false.
    """

    def __init__(self, robot: Robot, settings: SafetySettings) -> None:
        """Believe everything until told otherwise.

        Args:
            robot: joint ranges and the tick's length.
            settings: limits and times.
        """
        self.lost = ["", "", "", ""]
        self.overload_ticks = (0, 0)
        self._bridge = round(settings.bridge_s / robot.period_s)
        self._frozen_after = round(settings.frozen_after_s / robot.period_s)
        self._overload_after = round(settings.overload_after_s / robot.period_s)
        self._overload = settings.overload_n**2
        self._recover = round(settings.recover_s / robot.period_s)
        self._limits = SensorLimits(robot, settings)
        self._good: Snapshot | None = None
        self._sums = (math.nan,) * 4
        self._troubled = [0] * 4
        self._repeats = [0] * 4
        self._overloaded = [0] * 4
        self._well = [0] * 4
        self._is_calm = True

    @property
    def all_believed(self) -> bool:
        """Whether no sensor is lost."""
        return not any(self.lost)

    def check(
        self, snapshot: Snapshot, ages: Ages, *, moves: Callable[[], bool]
    ) -> Snapshot:
        """Judge a tick.

        Args:
            snapshot: as it came.
            ages: ticks since each sensor's message.
            moves: asked when a sensor repeats itself: whether the command changed, so
                that readings must change, too.

        Returns:
            The same snapshot when nothing is wrong; else one with the last good
            readings in place of the bad.
        """
        limits = self._limits
        good = self._good
        if good is None:
            self._good = good = snapshot
            limits.believe(snapshot)
        dq, effort, accel = snapshot.dq, snapshot.effort, snapshot.linear_acceleration
        gyro, left, right = (
            snapshot.angular_velocity,
            snapshot.ft_left,
            snapshot.ft_right,
        )
        before = self._sums
        self._sums = sums = (
            dq.dot(dq) + effort.dot(effort),
            gyro.dot(gyro) + accel.dot(accel),
            left.dot(left),
            right.dot(right),
        )
        is_within = limits.measure(snapshot)
        is_well = (
            self._is_calm
            and is_within
            and ages == FRESH
            and sums[0] != before[0]
            and sums[1] != before[1]
            and sums[2] != before[2]
            and sums[3] != before[3]
            and math.isfinite(sums[0])
            and sums[2] <= self._overload
            and sums[3] <= self._overload
        )
        if is_well:
            limits.believe_measured()
            self._good = snapshot
            return snapshot
        return self._look_closer(snapshot, good, ages, before, moves=moves())

    def _look_closer(
        self,
        snapshot: Snapshot,
        good: Snapshot,
        ages: Ages,
        before: tuple[float, ...],
        *,
        moves: bool,
    ) -> Snapshot:
        """Judge each sensor alone."""
        changed = [
            age == 0 and now != then
            for age, now, then in zip(ages, self._sums, before, strict=True)
        ]
        mended: dict[str, Any] = {}
        for index in range(4):
            if changed[index]:
                self._repeats[index] = 0
            elif ages[index] == 0 and moves and any(changed):
                self._repeats[index] += 1
            self._count_overload(index)
            trouble = self._trouble(index, snapshot, ages[index])
            self._judge(index, trouble)
            if trouble:
                for name in FIELDS[index]:
                    mended[name] = getattr(good, name)
        self.overload_ticks = (self._overloaded[LEFT_FT], self._overloaded[RIGHT_FT])
        self._is_calm = not (
            any(self._troubled)
            or any(self._repeats)
            or any(self._overloaded)
            or any(self.lost)
        )
        self._good = replace(snapshot, **mended) if mended else snapshot
        self._limits.believe(self._good)
        return self._good

    def _count_overload(self, index: int) -> None:
        is_foot = index in (LEFT_FT, RIGHT_FT)
        if is_foot and self._sums[index] > self._overload:
            self._overloaded[index] += 1
        else:
            self._overloaded[index] = 0

    def _judge(self, index: int, trouble: str) -> None:
        """From trouble to loss and back."""
        if trouble:
            self._troubled[index] += 1
            self._well[index] = 0
            has_waited = (
                self._repeats[index] >= self._frozen_after
                or self._overloaded[index] > self._overload_after
            )
            if has_waited or self._troubled[index] > self._bridge:
                self.lost[index] = self.lost[index] or trouble
            return
        self._troubled[index] = 0
        if self.lost[index]:
            self._well[index] += 1
            if self._well[index] > self._recover:
                self.lost[index] = ""

    def _trouble(self, index: int, snapshot: Snapshot, age: int) -> str:
        """What is wrong with a sensor now; empty when nothing is."""
        name = TICK_SENSORS[index]
        if age > 0:
            return f"{name} missing"
        values = [getattr(snapshot, field) for field in FIELDS[index]]
        if not all(np.isfinite(array).all() for array in values):
            return f"{name} not a number"
        if self._limits.is_beyond(index):
            return f"{name} beyond its range"
        if self._repeats[index] >= self._frozen_after:
            return f"{name} frozen"
        if self._overloaded[index] > self._overload_after:
            return f"{name} {OVERLOAD}"
        was_jump = self.lost[index].endswith(JUMP)
        if (was_jump or not self.lost[index]) and self._limits.has_jumped(index):
            return f"{name} {JUMP}"
        return ""
