"""A record's messages in the order of ticks; joined to readings, or played on a bus."""

from __future__ import annotations

import contextlib
import math
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
from mcap.records import Message as RecordedMessage

from surefoot.errors import UsageError
from surefoot.recording.contents import ROBOT_JSON, ROBOT_TOML, ROBOT_URDF
from surefoot.recording.read import (
    Record,
    Rounds,
    decode_json,
    read_record,
    with_nan,
)
from surefoot.robot_io.bus.channel import NEVER
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot import Robot, load_robot, make_robot
from surefoot.robot_io.snapshot import Ages, Snapshot, SnapshotLayout, ages_of
from surefoot.run_folder import record_of_run
from surefoot.schemas.codec import decode
from surefoot.schemas.errors import MessageError
from surefoot.schemas.messages import Message
from surefoot.schemas.robot_file import RobotFile
from surefoot.schemas.topics import (
    ALL_CHANNELS,
    TICK_SENSORS,
    TOPICS,
    Direction,
    topic,
)

if TYPE_CHECKING:
    from surefoot.robot_io.robot_side.replay_server import ReplayServer

PLANNERS = tuple(
    entry.name for entry in TOPICS if entry.direction is Direction.TO_STABILIZER
)
"""Channels of planners, which need not count the robot's ticks."""
_NULL = b"null"
_RANKS = {
    name: rank
    for rank, name in enumerate(
        (*TICK_SENSORS, *(name for name in ALL_CHANNELS if name not in TICK_SENSORS))
    )
}
LONGEST_NAP_S = 0.05
"""Longest sleep of a slow replay before it checks for a stop [s]."""
SHORTEST_NAP_S = 0.0005
"""Shorter waits are skipped; the next one makes up for them [s]."""
LARGEST_LAG_S = 0.1
"""A replay that lags by more does not catch up the rest [s]."""


class Entry(NamedTuple):
    """One message of the record.

    Attributes:
        round: number of the robot's restarts before it.
        tick: the robot's tick that it belongs to.
        stamp_ns: stamp by its sender's clock [ns].
        rank: order of its channel within a tick.
        place: position in the file.
        channel: name in the topic table.
        data: bytes as recorded.
    """

    round: int
    tick: int
    stamp_ns: int
    rank: int
    place: int
    channel: str
    data: bytes


@dataclass(frozen=True)
class Timeline:
    """A record in order.

    Attributes:
        record: the record with its attachments.
        entries: messages ordered by round, tick and stamp. Ticks are common to robot
            and stabilizer; their clocks may differ.
        first_tick: first tick of the sensors.
        last_tick: last tick of the sensors in the last round.
    """

    record: Record
    entries: list[Entry]
    first_tick: int
    last_tick: int


def read_timeline(path: Path) -> Timeline:
    """Read a record, or that of a run's folder, into memory, and put it in order.

    The recorder writes in batches, channel by channel, so the order of the file is not
    that of the bus.

    Raises:
        UsageError: it cannot be read, or holds no sensor messages.
    """
    path = record_of_run(path)
    collector = _Collector()
    record = read_record(path, collector.take)
    collector.leave_out(
        name for name in record.channels if not record.is_readable(name)
    )
    entries = sorted(collector.entries, key=_ORDER)
    ticks = [entry.tick for entry in entries if entry.channel in TICK_SENSORS]
    if not ticks:
        there = ", ".join(record.channels) or "none"
        raise UsageError(
            f"{path}: holds no messages of a robot's sensors in JSON or MessagePack "
            f"(channels: {there}); there is nothing to play"
        )
    return Timeline(record, entries, ticks[0], ticks[-1])


_ORDER = attrgetter("round", "tick", "stamp_ns", "rank", "place")


class _Collector:
    """Collects messages in the order of the file."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []
        self._rounds = Rounds()
        self._place = 0

    def take(self, channel: str, message: RecordedMessage) -> None:
        self._place += 1
        if channel not in _RANKS:
            return  # a channel of another program
        tick = message.sequence
        if channel in PLANNERS:  # belongs to the tick at which it came
            tick = self._rounds.now or 0
        self.entries.append(
            Entry(
                self._rounds.of(channel, tick),
                tick,
                message.publish_time,  # the sender's stamp, also in simulated time
                _RANKS[channel],
                self._place,
                channel,
                message.data,
            )
        )

    def leave_out(self, channels: Iterable[str]) -> None:
        """Remove channels whose encoding we cannot read."""
        gone = set(channels)
        self.entries = [entry for entry in self.entries if entry.channel not in gone]


@contextmanager
def recorded_robot(record: Record, instead: str | None) -> Iterator[Robot]:
    """Provide the robot that is attached to a record, with its servo profile.

    Its URDF is in a temporary folder while the context lasts.

    Args:
        record: the record.
        instead: name or path of a robot to use instead; None for the recorded one.

    Raises:
        UsageError: no robot is attached, or it cannot be read.
        RobotFileError: the attached files contradict each other.
    """
    if instead is not None:
        yield load_robot(instead)
        return
    files = record.attachments
    if ROBOT_JSON not in files or ROBOT_URDF not in files:
        raise UsageError(
            f"{record.path}: no {ROBOT_JSON} and {ROBOT_URDF} attached to this record; "
            "name the robot with --robot"
        )
    try:
        file = msgspec.json.decode(files[ROBOT_JSON], type=RobotFile)
    except (ValueError, RecursionError) as error:
        raise UsageError(
            f"{record.path}: the attached {ROBOT_JSON} does not fit this version "
            f"({error}); name the robot with --robot"
        ) from error
    with tempfile.TemporaryDirectory(prefix="surefoot-replay-") as name:
        urdf = Path(name) / ROBOT_URDF
        urdf.write_bytes(files[ROBOT_URDF])
        yield make_robot(file, path=Path(name) / ROBOT_TOML, urdf_path=urdf)


def to_wire(data: bytes, *, is_raw: bool) -> bytes:
    """Return the MessagePack bytes of a message.

    JSON has neither NaN nor infinity. Both are null in a JSON record and become NaN
    again. All other numbers are restored bit for bit.

    Raises:
        MessageError: the bytes are no message.
    """
    if is_raw:
        return data
    message = decode_json(data)
    if _NULL in data:
        message = {name: with_nan(value) for name, value in message.items()}
    try:
        return msgspec.msgpack.encode(message)
    except (OverflowError, ValueError, RecursionError) as error:
        raise MessageError(f"not a message of the bus: {error}") from error


class Reading(NamedTuple):
    """A snapshot, and the age of each sensor's message in ticks.

    Attributes:
        snapshot: sensors of one tick.
        ages: ticks since each sensor's message, in the order of the sensor table.
        overtaken: complete snapshots of the ticks since the last reading.
    """

    snapshot: Snapshot
    ages: Ages
    overtaken: tuple[Snapshot, ...]


class RecordedSensors:
    """Joins recorded messages to snapshots by the rules of the bus.

    An unreadable message counts as missing. A sensor without a message for a tick keeps
    its last values.
    """

    def __init__(
        self, entries: Iterable[Entry], *, joint_count: int, raw: dict[str, bool]
    ) -> None:
        """Start before the first tick."""
        self._raw, self._joint_count = raw, joint_count
        self._layout = SnapshotLayout(joint_count)
        self._entries: dict[str, list[Entry]] = {name: [] for name in TICK_SENSORS}
        for entry in entries:
            if entry.channel in self._entries:
                self._entries[entry.channel].append(entry)
        self._next = dict.fromkeys(TICK_SENSORS, 0)
        self._latest: dict[str, Any] = dict.fromkeys(TICK_SENSORS)
        self._passed: dict[str, list[Any]] = {name: [] for name in TICK_SENSORS}
        self._tick = NEVER

    def at(self, tick: int) -> Reading | None:
        """Return the stabilizer's reading of a tick; ticks must not decrease.

        Returns:
            None until each sensor has a message.
        """
        for name in TICK_SENSORS:
            self._advance(name, tick)
        messages = [m for m in self._latest.values() if m is not None]
        passed = [self._passed[name] for name in TICK_SENSORS]
        overtaken = self._layout.join_passed(passed, after=self._tick, before=tick)
        self._tick = tick
        for said in passed:
            said.clear()
        if len(messages) < len(TICK_SENSORS):
            return None
        snapshot = self._layout.join(tick, messages)
        return Reading(snapshot, ages_of(messages, tick), overtaken)

    def _advance(self, name: str, tick: int) -> None:
        """Read the messages of a sensor up to a tick."""
        entries = self._entries[name]
        while self._next[name] < len(entries):
            entry = entries[self._next[name]]
            if entry.tick > tick:
                return
            self._next[name] += 1
            message = self._read(name, entry)
            before = self._latest[name]
            if message is not None and (before is None or message.tick > before.tick):
                self._latest[name] = message
                self._passed[name].append(message)

    def _read(self, name: str, entry: Entry) -> Message | None:
        kind: type[Any] = topic(name).message
        try:
            message: Message = decode(
                to_wire(entry.data, is_raw=self._raw[name]),
                kind,
                joint_count=self._joint_count,
            )
        except MessageError:
            return None
        return message


def between(
    timeline: Timeline, *, period_s: float, from_s: float, until_s: float | None
) -> list[Entry]:
    """Return the messages of a span; both ends count from the first tick on [s].

    The time of a robot that began anew goes on behind its former one.
    """
    offsets: dict[int, int] = {}
    passed = 0
    for lap, said in groupby(timeline.entries, key=attrgetter("round")):
        ticks = [entry.tick for entry in said if entry.channel in TICK_SENSORS]
        if ticks:
            offsets[lap] = passed - ticks[0]
            passed += ticks[-1] + 1 - ticks[0]
    begin = round(from_s / period_s)
    end = math.inf if until_s is None else round(until_s / period_s)
    return [
        entry
        for entry in timeline.entries
        if begin <= entry.tick + offsets.get(entry.round, 0) < end
    ]


def play(
    entries: Iterable[Entry],
    server: ReplayServer,
    *,
    raw: Callable[[str], bool],
    tick_s: float,
    stop: StopRequest,
    on_tick: Callable[[int], None],
) -> dict[str, int]:
    """Publish messages tick by tick, in real time.

    Unreadable messages are skipped.

    Args:
        entries: messages in order.
        server: publishes them.
        raw: tells whether a channel holds MessagePack.
        tick_s: time of a tick [s]; longer than the period for a slow replay.
        stop: ends the replay.
        on_tick: called with each tick.

    Returns:
        Number of published messages by channel.
    """
    counts: dict[str, int] = {}
    for tick, said in _paced(entries, tick_s=tick_s, stop=stop):
        on_tick(tick)
        # Encode all first, so that the messages of a tick are published together.
        ready = []
        for entry in said:
            with contextlib.suppress(MessageError):
                data = to_wire(entry.data, is_raw=raw(entry.channel))
                ready.append((entry.channel, data))
        for channel, data in ready:
            server.publish(channel, data)
            counts[channel] = counts.get(channel, 0) + 1
    return counts


def _paced(
    entries: Iterable[Entry], *, tick_s: float, stop: StopRequest
) -> Iterator[tuple[int, list[Entry]]]:
    """Yield each tick with its messages when it is due, until asked to stop."""
    before: tuple[int, int] | None = None
    due_s = time.monotonic()
    for (lap, tick), said in groupby(entries, key=lambda e: (e.round, e.tick)):
        if before is not None and before[0] == lap:
            due_s += (tick - before[1]) * tick_s
        before = (lap, tick)
        while (ahead_s := due_s - time.monotonic()) > SHORTEST_NAP_S:
            if stop.is_set:
                return
            # The record's pace, in short sleeps so that a stop takes effect soon.
            time.sleep(min(ahead_s, LONGEST_NAP_S))
        if stop.is_set:
            return
        due_s = max(due_s, time.monotonic() - LARGEST_LAG_S)
        yield tick, list(said)
