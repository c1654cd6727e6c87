"""Reads records with the reader of the MCAP project, not with ours."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader


class Received(NamedTuple):
    """One message of a record."""

    channel: str
    log_time: int
    data: bytes

    @property
    def content(self) -> dict[str, Any]:
        decoded: dict[str, Any] = json.loads(self.data)
        return decoded


class Described(NamedTuple):
    """Description of a channel in a record."""

    encoding: str
    schema: dict[str, Any]
    metadata: dict[str, str]


def channels(path: Path) -> dict[str, Described]:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return {
        channel.topic.lstrip("/"): Described(
            channel.message_encoding,
            json.loads(summary.schemas[channel.schema_id].data),
            dict(channel.metadata),
        )
        for channel in summary.channels.values()
    }


def messages(path: Path) -> list[Received]:
    with path.open("rb") as file:
        return [
            Received(channel.topic.lstrip("/"), message.log_time, message.data)
            for _, channel, message in make_reader(file).iter_messages()
        ]


def messages_of_cut_off(path: Path) -> list[Received]:
    """Return all complete messages of a file without an end."""
    names: dict[int, str] = {}
    found: list[Received] = []
    with path.open("rb") as file:
        try:
            for record in StreamReader(file).records:
                if isinstance(record, Channel):
                    names[record.id] = record.topic.lstrip("/")
                elif isinstance(record, Message):
                    name = names[record.channel_id]
                    found.append(Received(name, record.log_time, record.data))
        except EndOfFile:
            return found
    raise AssertionError(f"{path} has an end")


def attached(path: Path) -> dict[str, bytes]:
    with path.open("rb") as file:
        return {a.name: a.data for a in make_reader(file).iter_attachments()}


def metadata(path: Path) -> dict[str, dict[str, str]]:
    with path.open("rb") as file:
        return {m.name: m.metadata for m in make_reader(file).iter_metadata()}
