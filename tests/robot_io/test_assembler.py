"""Snapshots from separate messages, over Zenoh on this host."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import fields

import numpy as np
import pytest

from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.bus.channel import Inbox
from surefoot.robot_io.bus.session import Role
from surefoot.robot_io.client_side.assembler import (
    SensorReader,
    SnapshotAssembler,
    SnapshotReading,
)
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.codec import encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.sensors import SENSORS, Sensor
from surefoot.schemas.topics import TICK_SENSORS, topic
from tests.robot_io.sensor_messages import JOINTS, message, snapshot_at
from tests.support import PATIENCE_S, wait_until

SENSOR_PATIENCE_S = 0.02
DEPTH = 64


class Wire:
    """A robot that sends what a test says, and an assembler at the other end."""

    def __init__(self, robot: Bus, peer: Bus, *, in_order: bool) -> None:
        self._publishers = {
            name: robot.publisher(topic(name).key, urgent=True) for name in TICK_SENSORS
        }
        self.peer = peer
        self.sensors = {entry.name: self._reader(entry) for entry in SENSORS}
        self.assembler = SnapshotAssembler(
            list(self.sensors.values()),
            joint_count=JOINTS,
            in_order=in_order,
        )
        for publisher in self._publishers.values():
            wait_until(lambda p=publisher: p.matching_status.matching, what="the peer")
        self._fence = robot.publisher("fence", urgent=True)
        self._fenced = peer.channel("fence", depth=4)
        wait_until(lambda: self._fence.matching_status.matching, what="the fence")

    def send(self, tick: int, *, without: str = "") -> None:
        for name in TICK_SENSORS:
            if name != without:
                self._publishers[name].put(encode(message(name, tick)))

    def send_only(self, name: str, tick: int) -> None:
        self._publishers[name].put(encode(message(name, tick)))

    def send_bytes(self, name: str, data: bytes) -> None:
        self._publishers[name].put(data)

    def all_arrived(self) -> None:
        """Wait until everything sent so far has arrived."""
        self._fence.put(b"fence")
        assert self._fenced.wait(time.monotonic() + PATIENCE_S) == b"fence"

    def read(self) -> SnapshotReading:
        reading = self.assembler.wait(time.monotonic() + PATIENCE_S)
        assert reading is not None
        return reading

    def _reader(self, entry: Sensor) -> SensorReader:
        channel = self.peer.channel(topic(entry.name).key, depth=DEPTH)
        inbox = Inbox(channel, entry.message, joint_count=JOINTS)
        return SensorReader(entry.name, inbox, patience_s=SENSOR_PATIENCE_S)


@pytest.fixture
def make_wire(endpoints: Endpoints) -> Iterator[Callable[..., Wire]]:
    with (
        Bus(endpoints, Role.ROBOT, namespace="walker") as robot,
        Bus(endpoints, Role.CLIENT, namespace="walker") as peer,
    ):
        yield lambda *, in_order: Wire(robot, peer, in_order=in_order)


@pytest.fixture
def ordered(make_wire: Callable[..., Wire]) -> Wire:
    return make_wire(in_order=True)


@pytest.fixture
def newest(make_wire: Callable[..., Wire]) -> Wire:
    return make_wire(in_order=False)


def assert_same(got: Snapshot, expected: Snapshot) -> None:
    for field in fields(Snapshot):
        assert np.array_equal(
            getattr(got, field.name), getattr(expected, field.name)
        ), field.name


def test_every_number_arrives_as_it_was_sent(ordered: Wire) -> None:
    ordered.send(7)
    reading = ordered.read()
    assert_same(reading.snapshot, snapshot_at(7))
    assert reading.stale == ()
    assert reading.ages == (0, 0, 0, 0)


def test_in_order_gives_every_tick_once(ordered: Wire) -> None:
    for tick in range(20):
        ordered.send(tick)
    ordered.all_arrived()
    for tick in range(20):
        assert_same(ordered.read().snapshot, snapshot_at(tick))


def test_newest_skips_what_is_out_of_date(newest: Wire) -> None:
    for tick in range(20):
        newest.send(tick)
    newest.all_arrived()
    assert_same(newest.read().snapshot, snapshot_at(19))
    newest.send(20)
    assert_same(newest.read().snapshot, snapshot_at(20))


def test_overtaken_ticks_are_told_as_far_as_they_are_complete(newest: Wire) -> None:
    newest.send(0)
    assert newest.read().overtaken == ()
    for tick in range(1, 5):
        newest.send(tick, without="imu" if tick == 2 else "")
    newest.all_arrived()
    reading = newest.read()
    assert [snapshot.tick for snapshot in reading.overtaken] == [1, 3]
    for snapshot in reading.overtaken:
        assert_same(snapshot, snapshot_at(snapshot.tick))
    newest.send(5)
    assert newest.read().overtaken == ()


def test_what_came_before_the_first_reading_is_of_no_use(newest: Wire) -> None:
    for begins in (0, 40):  # anew after a restart
        for tick in range(begins, begins + 5):
            newest.send(tick)
        newest.all_arrived()
        reading = newest.read()
        assert (reading.snapshot.tick, reading.overtaken) == (begins + 4, ())
        newest.assembler.restart()


@pytest.mark.parametrize("lost", TICK_SENSORS)
@pytest.mark.parametrize("in_order", [True, False])
def test_a_lost_message_is_replaced_by_the_one_before(
    make_wire: Callable[..., Wire], lost: str, in_order: bool
) -> None:
    wire = make_wire(in_order=in_order)
    wire.send(0)
    assert wire.read().stale == ()
    wire.send(1, without=lost)
    reading = wire.read()
    assert reading.snapshot.tick == 1
    assert reading.stale == (lost,)
    ages = [1 if name == lost else 0 for name in TICK_SENSORS]
    assert list(reading.ages) == ages
    wire.send(2)
    reading = wire.read()
    if reading.stale:  # the first one back may come too late to be waited for
        wire.send(3)
        reading = wire.read()
    assert reading.stale == ()
    assert_same(reading.snapshot, snapshot_at(reading.snapshot.tick))


def test_stale_values_are_the_newest_there_were(ordered: Wire) -> None:
    ordered.send(0)
    ordered.read()
    ordered.send(1, without="left_ankle_ft")
    got = ordered.read().snapshot
    assert np.array_equal(got.ft_left, snapshot_at(0).ft_left)
    assert np.array_equal(got.ft_right, snapshot_at(1).ft_right)


@pytest.mark.parametrize("lost", TICK_SENSORS)
def test_a_dead_sensor_does_not_stop_the_others(newest: Wire, lost: str) -> None:
    newest.send(0)
    newest.read()
    for tick in range(1, 10):
        newest.send(tick, without=lost)
        reading = newest.read()
        assert reading.snapshot.tick == tick
        assert reading.stale == (lost,)
        assert max(reading.ages) == tick


def test_a_sensor_that_was_dead_is_waited_for_again(ordered: Wire) -> None:
    ordered.send(0)
    ordered.read()
    for tick in (1, 2, 3):
        ordered.send(tick, without="right_ankle_ft")
        assert ordered.read().stale == ("right_ankle_ft",)
    for tick in (4, 5):
        ordered.send(tick)
        ordered.all_arrived()
        assert ordered.read().snapshot.tick == tick
    ordered.send(6, without="right_ankle_ft")
    late = threading.Timer(
        SENSOR_PATIENCE_S / 4, ordered.send_only, ("right_ankle_ft", 6)
    )
    late.start()
    reading = ordered.read()
    late.join()
    assert reading.stale == ()
    assert_same(reading.snapshot, snapshot_at(6))


def test_a_message_lost_for_good_shows_when_the_next_one_comes(ordered: Wire) -> None:
    ordered.send(0)
    ordered.send(1, without="imu")
    ordered.send(2)
    ordered.all_arrived()
    stale = [ordered.read().stale for _ in range(3)]
    assert stale == [(), ("imu",), ()]
    assert not ordered.sensors["imu"].is_lost


def test_duplicates_are_dropped_and_counted(ordered: Wire) -> None:
    for tick in (0, 0, 1, 1, 1, 2):
        ordered.send(tick)
    ordered.all_arrived()
    assert [ordered.read().snapshot.tick for _ in range(3)] == [0, 1, 2]
    for sensor in ordered.sensors.values():
        assert sensor.inbox.outdated == 3


def test_messages_out_of_order_never_turn_time_back(ordered: Wire) -> None:
    ordered.send(5)
    ordered.read()
    for tick in (3, 6, 4, 7):
        ordered.send(tick)
    ordered.all_arrived()
    assert [ordered.read().snapshot.tick for _ in range(2)] == [6, 7]
    assert ordered.sensors["right_ankle_ft"].inbox.outdated == 2


@pytest.mark.parametrize(
    "data",
    [b"", b"\x00", b"garbage, surely", encode(message("imu", 1))[:-1]],
    ids=["empty", "a number", "text", "truncated"],
)
def test_unreadable_messages_are_counted_and_the_tick_goes_on(
    ordered: Wire, data: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    ordered.send(0)
    ordered.read()
    for tick in (1, 2):
        ordered.send_bytes("imu", data)
        ordered.send(tick, without="imu")
        assert ordered.read().stale == ("imu",)
    assert ordered.sensors["imu"].inbox.malformed == 2
    assert ["ImuState" in said for said in caplog.messages] == [True]  # told once


def test_random_losses_leave_ages_right_and_time_going_forward(newest: Wire) -> None:
    rng = np.random.default_rng(3)
    sent = dict.fromkeys(TICK_SENSORS, 0)
    newest.send(0)
    newest.read()
    for tick in range(1, 60):
        lost = str(rng.choice([*TICK_SENSORS, "", "", ""]))
        newest.send(tick, without=lost)
        newest.all_arrived()
        sent.update({name: tick for name in TICK_SENSORS if name != lost})
        reading = newest.read()
        assert reading.snapshot.tick == tick
        ages = [tick - sent[name] for name in TICK_SENSORS]
        assert list(reading.ages) == ages
        assert reading.stale == tuple(
            name for name, age in zip(TICK_SENSORS, ages, strict=True) if age
        )


def test_nothing_is_assembled_before_every_sensor_has_spoken(ordered: Wire) -> None:
    ordered.send(0, without="imu")
    ordered.all_arrived()
    assert ordered.assembler.wait(time.monotonic() + 5 * SENSOR_PATIENCE_S) is None
    assert ordered.assembler.missing() == ("imu",)


def test_a_nudge_ends_the_wait(ordered: Wire) -> None:
    ordered.peer.waker.interrupt()
    begin = time.monotonic()
    assert ordered.assembler.wait(begin + PATIENCE_S) is None
    assert time.monotonic() < begin + PATIENCE_S


def test_after_a_restart_ticks_may_begin_anew(ordered: Wire) -> None:
    ordered.send(100)
    ordered.read()
    ordered.assembler.restart()
    ordered.send(0)
    assert ordered.read().snapshot.tick == 0
