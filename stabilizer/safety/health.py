"""Health of each sensor: missing, not finite, out of range, jumping, frozen, and so on.

Stands between snapshot and observer. An impossible reading is replaced by the last good
one for a few milliseconds; then the sensor is lost. Pure: the same snapshots give the
same verdicts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from operator import eq
from typing import Any, Final

import numpy as np
from scipy.linalg.blas import idamax

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Ages, Snapshot, SnapshotLayout, readings
from surefoot.schemas.arrays import Array
from surefoot.schemas.reasons import SensorTrouble, plain
from surefoot.schemas.sensors import SENSORS, Loss, Reach, ankle_sensor
from surefoot.schemas.settings import SafetySettings
from surefoot.stabilizer.safety.consistency import NEITHER, SoleCheck

FRESH: Ages = (0,) * len(SENSORS)
REQUIRED = tuple(i for i, entry in enumerate(SENSORS) if entry.loss is Loss.HOLD)
"""Sensors without which nothing works, by their place in the table."""
LEFT_FT, RIGHT_FT = (SENSORS.index(ankle_sensor(side)) for side in ("left", "right"))
EVERY = tuple(range(len(SENSORS)))
ATTITUDE_NORM: Final = (0.9, 1.1)
"""Range of the square of an attitude's norm."""
UNLIMITED: Final = 1e200
"""Stands for no limit. Finite, since infinity over infinity would be NaN."""
SPEED_SHARE: Final = 5.0
"""Multiple of its velocity limit at which no joint can turn, whatever its encoder
says."""
DRIVEN_RAD_S: Final = 15.0
"""Speed at which a load may turn any joint against its servo, also of a slow drive."""

STUCK_TIMES: Final = 5.0
"""Multiple of ``frozen_after_s`` after which a number that repeats itself is stuck,
while its sensor's others move. A coarse reading may repeat for a while."""
OVERLOAD_WEIGHTS: Final = 2.0
"""Load a foot may be asked to carry, as in every step of a heavy robot [weights]."""


class SensorLimits:
    """Compares one tick's numbers with their limits, all at once.

    The readings of a snapshot form one row, in the order of the sensor table.

    Attributes:
        stuck: per sensor, whether a number in it repeats itself for long.
    """

    def __init__(self, robot: Robot, settings: SafetySettings) -> None:
        """Lay out the row."""
        layout = SnapshotLayout(robot.n_a)
        size = layout.size
        self._middle = np.zeros(size)
        self._now, self._last = np.zeros(size), np.zeros(size)
        self._place, self._change = np.zeros(size), np.zeros(size)
        self._rows: list[slice] = []
        self._trembling: list[Array] = []
        self._attitudes: list[tuple[int, Array]] = []
        self._is_single, self._is_measured, self._moved, self._moves = np.zeros(
            (4, size), dtype=bool
        )
        self._readings = [0] * len(SENSORS)
        self._stuck_after = round(
            STUCK_TIMES * settings.frozen_after_s / robot.period_s
        )
        self.stuck = [False] * len(SENSORS)
        ranges, jumps = np.full(size, UNLIMITED), np.full(size, UNLIMITED)
        for index, entry in enumerate(SENSORS):
            places = [layout.place(entry, name) for name in entry.attributes]
            self._rows.append(slice(places[0].start, places[-1].stop))
            begin = min(
                place.start
                for place, quantity in zip(places, entry.quantities, strict=True)
                if quantity.trembles
            )
            self._trembling.append(self._now[begin : places[-1].stop])
            for place, quantity in zip(places, entry.quantities, strict=True):
                if quantity.jump:
                    jumps[place] = getattr(settings, quantity.jump)
                self._is_single[place] = quantity.trembles and quantity.size > 0
                match quantity.reach:
                    case Reach.SETTING:
                        ranges[place] = getattr(settings, quantity.range)
                    case Reach.JOINT_RANGE:
                        margin = getattr(settings, quantity.range)
                        ranges[place] = 0.5 * (robot.upper - robot.lower) + margin
                        self._middle[place] = 0.5 * (robot.upper + robot.lower)
                    case Reach.JOINT_SPEED:
                        fastest = SPEED_SHARE * robot.velocity_limit
                        ranges[place] = np.maximum(fastest, DRIVEN_RAD_S)
                    case Reach.UNIT_NORM:
                        self._attitudes.append((index, self._now[place]))
        self._per_range, self._per_jump = 1.0 / ranges, 1.0 / jumps

    def measure(self, snapshot: Snapshot) -> bool:
        """Take a tick's numbers, without trusting them yet.

        Returns:
            Whether every number is within its range and near its last trusted value.
        """
        place, change, now = self._place, self._change, self._now
        np.concatenate(readings(snapshot), out=now)
        np.subtract(now, self._middle, out=place)
        np.multiply(place, self._per_range, out=place)
        np.subtract(now, self._last, out=change)
        np.multiply(change, self._per_jump, out=change)
        for _, attitude in self._attitudes:
            if not _is_attitude(attitude):
                return False
        # A NaN would hide from the search for the largest.
        return bool(
            place.dot(place) < np.inf
            and -1.0 <= place[idamax(place)] <= 1.0
            and -1.0 <= change[idamax(change)] <= 1.0
        )

    def sums(self) -> tuple[float, ...]:
        """For each sensor, the sum of squares of its readings that always tremble."""
        return tuple([numbers.dot(numbers) for numbers in self._trembling])

    def count_moves(self, fresh: Sequence[int]) -> bool:
        """Notice numbers that repeat themselves while their sensor's others change.

        Joints are left out, since one may rest while others move. So are numbers that
        have never changed: not every sensor measures all axes.

        Args:
            fresh: sensors with a new reading, by their places in the table.

        Returns:
            Whether any sensor has such a number; ``stuck`` tells which.
        """
        np.not_equal(self._now, self._last, out=self._moves)
        np.logical_or(self._moved, self._moves, out=self._moved)
        for index in fresh:
            self._readings[index] += 1
            if self._readings[index] >= self._stuck_after:
                row = self._rows[index]
                moved, is_measured = self._moved[row], self._is_measured[row]
                self.stuck[index] = bool((is_measured & ~moved).any())
                is_measured |= moved & self._is_single[row]
                moved[:] = False
                self._readings[index] = 0
        return True in self.stuck

    def believe_measured(self) -> None:
        """Compare the next numbers with those last measured."""
        np.copyto(self._last, self._now)

    def believe(self, snapshot: Snapshot) -> None:
        """Compare the next numbers with those of a snapshot."""
        np.concatenate(readings(snapshot), out=self._now)
        self.believe_measured()

    def is_beyond(self, index: int) -> bool:
        """Whether a sensor, by its place in the table, is beyond its range."""
        return _exceeds(self._place[self._rows[index]]) or any(
            which == index and not _is_attitude(attitude)
            for which, attitude in self._attitudes
        )

    def has_jumped(self, index: int) -> bool:
        """Whether a sensor changed by more than is possible in one tick."""
        return _exceeds(self._change[self._rows[index]])


def _is_attitude(quat: Array) -> bool:
    return bool(ATTITUDE_NORM[0] < quat.dot(quat) < ATTITUDE_NORM[1])


def _exceeds(shares: Array) -> bool:
    return bool(np.abs(shares).max() > 1.0)


class SensorHealth:
    """Judges snapshots and bridges short gaps.

    All numbers of a tick, and their change since the last trusted ones, are compared
    with their limits at once. Only a doubt looks at each sensor.

    Attributes:
        lost: per sensor, in the order of the sensor table, why it is lost; None for a
            trusted sensor.
        overload_ticks: ticks for which left and right foot have reported a force that
            can last only if it is false.
    """

    def __init__(
        self,
        robot: Robot,
        settings: SafetySettings,
        *,
        weight: float = 0.0,
        soles: SoleCheck | None = None,
    ) -> None:
        """Trust every sensor at first.

        Args:
            robot: the robot with the sensors.
            settings: limits and times.
            weight: weight of the robot [N].
            soles: tells pressure outside of a sole; absent, any moment is believed.
        """
        self.lost: list[SensorTrouble | None] = [None] * len(SENSORS)
        self.overload_ticks = (0, 0)
        self._bridge = round(settings.bridge_s / robot.period_s)
        self._frozen_after = round(settings.frozen_after_s / robot.period_s)
        self._overload_after = round(settings.overload_after_s / robot.period_s)
        self._overload = max(settings.overload_n, OVERLOAD_WEIGHTS * weight) ** 2
        self._recover = round(settings.recover_s / robot.period_s)
        self._limits = SensorLimits(robot, settings)
        self._soles = soles
        self._outside = self._doubted = NEITHER
        is_virtual = robot.file.virtual_ft is not None
        ankles = [SENSORS[index].name for index in (LEFT_FT, RIGHT_FT)]
        self._virtual = dict.fromkeys(ankles, " (virtual)") if is_virtual else {}
        self._good: Snapshot | None = None
        self._sums = (math.nan,) * len(SENSORS)
        self._troubled = [0] * len(SENSORS)
        self._repeats = [0] * len(SENSORS)
        self._overloaded = [0] * len(SENSORS)
        self._well = [0] * len(SENSORS)
        self._is_calm = True

    @property
    def all_believed(self) -> bool:
        """Whether no sensor is lost."""
        return not any(self.lost)

    @property
    def losses(self) -> dict[str, SensorTrouble]:
        """Lost sensors by channel, and why."""
        pairs = zip(SENSORS, self.lost, strict=True)
        return {entry.name: why for entry, why in pairs if why is not None}

    def in_words(self) -> str:
        """Lost sensors in words: ``imu missing``; empty for none."""
        return ", ".join(
            f"{name}{self._virtual.get(name, '')} {plain(why)}"
            for name, why in self.losses.items()
        )

    def check(
        self, snapshot: Snapshot, ages: Ages, *, moves: Callable[[], bool]
    ) -> Snapshot:
        """Judge a tick.

        Args:
            snapshot: the snapshot as received.
            ages: ticks since each sensor's message.
            moves: called when a sensor repeats itself; whether the command changed, so
                that readings must change, too.

        Returns:
            The same snapshot if nothing is wrong; else one with the last good readings
            in place of the bad ones.
        """
        limits = self._limits
        good = self._good
        if good is None:
            self._good = good = snapshot
            limits.believe(snapshot)
        is_within = limits.measure(snapshot)
        before = self._sums
        self._sums = sums = limits.sums()
        if self._soles is not None:
            self._outside = self._soles.outside(snapshot, self._doubted)
        is_well = (
            self._is_calm
            and is_within
            and ages == FRESH
            and not any(map(eq, sums, before))
            and sums[LEFT_FT] <= self._overload
            and sums[RIGHT_FT] <= self._overload
            and self._outside == NEITHER
        )
        if is_well:
            if limits.count_moves(EVERY):
                self._is_calm = False  # from the next tick on
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
        self._limits.count_moves([i for i, is_new in enumerate(changed) if is_new])
        mended: dict[str, Any] = {}
        for index in range(len(SENSORS)):
            if changed[index]:
                self._repeats[index] = 0
            elif ages[index] == 0 and moves and any(changed):
                self._repeats[index] += 1
            is_foot = index in (LEFT_FT, RIGHT_FT)
            overloads = is_foot and self._sums[index] > self._overload
            self._overloaded[index] = self._overloaded[index] + 1 if overloads else 0
            trouble = self._trouble(index, snapshot, ages[index])
            self._judge(index, trouble)
            if trouble:
                for name in SENSORS[index].fields:
                    mended[name] = getattr(good, name)
        self._doubted = (
            self.lost[LEFT_FT] is SensorTrouble.INCONSISTENT,
            self.lost[RIGHT_FT] is SensorTrouble.INCONSISTENT,
        )
        self.overload_ticks = (self._overloaded[LEFT_FT], self._overloaded[RIGHT_FT])
        self._is_calm = not (
            any(self._troubled)
            or any(self._repeats)
            or any(self._overloaded)
            or any(self._limits.stuck)
            or any(self.lost)
        )
        self._good = replace(snapshot, **mended) if mended else snapshot
        self._limits.believe(self._good)
        return self._good

    def _judge(self, index: int, trouble: SensorTrouble | None) -> None:
        """Turn trouble that lasts into loss, and recovery into trust."""
        if trouble:
            self._troubled[index] += 1
            self._well[index] = 0
            has_waited = (
                trouble is SensorTrouble.FROZEN
                or self._overloaded[index] > self._overload_after
            )
            if has_waited or self._troubled[index] > self._bridge:
                self.lost[index] = self.lost[index] or trouble
            return
        self._troubled[index] = 0
        if self.lost[index]:
            self._well[index] += 1
            if self._well[index] > self._recover:
                self.lost[index] = None

    def _trouble(
        self, index: int, snapshot: Snapshot, age: int
    ) -> SensorTrouble | None:
        """Return what is wrong with a sensor now; None if nothing is."""
        if age > 0:
            return SensorTrouble.MISSING
        values = [getattr(snapshot, field) for field in SENSORS[index].fields]
        if not all(np.isfinite(array).all() for array in values):
            return SensorTrouble.NOT_A_NUMBER
        if self._limits.is_beyond(index):
            return SensorTrouble.OUT_OF_RANGE
        if self._repeats[index] >= self._frozen_after or self._limits.stuck[index]:
            return SensorTrouble.FROZEN
        if self._overloaded[index] > self._overload_after:
            return SensorTrouble.OVERLOADED
        if (index == LEFT_FT and self._outside[0]) or (
            index == RIGHT_FT and self._outside[1]
        ):
            return SensorTrouble.INCONSISTENT
        # A sensor lost for another reason may come back with any value.
        is_compared = self.lost[index] in (None, SensorTrouble.JUMPED)
        if is_compared and self._limits.has_jumped(index):
            return SensorTrouble.JUMPED
        return None
