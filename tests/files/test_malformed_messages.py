"""Foreign messages stop no listener, and recorders keep them."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import Counter
from functools import partial
from pathlib import Path

import msgpack
import pytest
from mcap.reader import make_reader

from surefoot.cli.bus_messages import Echo, TimingMeter
from surefoot.cli.bus_topics import list_topics
from surefoot.playback.timeline import between, read_timeline
from surefoot.recording.read import LARGEST_GAP, read_record, record_info
from surefoot.recording.write import LogTimes, McapFile
from surefoot.robot_io.client_side.client import RobotClient
from surefoot.robot_io.client_side.listener import Listener, RawMessage
from surefoot.robot_io.client_side.observer import (
    ALL_CHANNELS,
    VIEWER_CHANNELS,
    Observer,
    Sample,
)
from surefoot.robot_io.errors import RobotIoError
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.relay.lane import Lane
from surefoot.robot_io.relay.relay import find_plan, list_plans
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.codec import Head, decode, decode_head, decode_map
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.errors import MessageError
from surefoot.schemas.relay_plan import load_relay_plan
from surefoot.schemas.topics import TICK_SENSORS, TOPICS, topic
from tests.cli.bus.talking_robot import Say, talking_robot
from tests.files.commands import run_here
from tests.files.malformed import many
from tests.support import free_port, wait_until

WALKER = load_robot("walker")
COUNTS = [50, pytest.param(1000, marks=pytest.mark.slow)]


@pytest.mark.parametrize("count", [500, pytest.param(20_000, marks=pytest.mark.slow)])
def test_decoding_gives_a_message_or_says_why_not(count: int) -> None:
    refused = Counter()
    for name, data in many(count, joint_count=WALKER.n_a):
        in_full = partial(decode, kind=topic(name).message, joint_count=WALKER.n_a)
        for read in (decode_map, decode_head, in_full):
            try:
                read(data)
            except MessageError:
                refused[name] += 1
    assert sum(refused.values()) > count


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("raw", [False, True], ids=["json", "raw"])
@pytest.mark.parametrize("period_ns", [None, 10**6], ids=["stamps", "simulated"])
def test_the_recorder_keeps_every_message(
    count: int, raw: bool, period_ns: int | None, tmp_path: Path
) -> None:
    path = tmp_path / "odd.mcap"
    sent = many(count, joint_count=WALKER.n_a)
    file = McapFile(
        path,
        channels=ALL_CHANNELS,
        keys=WALKER.keys,
        attachments=[],
        raw=raw,
        times=LogTimes(period_ns),
    )
    with file:
        file.add(Sample(name, data, 5) for name, data in sent)
    kept: Counter[str] = Counter()
    apart = []
    with path.open("rb") as opened:  # by the MCAP project's own reader
        for _, channel, message in make_reader(opened).iter_messages():
            kept[channel.topic.split("/")[1]] += 1
            if channel.topic.endswith("/unreadable"):
                apart.append(message.data)
    assert kept == Counter(name for name, _ in sent)
    unreadable = {name: one.unreadable for name, one in file.counts.items()}
    assert len(apart) == sum(unreadable.values()) > count / 10
    assert not Counter(apart) - Counter(data for _, data in sent)
    info = record_info(read_record(path))
    assert sum(one.messages for one in info.channels) == count
    assert all(one.missing < LARGEST_GAP * count for one in info.channels)
    for words in (("log", "info", path), ("replay", "--controller", path)):
        assert run_here(*words).code in (0, 2)
    with contextlib.suppress(ValueError):
        read_timeline(path)


def test_in_simulated_time_a_run_spans_what_it_simulated() -> None:
    times = LogTimes(10**6)
    span = [times.of("joints", Head(tick, 7 * tick)) for tick in range(8000)]
    assert span[-1] - span[0] == 7999 * 10**6
    # A robot that begins anew goes on behind itself, on every channel alike.
    again = [times.of("joints", Head(tick, 0)) for tick in range(10)]
    assert again == [8000 * 10**6 + tick * 10**6 for tick in range(10)]
    times.of("imu", Head(7999, 0))
    assert times.of("imu", Head(3, 0)) == again[3]
    # A planner's count and a foreign tick tell nothing of the time.
    assert times.of("reference", Head(0, 0)) == times.latest
    assert times.of("joints", Head(2**60, 0)) == times.latest
    assert times.of("joints", Head(10, 0)) == again[9] + 10**6


def test_a_recorder_that_joins_late_tells_simulated_time() -> None:
    times = LogTimes(10**6)
    late = 3 * LARGEST_GAP
    span = [times.of("joints", Head(late + tick, 0)) for tick in range(3)]
    assert span == [(late + tick) * 10**6 for tick in range(3)]
    # Two messages in a row beyond a gap are the robot's again, one is not.
    assert times.of("joints", Head(9 * late, 0)) == times.latest == span[-1]
    assert times.of("joints", Head(9 * late + 1, 0)) == (9 * late + 1) * 10**6


def test_who_first_speaks_to_a_robot_that_began_anew_belongs_to_that_run() -> None:
    times = LogTimes(10**6)
    for tick in range(2000):
        times.of("joints", Head(tick, 0))
    for tick in range(5001):
        now = times.of("joints", Head(tick, 0))
    assert times.of("joint_command", Head(5000, 0)) == now == 7000 * 10**6


def new_file(folder: Path) -> McapFile:
    return McapFile(
        folder / "a.mcap",
        channels=ALL_CHANNELS,
        keys=WALKER.keys,
        attachments=[],
        raw=False,
    )


def test_only_its_sensors_tell_that_a_robot_began_anew(tmp_path: Path) -> None:
    file = new_file(tmp_path)

    def heard(name: str, *ticks: int) -> None:
        for tick in ticks:
            message = {"tick": tick, "stamp_ns": 0, "commander": "ann", "sequence": 0}
            file.add([Sample(name, msgpack.packb(message), 0)])

    with file:
        heard("joints", 20, 21, 22)
        heard("imu", 20, 21)
        heard("joints", 0, 1)
        heard("imu", 22, 0, 1)  # the last one came behind
        heard("status", 22, 0)
        heard("joints", *range(2, 9))
        heard("joint_command", 8, 4)  # the late one of a stabilizer that froze
        heard("joints", 9)
        heard("joint_command", 9)
    rounds: dict[str, list[tuple[int, int]]] = {}
    timeline = read_timeline(file.path)
    for entry in timeline.entries:
        rounds.setdefault(entry.channel, []).append((entry.round, entry.tick))
    assert rounds == {
        "joints": [(0, 20), (0, 21), (0, 22), *((1, tick) for tick in range(10))],
        "imu": [(0, 20), (0, 21), (0, 22), (1, 0), (1, 1)],
        "status": [(0, 22), (1, 0)],
        "joint_command": [(1, 4), (1, 8), (1, 9)],
    }
    # A replay counts the time of both, one behind the other.
    for span, ends in (
        ((0, None), ((0, 20), (1, 9))),
        ((2, 5), ((0, 22), (1, 1))),
        ((5, None), ((1, 2), (1, 9))),
    ):
        played = between(timeline, period_s=1.0, from_s=span[0], until_s=span[1])
        first, last = played[0], played[-1]
        assert ((first.round, first.tick), (last.round, last.tick)) == ends


def test_a_foreign_tick_is_not_a_million_missing_messages(tmp_path: Path) -> None:
    file = new_file(tmp_path)
    with file:
        for tick in (0, 1, 2**60, 2, 3, 7):
            data = msgpack.packb({"tick": tick, "stamp_ns": tick})
            file.add([Sample("joints", data, 0)])
    count = file.counts["joints"]
    assert (count.messages, count.missing, count.restarts) == (6, 3, 2)


@pytest.mark.parametrize("count", COUNTS)
def test_tools_of_the_bus_take_everything(count: int) -> None:
    heard = []
    for name, data in many(count, joint_count=WALKER.n_a):
        key = f"{WALKER.file.namespace}/{WALKER.keys[name]}"
        heard.append(RawMessage(key, data, len(heard)))
        meter = TimingMeter(name, every_tick=True, window_s=1.0, has_delay=True)
        meter.add(data, received_ns=1)
        meter.timing(2)
        for as_json in (False, True):
            shown = Echo(
                topic(name),
                joint_count=WALKER.n_a,
                fields=[],
                rate_hz=None,
                as_json=as_json,
            )
            assert shown.lines(heard[-1])

    class Nobody:
        processes = publishers = subscribers = services = ()
        is_told = False

    told = list_topics(WALKER, heard, Nobody(), listened_s=1.0)
    assert sum(row.messages for row in told.channels) == count


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("plan", list_plans())
def test_the_relay_passes_everything_on(plan: str, count: int) -> None:
    """Or loses it as its plan says; never its own thread."""
    loaded = load_relay_plan(find_plan(plan))
    for number, (name, data) in enumerate(many(count, joint_count=WALKER.n_a)):
        lane = Lane(loaded, name, seed=number)
        left = lane.pass_on(data, now_s=1.0, elapsed_s=1.0)
        touched = list(loaded.faults_of(name))
        assert touched or [parcel.data for parcel in left] == [data]


@pytest.mark.parametrize("count", COUNTS)
def test_everyone_who_listens_goes_on(count: int, endpoints: Endpoints) -> None:
    """A viewer, an observer, a tool of the bus and a stabilizer's client."""
    pytest.importorskip("viser", reason="needs viser: pip install -e .[view]")
    from surefoot.view.page import LivePage

    sent = many(count, joint_count=WALKER.n_a)
    rounds = 0

    def say(number: int, tell: Say) -> None:
        nonlocal rounds
        name, data = sent[number % count]
        tell(WALKER.keys[name], data)
        rounds = number // count

    failures: list[BaseException] = []

    def watched(work: object) -> threading.Thread:
        def run() -> None:
            try:
                work()  # type: ignore[operator]
            except BaseException as error:
                failures.append(error)

        thread = threading.Thread(target=run)
        thread.start()
        return thread

    stop = StopRequest()
    with talking_robot(endpoints, say):
        page = LivePage(WALKER, endpoints=endpoints, port=free_port())
        threads = [watched(lambda: page.run(stop))]
        client = RobotClient(
            WALKER, endpoints=endpoints, identity="ann", in_order=False, stop=stop
        )
        observer = Observer(
            WALKER, endpoints=endpoints, channels=VIEWER_CHANNELS, depth=1000
        )
        listener = Listener(WALKER, endpoints=endpoints, patterns=["**"])
        with client, observer, listener:
            assert client.connect(timeout_s=20.0)
            observer.connect(timeout_s=20.0)
            listener.connect(timeout_s=20.0)
            with contextlib.suppress(RobotIoError, MessageError):
                client.take_lease()  # nobody answers
            begin, heard = rounds, set()
            end = time.monotonic() + 60.0
            while rounds < begin + 2 and time.monotonic() < end:
                client.wait_snapshot(timeout_s=0.01)
                observer.latest_messages()
                heard |= {(m.key, m.data) for m in listener.take(timeout_s=0.01)}
        wait_until(lambda: rounds >= begin + 2, what="every message to be said twice")
        stop.set()
        for thread in threads:
            thread.join(20.0)
    assert not failures, failures
    wanted = {(f"walker/{WALKER.keys[name]}", data) for name, data in sent}
    assert len(wanted - heard) < len(wanted) / 5


def test_every_kind_of_message_is_among_the_malformed() -> None:
    names = {name for name, _ in many(100, joint_count=WALKER.n_a)}
    assert names == set(ALL_CHANNELS)
    assert set(TICK_SENSORS) < names <= {entry.name for entry in TOPICS}
