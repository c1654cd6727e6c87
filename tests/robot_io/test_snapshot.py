"""Snapshots from messages and back, by the sensor table."""

from __future__ import annotations

from dataclasses import fields, replace

import msgspec
import numpy as np
import pytest

from surefoot.robot_io.snapshot import (
    Delivery,
    Snapshot,
    SnapshotLayout,
    ages_of,
    readings,
    sensor_messages,
)
from surefoot.schemas.messages import ForceTorque, ImuState, JointState
from surefoot.schemas.sensors import SENSORS, SNAPSHOT_FIELDS, Sensor, sensor
from surefoot.schemas.topics import TICK_SENSORS
from tests.robot_io.sensor_messages import LAYOUT, message, snapshot_at

every_sensor = pytest.mark.parametrize("entry", SENSORS, ids=lambda entry: entry.name)


def test_the_fields_of_a_snapshot_are_those_of_the_table() -> None:
    head, names = fields(Snapshot)[:2], fields(Snapshot)[2:-1]
    assert [field.name for field in head] == ["tick", "stamp_ns"]
    assert fields(Snapshot)[-1].name == "measured_ns"
    assert tuple(field.name for field in names) == SNAPSHOT_FIELDS


def test_split_and_joined_it_is_the_same() -> None:
    snapshot = snapshot_at(3)
    messages = sensor_messages(snapshot, stamp_ns=snapshot.stamp_ns)
    again = LAYOUT.join(3, messages)
    assert (again.tick, again.stamp_ns) == (3, snapshot.stamp_ns)
    for one, other in zip(readings(again), readings(snapshot), strict=True):
        assert np.array_equal(one, other)


def test_messages_carry_what_their_sensor_reads() -> None:
    snapshot = snapshot_at(5)
    messages = dict(
        zip(TICK_SENSORS, sensor_messages(snapshot, stamp_ns=7), strict=True)
    )
    head = {"schema": messages["joints"].schema, "tick": 5, "stamp_ns": 7}
    assert messages["joints"] == JointState(
        **head,
        q=snapshot.q.tolist(),
        dq=snapshot.dq.tolist(),
        effort=snapshot.effort.tolist(),
    )
    assert messages["imu"] == ImuState(
        **head,
        quat_xyzw=snapshot.quat_xyzw.tolist(),
        angular_velocity=snapshot.angular_velocity.tolist(),
        linear_acceleration=snapshot.linear_acceleration.tolist(),
    )
    assert messages["right_ankle_ft"] == ForceTorque(
        **head,
        force=snapshot.ft_right[:3].tolist(),
        moment=snapshot.ft_right[3:].tolist(),
    )


@every_sensor
def test_the_layout_tells_where_each_attribute_is(entry: Sensor) -> None:
    numbers = np.arange(float(LAYOUT.size))
    sent = sensor_messages(LAYOUT.view(0, 0, numbers), stamp_ns=0)
    for name in entry.attributes:
        place = LAYOUT.place(entry, name)
        assert numbers[place].tolist() == getattr(sent[SENSORS.index(entry)], name)


def test_every_number_has_one_place() -> None:
    layout = SnapshotLayout(3)
    parts = [range(*part.indices(layout.size)) for part in layout.places.values()]
    assert [i for part in parts for i in part] == list(range(layout.size))
    assert layout.places["dq"] == slice(3, 6)


def test_ages_are_in_the_order_of_the_table() -> None:
    ticks = range(10, 10 + len(SENSORS))
    messages = [
        message(name, tick) for name, tick in zip(TICK_SENSORS, ticks, strict=True)
    ]
    newest = ticks[-1]
    assert ages_of(messages, newest) == tuple(newest - tick for tick in ticks)


@every_sensor
def test_what_is_missing_keeps_its_last_readings(entry: Sensor) -> None:
    delivery = Delivery()
    before, now = snapshot_at(1), snapshot_at(2)
    delivery.deliver(before, ())
    got, ages = delivery.deliver(now, (entry.name,))
    assert ages == tuple(int(other is entry) for other in SENSORS)
    for field in SNAPSHOT_FIELDS:
        source = before if field in sensor(entry.name).fields else now
        assert np.array_equal(getattr(got, field), getattr(source, field)), field


@pytest.mark.parametrize(("apart_ns", "is_known"), [(2_000_000, True), (10**10, False)])
@pytest.mark.parametrize("sign", [1, -1])
def test_stamps_of_another_clock_tell_no_age(
    apart_ns: int, is_known: bool, sign: int
) -> None:
    stamp_ns = 10**12
    messages = list(sensor_messages(snapshot_at(3), stamp_ns=stamp_ns))
    messages[1] = msgspec.structs.replace(
        messages[1], stamp_ns=stamp_ns + sign * apart_ns
    )
    joined = LAYOUT.join(3, messages)
    assert any(joined.latencies_ns) is is_known
    delivered, _ = Delivery().deliver(
        replace(joined, measured_ns=tuple(m.stamp_ns for m in messages)), ()
    )
    assert any(delivered.latencies_ns) is is_known
