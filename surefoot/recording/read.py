"""Reads records, and counts what they hold and what is missing."""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
from mcap.records import Attachment, Channel, Message

from surefoot.recording.mcap_records import Damage, McapRecords, RecordError
from surefoot.schemas.codec import Head, decode_map
from surefoot.schemas.errors import MessageError
from surefoot.schemas.messages import Count
from surefoot.schemas.topics import COMMAND, TICK_SENSORS, TOPICS

LARGEST_GAP = 1_000_000
"""Larger jumps of a number come from another sender: 17 minutes at 1 kHz."""
_OURS = frozenset(entry.name for entry in TOPICS)
MSGPACK, JSON = "msgpack", "json"
TOLD_DAMAGES = 3
KEPT_BYTES = 256 * 2**20
"""Size above which a record's messages are not kept but read again when asked for."""


class Rounds:
    """Tells a robot's runs in a record apart: with each its ticks begin anew.

    Only its sensors begin a round; other messages follow. A recorder writes channel by
    channel, so the last messages of a round may come behind the first ones of the next:
    their ticks are nearer to its end.

    Attributes:
        now: latest tick of the sensors in the newest round; None before the first.
    """

    def __init__(self, *, late_ticks: int = 0) -> None:
        """Start before the first round.

        Args:
            late_ticks: a tick this far behind still belongs to a late message.
        """
        self.now: int | None = None
        self._end = 0
        self._late_ticks = late_ticks
        self._newest = 0
        self._of: dict[str, int] = {}
        self._ticks: dict[str, int] = {}

    def of(self, channel: str, tick: int) -> int:
        """Return the number of a message's round, from 0 on."""
        mine, now = self._of.get(channel, 0), self.now or 0
        is_sensor, before = channel in TICK_SENSORS, self._ticks.get(channel)
        if is_sensor and before is not None:
            mine += tick < before - self._late_ticks
        elif now >= self._end or 2 * tick <= now + self._end:
            mine = self._newest
        if is_sensor and mine > self._newest:
            self._newest, self._end, self.now = mine, now, tick
        elif is_sensor and mine == self._newest:
            self.now = max(tick, now)
        self._of[channel], self._ticks[channel] = mine, tick
        return mine


class _CommandHead(Head, frozen=True):
    commander: str
    sequence: Count


class ChannelCount(msgspec.Struct, kw_only=True):
    """Statistics of a channel's messages.

    ``first`` and ``last`` are ticks, or sequence numbers for commands. On channels that
    do not publish every tick, missing messages cannot be counted.
    """

    channel: str
    counted_by: str
    """``tick``, ``sequence``, or empty for a channel without a fixed rate."""
    messages: int = 0
    first: int | None = None
    last: int | None = None
    missing: int = 0
    """Numbers missing between the first message and the last."""
    gaps: int = 0
    """Places at which numbers are missing."""
    commander: str = ""
    """Sender of the latest command."""
    restarts: int = 0
    """Times that the numbers began anew: another robot or commander."""
    unreadable: int = 0
    """Messages that do not fit the channel.

    Our own recorder keeps them as bytes on a channel beside.
    """
    encoding: str = ""
    """Encoding of the messages, if we cannot read it; otherwise empty."""

    def add(self, number: int, *, is_new_sender: bool = False) -> None:
        """Count one message by its tick or sequence number."""
        self.messages += 1
        last, self.last = self.last, number
        if last is None:
            self.first = number
        elif not self.counted_by:
            return
        elif is_new_sender or number <= last or number - last > LARGEST_GAP:
            self.restarts += 1
        elif number > last + 1:
            self.missing += number - last - 1
            self.gaps += 1


def new_count(channel: str) -> ChannelCount:
    """Return an empty count for a channel, by tick, by sequence or by neither."""
    if channel == COMMAND:
        return ChannelCount(channel=channel, counted_by="sequence")
    by = "tick" if channel in TICK_SENSORS else ""
    return ChannelCount(channel=channel, counted_by=by)


def count_message(count: ChannelCount, message: dict[str, Any]) -> Head | None:
    """Count a decoded message of the channel.

    Returns:
        Its tick and stamp; None for a channel of another program.

    Raises:
        MessageError: it lacks its head; it is not counted.
    """
    if count.channel not in _OURS:
        count.messages += 1
        return None
    is_command = count.channel == COMMAND
    try:
        head = msgspec.convert(message, _CommandHead if is_command else Head)
    except msgspec.ValidationError as error:
        raise MessageError(f"{count.channel}: {error}") from error
    if isinstance(head, _CommandHead):
        is_new, count.commander = head.commander != count.commander, head.commander
        count.add(head.sequence, is_new_sender=is_new)
    else:
        count.add(head.tick)
    return head


@dataclass
class Record:
    """A record as read from its file.

    Messages of a small record are kept in memory. Those of a large one are read again
    when asked for, since an hour of a bus is ten gigabytes.

    Attributes:
        path: path of the file.
        is_cut_off: whether the file lacks its end; all complete messages were read.
        damage: places that could not be read.
        attachments: content of each attached file, by name.
        first_ns: earliest log time of a message [ns]; None without messages.
        last_ns: latest log time of a message [ns]; None without messages.
    """

    path: Path
    is_cut_off: bool = False
    damage: list[Damage] = field(default_factory=list)
    attachments: dict[str, bytes] = field(default_factory=dict)
    first_ns: int | None = None
    last_ns: int | None = None
    _sizes: dict[str, int] = field(default_factory=dict)
    _kept: dict[str, list[bytes]] | None = field(default_factory=dict)
    _kept_bytes: int = 0
    _encodings: dict[str, str] = field(default_factory=dict)

    @property
    def channels(self) -> list[str]:
        """Names of all channels, including those without messages."""
        return list(self._sizes)

    @property
    def condition(self) -> str:
        """Whether the record is whole, cut off or damaged, and where; in words."""
        cut = (
            "cut off; all complete messages are counted" if self.is_cut_off else "whole"
        )
        if not self.damage:
            return cut
        told = "; ".join(map(str, self.damage[:TOLD_DAMAGES]))
        more = len(self.damage) - TOLD_DAMAGES
        also = f"; and {more} more" if more > 0 else ""
        return f"{cut if self.is_cut_off else 'damaged'} ({told}{also})"

    def encoding(self, channel: str) -> str:
        """Return the encoding of a channel's messages: ``json``, ``msgpack``, ..."""
        return self._encodings[channel]

    def is_readable(self, channel: str) -> bool:
        """Return whether we can read a channel's encoding."""
        return self.encoding(channel) in (MSGPACK, JSON)

    def is_raw(self, channel: str) -> bool:
        """Return whether a channel holds MessagePack as on the bus, and not JSON."""
        return self.encoding(channel) == MSGPACK

    def size(self, channel: str) -> int:
        """Return the number of a channel's messages, including unreadable ones."""
        return self._sizes[channel]

    def messages(self, channel: str) -> list[dict[str, Any]]:
        """Return the readable messages of a channel, in the order of the file."""
        return list(self.each(channel))

    def each(self, channel: str) -> Iterator[dict[str, Any]]:
        """Yield the readable messages of a channel, in the order of the file."""
        if not self.is_readable(channel):
            return
        decode = decode_map if self.is_raw(channel) else decode_json
        for _, data in self.stream(channel):
            try:
                yield decode(data)
            except MessageError:
                continue

    def stream(self, channel: str | None = None) -> Iterator[tuple[str, bytes]]:
        """Yield channel and bytes of all messages, each channel in the file's order."""
        if self._kept is None:
            again = Record(self.path)
            for name, message in _read(McapRecords(self.path), again, Counter()):
                if channel in (None, name):
                    yield name, message.data
            return
        for name in self._kept if channel is None else [channel]:
            for data in self._kept[name]:
                yield name, data


def decode_json(data: bytes) -> dict[str, Any]:
    """Decode the JSON object of a message.

    Raises:
        MessageError: it is not a JSON object.
    """
    try:
        message: dict[str, Any] = msgspec.json.decode(data, type=dict[str, Any])
    except (ValueError, RecursionError) as error:
        raise MessageError(f"not a JSON object: {error}") from error
    return message


def with_nan(value: Any) -> Any:
    """Replace null by NaN in a reading, since JSON has no NaN."""
    if value is None:
        return math.nan
    if isinstance(value, list):
        return [with_nan(item) for item in value]
    return value


def read_record(
    path: str | Path, each: Callable[[str, Message], None] | None = None
) -> Record:
    """Read a whole record from its beginning.

    The index is not used, since a record that was cut off has none. What cannot be read
    is left out and listed in the record's ``damage``.

    Args:
        path: path of the file.
        each: called with channel and message, in the order of the file.

    Raises:
        RecordError: there is no such file, it is no MCAP file, or nothing in it can
            be read.
    """
    path = Path(path)
    record = Record(path)
    unknown: Counter[int] = Counter()
    records = McapRecords(path)
    for name, message in _read(records, record, unknown):
        _take(record, name, message)
        if each is not None:
            each(name, message)
    record.is_cut_off = records.is_cut_off
    record.damage = records.damage
    for channel_id, count in unknown.items():
        what = f"{count} messages of channel {channel_id}, which is not described"
        record.damage.append(Damage(0, what))
    if record.damage and not record.channels and not record.attachments:
        raise RecordError(
            f"{path}: nothing in it can be read ({record.damage[0]}); the file "
            "holds no usable record"
        )
    return record


def _read(
    records: McapRecords, record: Record, unknown: Counter[int]
) -> Iterator[tuple[str, Message]]:
    """Yield channel and message in the order of the file.

    Args:
        records: records of the file.
        record: receives channels and attachments.
        unknown: counts messages of undescribed channels, by channel number.
    """
    names: dict[int, str] = {}
    for entry in records.read():
        if isinstance(entry, Message):
            name = names.get(entry.channel_id)
            if name is None:
                unknown[entry.channel_id] += 1
            else:
                yield name, entry
        elif isinstance(entry, Channel):
            names[entry.id] = _declare(record, entry)
        elif isinstance(entry, Attachment):
            record.attachments[entry.name] = entry.data


def _declare(record: Record, channel: Channel) -> str:
    """Return a channel's name, made distinct if its encoding changes."""
    name = channel.topic.lstrip("/") or f"channel {channel.id}"
    if record._encodings.get(name, channel.message_encoding) != (
        channel.message_encoding
    ):
        name = f"{name}#{channel.id}"
    record._sizes.setdefault(name, 0)
    if record._kept is not None:
        record._kept.setdefault(name, [])
    record._encodings[name] = channel.message_encoding
    return name


def _take(record: Record, name: str, message: Message) -> None:
    stamp = message.log_time
    record._sizes[name] += 1
    if record._kept is not None:
        record._kept[name].append(message.data)
        record._kept_bytes += len(message.data)
        if record._kept_bytes > KEPT_BYTES:
            record._kept = None
    first, last = record.first_ns, record.last_ns
    record.first_ns = stamp if first is None else min(stamp, first)
    record.last_ns = stamp if last is None else max(stamp, last)


class RecordInfo(msgspec.Struct, kw_only=True):
    """Figures of a record."""

    is_cut_off: bool
    condition: str
    """Whole, cut off or damaged, in words."""
    damage: list[str]
    """Places that could not be read, in words."""
    duration_s: float
    """Time from the earliest stamp to the latest [s]."""
    channels: list[ChannelCount]
    attachments: list[str]


def record_info(record: Record) -> RecordInfo:
    """Count the record's messages, and return its figures."""
    counts = {channel: new_count(channel) for channel in record.channels}
    decoders = {
        channel: decode_map if record.is_raw(channel) else decode_json
        for channel in record.channels
        if record.is_readable(channel)
    }
    for channel, data in record.stream():
        if channel in decoders:
            with contextlib.suppress(MessageError):
                count_message(counts[channel], decoders[channel](data))
    for channel, count in counts.items():
        readable, count.messages = count.messages, record.size(channel)
        count.unreadable = count.messages - readable
        if count.unreadable and not record.is_readable(channel):
            count.encoding = record.encoding(channel)
    return RecordInfo(
        is_cut_off=record.is_cut_off,
        condition=record.condition,
        damage=list(map(str, record.damage)),
        duration_s=((record.last_ns or 0) - (record.first_ns or 0)) * 1e-9,
        channels=list(counts.values()),
        attachments=list(record.attachments),
    )
