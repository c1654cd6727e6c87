"""Every sensor of the table can fail alone, in every way."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from surefoot.robot_io.snapshot import Snapshot, readings
from surefoot.schemas.scenario import SensorFault
from surefoot.schemas.sensors import SENSORS, SNAPSHOT_FIELDS, Quantity, Sensor
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.sensor_lines import SensorFaults
from tests.robot_io.sensor_messages import snapshot_at

PERIOD_S = 1e-3
each_part = pytest.mark.parametrize(
    ("entry", "quantity"),
    [(entry, quantity) for entry in SENSORS for quantity in entry.quantities],
    ids=lambda value: getattr(value, "name", getattr(value, "attribute", "")),
)
every_sensor = pytest.mark.parametrize("entry", SENSORS, ids=lambda entry: entry.name)


JOINTS = tuple(f"joint_{i}" for i in range(snapshot_at(0).q.size))


def at_tick_1(entry: Sensor, kind: str, **more: Any) -> tuple[SensorFaults, Snapshot]:
    """Return what the robot reports at tick 1 with a fault that begins then."""
    fault = SensorFault(
        sensor=entry.name, kind=kind, start_s=PERIOD_S, duration_s=1.0, **more
    )
    faults = SensorFaults([fault], joints=JOINTS, period_s=PERIOD_S)
    assert faults.apply(snapshot_at(0)).tick == 0
    return faults, faults.apply(snapshot_at(1))


def assert_others_untouched(reported: Snapshot, entry: Sensor) -> None:
    for field in set(SNAPSHOT_FIELDS) - set(entry.fields):
        assert np.array_equal(getattr(reported, field), getattr(snapshot_at(1), field))


@every_sensor
def test_dropped_it_is_missing(entry: Sensor) -> None:
    faults, reported = at_tick_1(entry, "drop")
    assert faults.missing == faults.unread == (entry.name,)
    assert_others_untouched(reported, entry)


@every_sensor
def test_frozen_it_repeats_its_last_readings(entry: Sensor) -> None:
    faults, reported = at_tick_1(entry, "freeze")
    assert faults.missing == ()
    for field in entry.fields:
        last = getattr(snapshot_at(0), field)
        assert np.array_equal(getattr(reported, field), last)
    assert_others_untouched(reported, entry)


@every_sensor
@pytest.mark.parametrize("kind", ["nan", "range"])
def test_nonsense_is_all_it_reports(entry: Sensor, kind: str) -> None:
    faults, reported = at_tick_1(entry, kind)
    assert faults.unread == ((entry.name,) if kind == "nan" else ())
    for field in entry.fields:
        values = getattr(reported, field)
        assert np.all(np.isnan(values) if kind == "nan" else values == 1e6)
    assert_others_untouched(reported, entry)


@every_sensor
def test_a_jump_touches_what_the_table_says(entry: Sensor) -> None:
    _, reported = at_tick_1(entry, "jump", size=2.0)
    offset = entry.offset
    field, part = entry.place(offset.attribute)
    expected = getattr(snapshot_at(1), field).copy()
    if offset.axis is None:
        expected[part] += 2.0
    else:
        expected[part.start + offset.axis] += 2.0
    assert np.array_equal(getattr(reported, field), expected)
    rest = replace(reported, **{field: getattr(snapshot_at(1), field)})
    for one, other in zip(readings(rest), readings(snapshot_at(1)), strict=True):
        assert np.array_equal(one, other)


@pytest.mark.parametrize("kind", ["freeze", "nan", "range", "jump"])
@each_part
def test_a_part_fails_alone(entry: Sensor, quantity: Quantity, kind: str) -> None:
    """One number of it, and nothing beside it, as exactly as all of the sensor."""
    axis = JOINTS[1] if entry.name == "joints" else "y"
    more = {"size": 2.0} if kind == "jump" else {}
    _, reported = at_tick_1(entry, kind, part=quantity.attribute, axis=axis, **more)
    field, numbers = entry.place(quantity.attribute)
    was, then = getattr(snapshot_at(1), field), getattr(snapshot_at(0), field)
    expected, at = was.copy(), numbers.start + 1
    wrong = {"freeze": then[at], "nan": np.nan, "range": 1e6, "jump": was[at] + 2.0}
    expected[at] = wrong[kind]
    assert np.array_equal(getattr(reported, field), expected, equal_nan=True)
    rest = replace(reported, **{field: was})
    for one, other in zip(readings(rest), readings(snapshot_at(1)), strict=True):
        assert np.array_equal(one, other)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"axis": "x"}, "needs the `part`"),
        ({"part": "gyro"}, "expected one of quat_xyzw, angular_velocity, linear_acc"),
        ({"part": "angular_velocity", "axis": "roll"}, "expected x, y or z"),
        ({"part": "angular_velocity", "kind": "jump"}, "needs its `size`"),
        ({"part": "angular_velocity", "kind": "drop"}, "a message is sent or not"),
    ],
)
def test_a_part_that_there_is_not_is_refused(keys: dict[str, str], words: str) -> None:
    table = {"sensor": "imu", "kind": "freeze", "start_s": 0.0, "duration_s": 1.0}
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(table | keys, SensorFault)


def test_a_joint_that_there_is_not_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"fault\[0\].axis: .* no joint 'joint_x'"):
        at_tick_1(SENSORS[0], "freeze", part="q", axis="joint_x")
