"""The messages of a record in the order of the robot's ticks."""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from mcap.records import Message

from cli.errors import UsageError
from cli.recording.read_record import Record, read_record
from schemas.topics import TICK_SENSORS, TOPICS, Direction

REFERENCE = "reference"
PLAYABLE = tuple(
    entry.name
    for entry in TOPICS
    if entry.direction not in (Direction.SERVICE, Direction.STABILIZER_SERVICE)
)
"""Channels that carry messages; services are asked and leave none."""
_RANKS = {
    name: rank
    for rank, name in enumerate(
        (*TICK_SENSORS, *(name for name in PLAYABLE if name not in TICK_SENSORS))
    )
}


class Entry(NamedTuple):
    """A message of the record.

    Attributes:
        round: 0, and one more each time the robot's ticks began anew.
        tick: the robot's tick it belongs to.
        stamp_ns: clock of its sender [ns].
        rank: of its channel within a tick.
        place: in the file.
        channel: its name in the topic table.
        data: as recorded.
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
        record: attachments, and whether it is cut off.
        entries: messages in the order of round, tick and stamp. Ticks are what robot
            and stabilizer have in common; their clocks may differ.
        first_tick: of the sensors.
        last_tick: of the last round.
    """

    record: Record
    entries: list[Entry]
    first_tick: int
    last_tick: int


def read_timeline(path: Path) -> Timeline:
    """Reads a record into memory and brings it in order.

    The recorder writes what came in a moment channel by channel, so the order of the
    file is not that of the bus.

    Raises:
        UsageError: it cannot be read, or holds no sensor messages.
    """
    collector = _Collector()
    record = read_record(path, collector.take)
    entries = sorted(collector.entries, key=_ORDER)
    ticks = [entry.tick for entry in entries if entry.channel in TICK_SENSORS]
    if not ticks:
        raise UsageError(f"{path}: holds no sensor messages; there is nothing to play")
    return Timeline(record, entries, ticks[0], ticks[-1])


_ORDER = attrgetter("round", "tick", "stamp_ns", "rank", "place")


class _Collector:
    """Takes messages in the order of the file."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []
        self._rounds = dict.fromkeys(PLAYABLE, 0)
        self._ticks = dict.fromkeys(PLAYABLE, 0)
        self._place = 0

    def take(self, channel: str, message: Message) -> None:
        self._place += 1
        if channel not in _RANKS:
            return
        tick = message.sequence
        if channel == REFERENCE:
            # A planner need not count the robot's ticks: what counts is when it came.
            tick = max(self._ticks[name] for name in TICK_SENSORS)
        if tick < self._ticks[channel]:
            self._rounds[channel] += 1
        self._ticks[channel] = tick
        self.entries.append(
            Entry(
                self._rounds[channel],
                tick,
                message.log_time,
                _RANKS[channel],
                self._place,
                channel,
                message.data,
            )
        )
