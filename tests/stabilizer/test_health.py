"""Every sensor of the table is watched: missing, NaN, range, jump, frozen."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot, SnapshotLayout
from surefoot.schemas.arrays import Array
from surefoot.schemas.reasons import SensorTrouble, StabilizerState
from surefoot.schemas.sensors import SENSORS, Loss, Quantity, Reach, Sensor
from surefoot.schemas.settings import SafetySettings
from surefoot.stabilizer.controller import HoldController
from surefoot.stabilizer.safety import safety as safety_module
from surefoot.stabilizer.safety.health import (
    FRESH,
    REQUIRED,
    STUCK_TIMES,
    SensorHealth,
)
from surefoot.stabilizer.safety.safety import Safety
from tests.support import with_speeds

SETTINGS = SafetySettings()
LONG = 40
"""Ticks; longer than the patience with any sensor."""
every_sensor = pytest.mark.parametrize("entry", SENSORS, ids=lambda entry: entry.name)
ALL = [(entry, quantity) for entry in SENSORS for quantity in entry.quantities]


def each(pairs: list[tuple[Sensor, Quantity]]) -> pytest.MarkDecorator:
    names = [f"{entry.name}.{quantity.attribute}" for entry, quantity in pairs]
    return pytest.mark.parametrize(("entry", "quantity"), pairs, ids=names)


def trembling(walker: Robot) -> Iterator[Snapshot]:
    """Yield sensors of a robot that stands, with noise in the last digits."""
    layout, rng = SnapshotLayout(walker.n_a), np.random.default_rng(0)
    tick = 0
    while True:
        numbers = 1e-4 * rng.normal(size=layout.size)
        numbers[layout.places["q"]] += walker.nominal
        for entry in SENSORS:
            for quantity in entry.quantities:
                place = layout.place(entry, quantity.attribute)
                if quantity.reach is Reach.UNIT_NORM:
                    numbers[place] = [0.0, 0.0, 0.0, 1.0]
                if quantity.attribute == "force":
                    numbers[place] += [0.0, 0.0, 200.0]
        yield layout.view(tick, tick, numbers)
        tick += 1


def ages(entry: Sensor, age: int) -> tuple[int, ...]:
    return tuple(age if other is entry else 0 for other in SENSORS)


def changed(
    snapshot: Snapshot, entry: Sensor, quantity: Quantity, values: Array | float
) -> Snapshot:
    field, part = entry.place(quantity.attribute)
    array = getattr(snapshot, field).copy()
    array[part] = values
    return replace(snapshot, **{field: array})


def lost_after(
    walker: Robot, entry: Sensor, quantity: Quantity | None, values: Array | float
) -> SensorTrouble | None:
    """Return why a sensor is lost if one of its quantities stays wrong."""
    health = SensorHealth(walker, SETTINGS)
    stream = trembling(walker)
    health.check(next(stream), FRESH, moves=lambda: True)
    for _ in range(LONG):
        snapshot = next(stream)
        if quantity is not None:
            snapshot = changed(snapshot, entry, quantity, values)
        age = FRESH if quantity is not None else ages(entry, 1)
        health.check(snapshot, age, moves=lambda: True)
    index = SENSORS.index(entry)
    assert not any(why for i, why in enumerate(health.lost) if i != index)
    return health.lost[index]


def test_a_robot_that_stands_is_believed(walker: Robot) -> None:
    health, stream = SensorHealth(walker, SETTINGS), trembling(walker)
    for _ in range(LONG):
        snapshot = next(stream)
        assert health.check(snapshot, FRESH, moves=lambda: True) is snapshot
    assert health.all_believed


@every_sensor
def test_one_whose_message_stays_away_is_lost(walker: Robot, entry: Sensor) -> None:
    assert lost_after(walker, entry, None, 0.0) is SensorTrouble.MISSING


@each(ALL)
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_one_that_reports_no_numbers_is_lost(
    walker: Robot, entry: Sensor, quantity: Quantity, value: float
) -> None:
    with np.errstate(invalid="ignore"):
        lost = lost_after(walker, entry, quantity, value)
    assert lost is SensorTrouble.NOT_A_NUMBER


@each([pair for pair in ALL if pair[1].reach is not Reach.UNLIMITED])
def test_one_beyond_its_range_is_lost(
    walker: Robot, entry: Sensor, quantity: Quantity
) -> None:
    assert lost_after(walker, entry, quantity, 1e6) is SensorTrouble.OUT_OF_RANGE


def test_a_joint_that_its_load_turns_faster_than_its_drive_is_believed(
    walker: Robot,
) -> None:
    """A foot that lands turned back a slow hip at five times its speed limit."""
    slow = with_speeds(walker, 0.3)
    entry = next(entry for entry in SENSORS if entry.name == "joints")
    quantity = next(one for one in entry.quantities if one.attribute == "dq")
    assert lost_after(slow, entry, quantity, 3.0) is None


@each([pair for pair in ALL if pair[1].jump])
def test_a_jump_within_the_range_is_not_believed(
    walker: Robot, entry: Sensor, quantity: Quantity
) -> None:
    stream, health = trembling(walker), SensorHealth(walker, SETTINGS)
    field, part = entry.place(quantity.attribute)
    for share, is_believed in ((0.9, True), (1.1, False)):
        before = next(stream)
        believed = health.check(before, FRESH, moves=lambda: True)
        step = share * getattr(SETTINGS, quantity.jump)
        now = changed(
            next(stream), entry, quantity, getattr(believed, field)[part] + step
        )
        after = health.check(now, FRESH, moves=lambda: True)
        source = now if is_believed else before
        assert np.array_equal(getattr(after, field), getattr(source, field))
        health = SensorHealth(walker, SETTINGS)


@every_sensor
def test_one_that_repeats_itself_is_lost(walker: Robot, entry: Sensor) -> None:
    health, stream = SensorHealth(walker, SETTINGS), trembling(walker)
    first = next(stream)
    stuck = {field: getattr(first, field) for field in entry.fields}
    health.check(first, FRESH, moves=lambda: True)
    for _ in range(LONG):
        health.check(replace(next(stream), **stuck), FRESH, moves=lambda: True)
    assert health.lost[SENSORS.index(entry)] is SensorTrouble.FROZEN


SINGLE = [
    (entry, quantity)
    for entry, quantity in ALL
    if quantity.trembles and quantity.size > 0
]


@each(SINGLE)
@pytest.mark.parametrize("once_moved", [True, False])
def test_one_number_that_repeats_itself_loses_its_sensor_if_it_ever_moved(
    walker: Robot, entry: Sensor, quantity: Quantity, *, once_moved: bool
) -> None:
    health, stream = SensorHealth(walker, SETTINGS), trembling(walker)
    field, part = entry.place(quantity.attribute)
    number = part.start + 1
    patience = round(STUCK_TIMES * SETTINGS.frozen_after_s / walker.period_s)
    for tick in range(4 * patience):
        reading = next(stream)
        if tick > patience or not once_moved:
            values = getattr(reading, field).copy()
            values[number] = 1e-3
            reading = replace(reading, **{field: values})
        health.check(reading, FRESH, moves=lambda: True)
    lost = health.lost[SENSORS.index(entry)]
    assert lost is (SensorTrouble.FROZEN if once_moved else None)


@every_sensor
def test_losing_one_does_what_the_table_says(walker: Robot, entry: Sensor) -> None:
    states = states_without(walker, entry)
    if entry.loss is Loss.HOLD:
        assert StabilizerState.HELD in states
    else:
        # The controller here cannot leave an ankle out: it holds as well.
        is_degradable = entry.loss is Loss.REPORT
        assert (StabilizerState.DEGRADED in states) == is_degradable


def test_one_that_no_controller_needs_is_only_reported(
    walker: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    imu = next(entry for entry in SENSORS if entry.name == "imu")
    others = tuple(index for index in REQUIRED if SENSORS[index] is not imu)
    monkeypatch.setattr(safety_module, "REQUIRED", others)
    states = states_without(walker, imu)
    assert states == [
        StabilizerState.ACTIVE,
        StabilizerState.DEGRADED,
        StabilizerState.ACTIVE,
    ]


def states_without(walker: Robot, entry: Sensor) -> list[StabilizerState]:
    """Return the successive states while a sensor is missing for a while."""
    safety = Safety(HoldController(walker.n_a), walker, SETTINGS)
    stream = trembling(walker)
    safety.start(next(stream), walker.nominal)
    back = round(SETTINGS.recover_s / walker.period_s) + LONG
    states: list[StabilizerState] = []
    for age in (*[0] * 5, *range(1, LONG), *[0] * back):
        safety.step(next(stream), ages(entry, age))
        if not states or states[-1] is not safety.state:
            states.append(safety.state)
            if safety.state is StabilizerState.DEGRADED:
                assert safety.lost_sensors == {entry.name: SensorTrouble.MISSING}
    return states


@pytest.mark.parametrize("scale", [0.9, 1.1])
def test_what_has_not_the_length_of_an_attitude_is_none(
    walker: Robot, scale: float
) -> None:
    stream, health = trembling(walker), SensorHealth(walker, SETTINGS)
    first, second = next(stream), next(stream)
    health.check(first, FRESH, moves=lambda: True)
    odd = replace(second, quat_xyzw=scale * second.quat_xyzw)
    believed = health.check(odd, FRESH, moves=lambda: True)
    assert np.array_equal(believed.quat_xyzw, first.quat_xyzw)


@pytest.mark.parametrize(("weight", "is_believed"), [(700.0, False), (1600.0, True)])
def test_what_a_heavy_robot_weighs_is_no_overload(
    walker: Robot, weight: float, *, is_believed: bool
) -> None:
    """Else one of 160 kg would lose a sensor on its first step."""
    health, stream = SensorHealth(walker, SETTINGS, weight=weight), trembling(walker)
    for _ in range(LONG):
        reading = next(stream)
        pressed = reading.ft_left.copy()
        pressed[2] += 2000.0
        health.check(replace(reading, ft_left=pressed), FRESH, moves=lambda: True)
    assert health.all_believed is is_believed
