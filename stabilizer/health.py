"""Watches each sensor alone: missing, not a number, out of range, jumping, frozen.

A reading that cannot be right is bridged with the last good one for a few
milliseconds; then the sensor is lost. Pure: the same snapshots give the same verdicts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg.blas import idamax

from robot_io.robot import Robot
from robot_io.snapshot import Snapshot
from schemas.arrays import Array
from schemas.settings import SafetySettings
from schemas.topics import TICK_SENSORS

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
MS_PER_S = 1e3
JUMP = "jumped"


class SensorHealth:
    """Judges snapshots, and mends what is missing for a moment.

    A tick in which all is well takes one pass of sums of squares; only a doubt looks
    closer.

    Attributes:
        lost: per sensor, in the order of ``TICK_SENSORS``, why it is lost; empty for
            a sensor that is believed.
    """

    def __init__(self, robot: Robot, settings: SafetySettings) -> None:
        """Believes everything until told otherwise.

        Args:
            robot: joint ranges and the tick's length.
            settings: limits and times.
        """
        self.lost = ["", "", "", ""]
        self._period_s = robot.period_s
        self._bridge = round(settings.bridge_s / robot.period_s)
        self._frozen_after = round(settings.frozen_after_s / robot.period_s)
        self._recover = round(settings.recover_s / robot.period_s)
        margin = settings.joint_margin_rad
        self._middle = 0.5 * (robot.upper + robot.lower)
        self._per_half = 1.0 / (0.5 * (robot.upper - robot.lower) + margin)
        self._range_force = settings.force_range_n
        self._range_moment = settings.moment_range_nm
        # Of both parts together: what the quick pass asks.
        self._quick_ft = min(settings.force_range_n, settings.moment_range_nm) ** 2
        self._gyro = settings.gyro_range_rad_s**2
        self._accel = settings.accel_range_m_s2**2
        self._jumps = (
            settings.joint_jump_rad**2,
            settings.gyro_jump_rad_s**2,
            settings.force_jump_n**2,
            settings.force_jump_n**2,
        )
        self._move = np.zeros(robot.n_a)
        self._place = np.zeros(robot.n_a)
        self._good: Snapshot | None = None
        self._sums = (math.nan,) * 4
        self._troubled = [0] * 4
        self._repeats = [0] * 4
        self._well = [0] * 4
        self._is_calm = True

    @property
    def all_believed(self) -> bool:
        """Whether no sensor is lost."""
        return not any(self.lost)

    def check(
        self, snapshot: Snapshot, ages: Ages, *, moves: Callable[[], bool]
    ) -> Snapshot:
        """Judges a tick.

        Args:
            snapshot: as it came.
            ages: ticks since each sensor's message.
            moves: asked when a sensor repeats itself: whether the command changed, so
                that readings must change, too.

        Returns:
            The same snapshot when nothing is wrong; else one with the last good
            readings in place of the bad.
        """
        good = self._good
        if good is None:
            self._good = good = snapshot
        q, dq, effort = snapshot.q, snapshot.dq, snapshot.effort
        gyro, accel = snapshot.angular_velocity, snapshot.linear_acceleration
        left, right = snapshot.ft_left, snapshot.ft_right
        gyro_square, accel_square = gyro.dot(gyro), accel.dot(accel)
        before = self._sums
        sums = (
            dq.dot(dq) + effort.dot(effort),
            gyro_square + accel_square,
            left.dot(left),
            right.dot(right),
        )
        self._sums = sums
        move, place = self._move, self._place
        np.subtract(q, good.q, out=move)
        np.subtract(q, self._middle, out=place)
        np.multiply(place, self._per_half, out=place)
        is_well = (
            self._is_calm
            and ages == FRESH
            and sums[0] != before[0]
            and sums[1] != before[1]
            and sums[2] != before[2]
            and sums[3] != before[3]
            and math.isfinite(sums[0])
            and move.dot(move) <= self._jumps[JOINTS]
            and -1.0 <= place[idamax(place)] <= 1.0
            and gyro_square <= self._jumps[IMU]
            and accel_square <= self._accel
            and sums[2] <= self._quick_ft
            and sums[3] <= self._quick_ft
        )
        if is_well:
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
        """Judges each sensor alone."""
        changed = [
            age == 0 and now != then
            for age, now, then in zip(ages, self._sums, before, strict=True)
        ]
        mended: dict[str, Any] = {}
        for index in range(4):
            repeats = ages[index] == 0 and not changed[index]
            counts = repeats and moves and any(changed)
            self._repeats[index] = (
                self._repeats[index] + 1
                if counts
                else (0 if changed[index] else self._repeats[index])
            )
            trouble = self._trouble(index, snapshot, good, ages[index])
            self._judge(index, trouble)
            if trouble:
                for name in FIELDS[index]:
                    mended[name] = getattr(good, name)
        self._is_calm = not (
            any(self._troubled) or any(self._repeats) or any(self.lost)
        )
        self._good = replace(snapshot, **mended) if mended else snapshot
        return self._good

    def _judge(self, index: int, trouble: str) -> None:
        """From trouble to loss and back."""
        if trouble:
            self._troubled[index] += 1
            self._well[index] = 0
            is_frozen = self._repeats[index] >= self._frozen_after
            if is_frozen or self._troubled[index] > self._bridge:
                self.lost[index] = self.lost[index] or trouble
            return
        self._troubled[index] = 0
        if self.lost[index]:
            self._well[index] += 1
            if self._well[index] > self._recover:
                self.lost[index] = ""

    def _trouble(self, index: int, snapshot: Snapshot, good: Snapshot, age: int) -> str:
        """What is wrong with a sensor now; empty when nothing is."""
        name = TICK_SENSORS[index]
        if age > 0:
            return f"{name} missing"
        values = [getattr(snapshot, field) for field in FIELDS[index]]
        if not all(np.isfinite(array).all() for array in values):
            return f"{name} not a number"
        if self._is_beyond(index, values):
            return f"{name} beyond its range"
        if self._repeats[index] >= self._frozen_after:
            return f"{name} frozen"
        was_jump = self.lost[index].endswith(JUMP)
        if (was_jump or not self.lost[index]) and self._has_jumped(
            index, snapshot, good
        ):
            return f"{name} {JUMP}"
        return ""

    def _is_beyond(self, index: int, values: list[Array]) -> bool:
        if index == JOINTS:
            place = (values[0] - self._middle) * self._per_half
            return bool(np.abs(place).max() > 1.0)
        if index == IMU:
            _, gyro, accel = values
            return bool(gyro.dot(gyro) > self._gyro or accel.dot(accel) > self._accel)
        force, moment = values[0][:3], values[0][3:]
        return bool(
            force.dot(force) > self._range_force**2
            or moment.dot(moment) > self._range_moment**2
        )

    def _has_jumped(self, index: int, snapshot: Snapshot, good: Snapshot) -> bool:
        name = ("q", "angular_velocity", "ft_left", "ft_right")[index]
        change = getattr(snapshot, name) - getattr(good, name)
        if index in (LEFT_FT, RIGHT_FT):
            change = change[:3]
        return bool(change.dot(change) > self._jumps[index])
