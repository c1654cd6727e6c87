"""The sensor table fits the messages, the files and itself."""

from __future__ import annotations

import re

import msgspec
import pytest

from surefoot.robot_io.robot import load_robot
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.json_schema import field_docs
from surefoot.schemas.messages import JointState
from surefoot.schemas.scenario import Scenario, SensorFault
from surefoot.schemas.scenario_robot import Sensors
from surefoot.schemas.sensors import (
    PER_JOINT,
    SENSORS,
    SNAPSHOT_FIELDS,
    Loss,
    Reach,
    Sensor,
    ankle_sensor,
    sensor,
)
from surefoot.schemas.settings import SafetySettings
from surefoot.schemas.toml_file import convert
from surefoot.schemas.topics import TICK_SENSORS, Direction, topic

every_sensor = pytest.mark.parametrize("entry", SENSORS, ids=lambda entry: entry.name)


def names_in(kind: type) -> set[str]:
    return {field.name for field in msgspec.structs.fields(kind)}


@every_sensor
def test_its_channel_is_in_the_topic_table(entry: Sensor) -> None:
    channel = topic(entry.name)
    assert channel.key == entry.key
    assert channel.message is entry.message
    assert channel.direction is Direction.FROM_ROBOT
    assert channel.rate == "every tick"


def test_the_joints_come_first() -> None:
    assert SENSORS[0].message is JointState
    assert TICK_SENSORS[0] == "joints"


@every_sensor
def test_it_names_every_reading_of_its_message(entry: Sensor) -> None:
    head = {"schema", "tick", "stamp_ns"}
    assert set(entry.attributes) == names_in(entry.message) - head
    per_joint = {q.attribute for q in entry.quantities if q.size == PER_JOINT}
    assert per_joint == set(entry.message.PER_JOINT)


@every_sensor
def test_its_sizes_are_those_of_its_message(entry: Sensor) -> None:
    schema = msgspec.json.schema(entry.message)
    properties = schema["$defs"][entry.message.__name__]["properties"]
    for quantity in entry.quantities:
        if quantity.size != PER_JOINT:
            assert properties[quantity.attribute]["minItems"] == quantity.size


def test_fields_of_the_snapshot_belong_to_one_sensor_each() -> None:
    assert len(set(SNAPSHOT_FIELDS)) == len(SNAPSHOT_FIELDS)


@every_sensor
def test_a_field_with_one_number_per_joint_holds_nothing_else(entry: Sensor) -> None:
    for quantity in entry.quantities:
        if quantity.size == PER_JOINT:
            sharing = [q for q in entry.quantities if q.field == quantity.field]
            assert sharing == [quantity]


@every_sensor
def test_what_trembles_stands_together_at_the_end(entry: Sensor) -> None:
    trembles = [quantity.trembles for quantity in entry.quantities]
    assert trembles == sorted(trembles)
    assert trembles[-1]


@every_sensor
def test_its_settings_are_settings(entry: Sensor) -> None:
    safety, noise = names_in(SafetySettings), names_in(Sensors)
    for quantity in entry.quantities:
        needs_range = quantity.reach in (Reach.SETTING, Reach.JOINT_RANGE)
        assert (quantity.range in safety) == needs_range
        assert (quantity.jump in safety) == needs_range
        if quantity.noise is not None:
            assert {quantity.noise.deviation, quantity.noise.bias} <= noise


def test_no_two_sensors_share_random_numbers() -> None:
    streams = [
        {q.noise.stream for q in entry.quantities if q.noise} for entry in SENSORS
    ]
    assert sum(map(len, streams)) == len(set().union(*streams))


@every_sensor
def test_its_frame_is_named_in_the_robot_file(entry: Sensor) -> None:
    file = load_robot("walker").file
    if entry.message is JointState:
        assert entry.frame == ""
    else:
        assert entry.link(file)
    by_hand = {"imu": "imu", "left_ankle_ft": file.foot[0].ft_link}
    if entry.name in by_hand:
        assert entry.link(file) == by_hand[entry.name]


@pytest.mark.parametrize("side", ["left", "right"])
def test_each_foot_has_one_sensor_that_may_be_lost(side: str) -> None:
    assert ankle_sensor(side).name == f"{side}_ankle_ft"
    assert ankle_sensor(side).loss is Loss.DEGRADE


@every_sensor
def test_a_scenario_may_have_it_fail(entry: Sensor) -> None:
    table = {"sensor": entry.name, "kind": "jump", "start_s": 1.0, "duration_s": 1.0}
    fault = convert(table, SensorFault, source="test")
    assert fault.offset == entry.offset.size
    assert convert({**table, "size": 7.0}, SensorFault, source="test").offset == 7.0


def test_a_scenario_may_not_have_anything_else_fail() -> None:
    fault = {"sensor": "nose", "kind": "drop", "start_s": 1.0, "duration_s": 1.0}
    table = {"name": "test", "duration_s": 1.0, "fault": [fault]}
    with pytest.raises(FileFormatError, match=r"fault\[0\]\.sensor.*nose"):
        convert(table, Scenario, source="test")


def test_the_scenario_file_tells_the_sizes_of_the_table() -> None:
    told = field_docs(SensorFault)["size"]
    sizes = {f"{entry.offset.size:g}" for entry in SENSORS}
    assert sizes <= set(re.findall(r"[\d.]*\d", told))


def test_places_are_found_by_attribute() -> None:
    assert sensor("joints").place("dq") == ("dq", slice(0, None))
    assert sensor("right_ankle_ft").place("moment") == ("ft_right", slice(3, 6))
    with pytest.raises(KeyError, match="has no 'torque'"):
        sensor("left_ankle_ft").place("torque")
    with pytest.raises(KeyError, match=r"nose.*left_ankle_ft"):
        sensor("nose")
