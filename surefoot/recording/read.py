"""Reads records, also those that a crash has cut off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Attachment, Channel, Message
from mcap.stream_reader import StreamReader

from surefoot.errors import UsageError
from surefoot.recording.write import MSGPACK, ChannelCount, count_message, new_count


@dataclass
class Record:
    """A record as it was read.

    Attributes:
        is_cut_off: the file has no end; what is whole of it was read.
        attachments: name to content.
        first_ns: earliest stamp of a message [ns]; None without any.
        last_ns: latest [ns].
    """

    is_cut_off: bool = False
    attachments: dict[str, bytes] = field(default_factory=dict)
    first_ns: int | None = None
    last_ns: int | None = None
    _data: dict[str, list[bytes]] = field(default_factory=dict)
    _encodings: dict[str, str] = field(default_factory=dict)

    @property
    def channels(self) -> list[str]:
        """Names of its channels, also of those that nothing came from."""
        return list(self._data)

    def messages(self, channel: str) -> list[dict[str, Any]]:
        """What came on a channel, in the order it came."""
        is_raw = self.is_raw(channel)
        decode = msgspec.msgpack.decode if is_raw else msgspec.json.decode
        return [decode(data) for data in self._data[channel]]

    def is_raw(self, channel: str) -> bool:
        """Whether a channel holds the bytes of the bus, not JSON."""
        return self._encodings[channel] == MSGPACK


def read_record(
    path: Path, each: Callable[[str, Message], None] | None = None
) -> Record:
    """Read a whole record from its beginning, since one cut off has no index.

    Args:
        path: the file.
        each: called with channel and message, in the order of the file.

    Raises:
        UsageError: there is no such file, or it is no MCAP file.
    """
    record = Record()
    names: dict[int, str] = {}
    try:
        with path.open("rb") as file:
            for entry in StreamReader(file).records:
                _take(entry, record, names)
                if each is not None and isinstance(entry, Message):
                    each(names[entry.channel_id], entry)
    except EndOfFile:
        record.is_cut_off = True
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error
    except McapError as error:
        raise UsageError(f"{path}: not an MCAP file ({error})") from error
    if record.is_cut_off and not names:
        raise UsageError(f"{path}: not an MCAP file, or cut off at its very beginning")
    return record


def _take(entry: object, record: Record, names: dict[int, str]) -> None:
    if isinstance(entry, Channel):
        # The summary at the end of a file says each channel again.
        names[entry.id] = name = entry.topic.lstrip("/")
        record._data.setdefault(name, [])
        record._encodings[name] = entry.message_encoding
    elif isinstance(entry, Message):
        stamp = entry.log_time
        record._data[names[entry.channel_id]].append(entry.data)
        record.first_ns = min(stamp, record.first_ns or stamp)
        record.last_ns = max(stamp, record.last_ns or stamp)
    elif isinstance(entry, Attachment):
        record.attachments[entry.name] = entry.data


class RecordInfo(msgspec.Struct, kw_only=True):
    """A record in figures."""

    is_cut_off: bool
    duration_s: float
    """Between the earliest stamp and the latest [s]."""
    channels: list[ChannelCount]
    attachments: list[str]


def record_info(record: Record) -> RecordInfo:
    """Count anew, from the messages themselves."""
    counts = []
    for channel in record.channels:
        count = new_count(channel)
        for message in record.messages(channel):
            count_message(count, message)
        counts.append(count)
    return RecordInfo(
        is_cut_off=record.is_cut_off,
        duration_s=((record.last_ns or 0) - (record.first_ns or 0)) * 1e-9,
        channels=counts,
        attachments=list(record.attachments),
    )
