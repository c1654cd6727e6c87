"""What a record holds."""

from __future__ import annotations

import msgspec

from cli.recording.channel_count import ChannelCount, count_message, new_count
from cli.recording.read_record import Record


class RecordInfo(msgspec.Struct, kw_only=True):
    """A record in figures."""

    is_cut_off: bool
    duration_s: float
    """Between the earliest stamp and the latest [s]."""
    channels: list[ChannelCount]
    attachments: list[str]


def record_info(record: Record) -> RecordInfo:
    """Counts anew, from the messages themselves."""
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
