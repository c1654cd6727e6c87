"""Changes and reads records by the MCAP project's library, without our code."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.writer import Writer

Change = Callable[[str, dict[str, Any]], dict[str, Any] | None]


def rewritten(path: Path, out: Path, change: Change) -> Path:
    """Write a copy of a record with other messages.

    Args:
        path: the record.
        out: the copy.
        change: returns the new message of a channel; None leaves it out.
    """
    with path.open("rb") as source, out.open("wb") as target:
        reader, writer = make_reader(source), Writer(target)
        writer.start(profile="", library="test")
        for entry in reader.iter_attachments():
            writer.add_attachment(0, 0, entry.name, entry.media_type, entry.data)
        ids: dict[int, int] = {}
        summary = reader.get_summary()
        assert summary is not None
        for channel in summary.channels.values():
            ids[channel.id] = writer.register_channel(
                topic=channel.topic,
                message_encoding=channel.message_encoding,
                schema_id=0,
            )
        for _, channel, message in reader.iter_messages(log_time_order=False):
            content = change(channel.topic.lstrip("/"), json.loads(message.data))
            if content is not None:
                writer.add_message(
                    ids[channel.id],
                    log_time=message.log_time,
                    publish_time=message.publish_time,
                    data=json.dumps(content).encode(),
                    sequence=message.sequence,
                )
        writer.finish()
    return out
