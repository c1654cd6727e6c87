"""Reads records, and counts what they hold and lack."""

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
"""Numbers passed over at once, beyond which they are another sender's: a quarter of
an hour of a robot at 1 kHz."""
_OURS = frozenset(entry.name for entry in TOPICS)
MSGPACK, JSON = "msgpack", "json"
TOLD_DAMAGES = 3
KEPT_BYTES = 256 * 2**20
"""A record of more is read again whenever its messages are asked for."""


class _CommandHead(Head, frozen=True):
    commander: str
    sequence: Count


class ChannelCount(msgspec.Struct, kw_only=True):
    """What came on a channel.

    ``first`` and ``last`` are ticks; for commands they are sequence numbers, and
    for channels that do not speak every tick nothing can be known to be missing.
    """

    channel: str
    counted_by: str
    """``tick``, ``sequence``, or empty for a channel without a fixed rate."""
    messages: int = 0
    first: int | None = None
    last: int | None = None
    missing: int = 0
    """Numbers passed over between the first message and the last."""
    gaps: int = 0
    """Places where some are missing."""
    commander: str = ""
    """Who sent the latest command."""
    restarts: int = 0
    """Times the count did not go on but began anew: another robot or commander."""
    unreadable: int = 0
    """Messages that are none of the channel; in a record of ours they are kept, as
    bytes, on a channel of their own."""
    encoding: str = ""
    """What the messages are written in, where that is nothing we read."""

    def add(self, number: int, *, is_new_sender: bool = False) -> None:
        """Count one message."""
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
    """A count of a channel by what its messages are numbered with."""
    if channel == COMMAND:
        return ChannelCount(channel=channel, counted_by="sequence")
    by = "tick" if channel in TICK_SENSORS else ""
    return ChannelCount(channel=channel, counted_by=by)


def count_message(count: ChannelCount, message: dict[str, Any]) -> Head | None:
    """Count a decoded message of the channel.

    Returns:
        Its tick and stamp; None for a channel of another program, which needs none.

    Raises:
        MessageError: it lacks what it is counted by; it is not counted.
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
    """A record as it was read.

    The messages of a small one are kept, those of a large one read again when they are
    asked for: an hour of a bus is ten gigabytes.

    Attributes:
        path: of the file.
        is_cut_off: the file has no end; what is whole of it was read.
        damage: places that could not be read.
        attachments: name to content.
        first_ns: earliest stamp of a message [ns]; None without any.
        last_ns: latest [ns].
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
        """Names of its channels, also of those that nothing came from."""
        return list(self._sizes)

    @property
    def condition(self) -> str:
        """In words: whole, cut off or damaged, and where."""
        cut = "cut off; all that is whole of it is told" if self.is_cut_off else "whole"
        if not self.damage:
            return cut
        told = "; ".join(map(str, self.damage[:TOLD_DAMAGES]))
        more = len(self.damage) - TOLD_DAMAGES
        also = f"; and {more} more" if more > 0 else ""
        return f"{cut if self.is_cut_off else 'damaged'} ({told}{also})"

    def encoding(self, channel: str) -> str:
        """What a channel's messages are written in: ``json``, ``msgpack``, ..."""
        return self._encodings[channel]

    def is_readable(self, channel: str) -> bool:
        """Whether a channel is written in anything that we read."""
        return self.encoding(channel) in (MSGPACK, JSON)

    def is_raw(self, channel: str) -> bool:
        """Whether a channel holds the bytes of the bus, not JSON."""
        return self.encoding(channel) == MSGPACK

    def size(self, channel: str) -> int:
        """Messages of a channel, also those that cannot be read."""
        return self._sizes[channel]

    def messages(self, channel: str) -> list[dict[str, Any]]:
        """What came on a channel and can be read, in the order it came."""
        return list(self.each(channel))

    def each(self, channel: str) -> Iterator[dict[str, Any]]:
        """The same, one by one."""
        if not self.is_readable(channel):
            return
        decode = decode_map if self.is_raw(channel) else decode_json
        for _, data in self.stream(channel):
            try:
                yield decode(data)
            except MessageError:
                continue

    def stream(self, channel: str | None = None) -> Iterator[tuple[str, bytes]]:
        """Give channel and bytes of all messages, those of a channel in their order."""
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
    """Read the JSON object of a message.

    Raises:
        MessageError: it is none.
    """
    try:
        message: dict[str, Any] = msgspec.json.decode(data, type=dict[str, Any])
    except (ValueError, RecursionError) as error:
        raise MessageError(f"not a JSON object: {error}") from error
    return message


def with_nan(value: Any) -> Any:
    """Put back the NaN of a reading, which JSON has as null."""
    if value is None:
        return math.nan
    if isinstance(value, list):
        return [with_nan(item) for item in value]
    return value


def read_record(
    path: str | Path, each: Callable[[str, Message], None] | None = None
) -> Record:
    """Read a whole record from its beginning, since one cut off has no index.

    What cannot be read is left out and told in the record's ``damage``.

    Args:
        path: the file.
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
            f"{path}: nothing in it can be read ({record.damage[0]}); there is no "
            "record to be had from this file"
        )
    return record


def _read(
    records: McapRecords, record: Record, unknown: Counter[int]
) -> Iterator[tuple[str, Message]]:
    """Channel and message, one after the other.

    Args:
        records: of the file.
        record: gets channels and attachments.
        unknown: gets the messages of channels that are not described.
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
    """The name of a channel; one of another encoding gets a name of its own."""
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
    """A record in figures."""

    is_cut_off: bool
    condition: str
    """Whole, cut off or damaged, in words."""
    damage: list[str]
    """Places that could not be read."""
    duration_s: float
    """Between the earliest stamp and the latest [s]."""
    channels: list[ChannelCount]
    attachments: list[str]


def record_info(record: Record) -> RecordInfo:
    """Count anew, from the messages themselves."""
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
