"""Carries readings to their messages: rates and delays of sensor lines, and faults."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.messages import ForceTorque, ImuState, JointState
from surefoot.schemas.scenario import AXES, SensorFault
from surefoot.schemas.scenario_robot import Delay, Sensors
from surefoot.schemas.sensors import SENSORS, Sensor, sensor
from surefoot.schemas.validation import nearest_or_all
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.conventions import whole_ticks

IMPOSSIBLE = 1e6
"""Value that no sensor can measure, in any unit."""
JOINTS, IMU, FORCE_TORQUE = "joints", "imu", "force_torque"
KINDS = (JOINTS, IMU, FORCE_TORQUE)
"""Kinds of sensors, by their names in scenarios."""
_KIND_OF = {JointState: JOINTS, ImuState: IMU, ForceTorque: FORCE_TORQUE}
_JITTER_STREAM = 1_000
"""First random stream of the delays, far from the streams of sensor noise."""
_TOLERANCE = 1e-9


class SensorFaults:
    """Changes readings while faults act; passes them unchanged otherwise.

    Attributes:
        missing: sensors without a message for the last tick.
        unread: these, and sensors whose message is refused since it holds no numbers.
    """

    def __init__(
        self,
        faults: Sequence[SensorFault],
        *,
        joints: Sequence[str],
        period_s: float,
    ) -> None:
        """Read the faults of a scenario.

        Args:
            faults: in the order of the file; later ones act on the results of earlier.
            joints: names of the robot's joints, in bus order.
            period_s: time from tick to tick [s].

        Raises:
            ScenarioError: a fault names a joint that the robot does not have.
        """
        self.missing: tuple[str, ...] = ()
        self.unread: tuple[str, ...] = ()
        self._faults = [
            (
                fault,
                _places(fault, joints, what=f"fault[{index}].axis"),
                math.ceil(fault.start_s / period_s - 1e-9),
                math.ceil((fault.start_s + fault.duration_s) / period_s - 1e-9),
            )
            for index, fault in enumerate(faults)
        ]
        self._frozen: dict[int, Snapshot] = {}
        self._last: Snapshot | None = None

    def apply(self, snapshot: Snapshot) -> Snapshot:
        """Return the readings with faults applied; called once per tick, in order."""
        if not self._faults:
            return snapshot
        missing: list[str] = []
        unreadable: list[str] = []
        reported = snapshot
        for index, (fault, places, begin, end) in enumerate(self._faults):
            if not begin <= snapshot.tick < end:
                continue
            if fault.kind == "drop":
                missing.append(fault.sensor)
            else:
                source = reported
                if fault.kind == "freeze":
                    source = self._frozen.setdefault(index, self._last or reported)
                reported = _spoil(fault, places, reported, source)
            if fault.kind == "nan":
                unreadable.append(fault.sensor)
        self._last = reported
        self.missing = tuple(missing)
        self.unread = (*missing, *unreadable)
        return reported


Place = tuple[str, slice]
"""Field of the snapshot and the part of it."""


def _places(fault: SensorFault, joints: Sequence[str], *, what: str) -> list[Place]:
    """Find the numbers that a fault changes."""
    failing = sensor(fault.sensor)
    names, axis = failing.attributes, fault.axis
    if fault.part is not None:
        names = (fault.part,)
    elif fault.kind == "jump":
        names = (failing.offset.attribute,)
        if failing.offset.axis is not None:
            axis = AXES[failing.offset.axis]
    places = [failing.place(name) for name in names]
    if axis is None:
        return places
    known = tuple(joints) if failing.message is JointState else AXES
    if axis not in known:
        raise ScenarioError(
            f"{what}: the robot has no joint {axis!r}{nearest_or_all(axis, known)}",
            field=what,
        )
    ((field, numbers),) = places
    begin = numbers.start + known.index(axis)
    return [(field, slice(begin, begin + 1))]


def _spoil(
    fault: SensorFault, places: list[Place], reported: Snapshot, frozen: Snapshot
) -> Snapshot:
    """Return the readings with one fault, which may take frozen ones."""
    changed: dict[str, Any] = {}
    for field, numbers in places:
        values = changed.setdefault(field, getattr(reported, field).copy())
        if fault.kind == "freeze":
            values[numbers] = getattr(frozen, field)[numbers]
        elif fault.kind == "jump":
            values[numbers] += fault.offset
        else:
            values[numbers] = math.nan if fault.kind == "nan" else IMPOSSIBLE
    return replace(reported, **changed)


def kind_of(entry: Sensor) -> str:
    """Return the kind of a sensor."""
    return _KIND_OF[entry.message]


def sensor_lines(
    settings: Sensors, delay: Delay, *, period_s: float, seed: int
) -> list[SensorLine]:
    """Make the lines of a scenario.

    Returns:
        One line for each kind of sensor; none if every reading is taken every tick and
        reported at once.

    Raises:
        ScenarioError: a delay is no whole number of ticks, or a rate is above the
            robot's.
    """
    jitter = whole_ticks(1e-3 * delay.jitter_ms, period_s, what="delay.jitter_ms")
    lines = []
    for index, kind in enumerate(KINDS):
        rate_hz = getattr(settings, f"{kind}_rate_hz")
        key = "delay.sensor_ms"
        if not isinstance(delay.sensor_ms, float):
            key = f"{key}.{kind}"
        if rate_hz is not None and rate_hz * period_s > 1.0 + _TOLERANCE:
            raise ScenarioError(
                f"sensors.{kind}_rate_hz: got {rate_hz:g}, expected at most the "
                f"{1.0 / period_s:g} ticks a second of the robot",
                field=f"sensors.{kind}_rate_hz",
            )
        stream = np.random.SeedSequence(seed, spawn_key=(_JITTER_STREAM + index,))
        lines.append(
            SensorLine(
                kind,
                per_tick=1.0 if rate_hz is None else rate_hz * period_s,
                delay=whole_ticks(1e-3 * delay.of(kind), period_s, what=key),
                jitter=jitter,
                random=np.random.default_rng(stream),
            )
        )
    return lines if any(not line.is_direct for line in lines) else []


class SensorLine:
    """Readings of one kind of sensor, from measurement to report.

    Attributes:
        kind: one of :data:`KINDS`.
        fields: its fields of the snapshot.
        is_direct: whether the line changes nothing.
    """

    def __init__(
        self,
        kind: str,
        *,
        per_tick: float,
        delay: int,
        jitter: int,
        random: np.random.Generator,
    ) -> None:
        """Start without readings.

        Args:
            kind: one of :data:`KINDS`.
            per_tick: readings per tick, at most 1.
            delay: ticks from measurement to report.
            jitter: most ticks of additional delay.
            random: generator of the jitter.
        """
        self.kind = kind
        self.fields = tuple(
            field
            for entry in SENSORS
            if kind_of(entry) == kind
            for field in entry.fields
        )
        self.is_direct = per_tick >= 1.0 and delay == 0 and jitter == 0
        self._per_tick, self._delay, self._jitter = per_tick, delay, jitter
        self._random = random
        self._readings: deque[Snapshot] = deque()

    def is_due(self, tick: int) -> bool:
        """Return whether a reading is taken at a tick; the first one always is."""
        if not self._readings or self._per_tick >= 1.0:
            return True
        return self._count(tick) > self._count(tick - 1)

    def take(self, snapshot: Snapshot) -> None:
        """Take a reading; only the fields of this kind count."""
        self._readings.append(snapshot)

    def report(self, tick: int) -> Snapshot:
        """Return the newest reading that has arrived; before that, the first one."""
        late = self._delay
        if self._jitter:
            late += int(self._random.integers(self._jitter + 1))
        while len(self._readings) > 1 and self._readings[1].tick <= tick - late:
            self._readings.popleft()
        return self._readings[0]

    def _count(self, tick: int) -> int:
        return math.floor(tick * self._per_tick + _TOLERANCE)
