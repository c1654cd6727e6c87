"""Writes bus messages to an MCAP file."""

from __future__ import annotations

import errno
import json
import shutil
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import msgspec
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from cli.recording.channel_count import count_message, new_count
from robot_io.observer import Sample
from schemas.json_schema import json_schema
from schemas.topics import topic

CHUNK_BYTES = 128 * 1024
"""Small: what a crash can cost is the chunk that is being filled."""
KEPT_FREE_BYTES = 64 * 2**20
"""Left on the disk, so that a record never takes the room of a run's own files."""
MSGPACK = "msgpack"
COUNTS = "surefoot/counts"
"""Name of the metadata with what was counted, one entry a channel."""
_UNITS = "SI units and radians; wrenches and orientations as the schema says"
_SEQUENCE_MASK = 2**32 - 1


class Attachment(NamedTuple):
    """A file that goes into the record."""

    name: str
    media_type: str
    data: bytes


class McapFile:
    """An MCAP file that takes its name once it is complete.

    A context manager. Until it is left without an error the file is called
    ``NAME.partial``; whatever cuts it short leaves that file with all chunks written
    so far.

    Attributes:
        path: final name.
        partial: name meanwhile.
        counts: of each channel.
        unreadable: messages that could not be read, by channel; they are left out.
    """

    def __init__(
        self,
        path: Path,
        *,
        channels: Iterable[str],
        keys: dict[str, str],
        attachments: Iterable[Attachment],
        raw: bool,
    ) -> None:
        """Creates the file and writes schemas, channels and attachments.

        Args:
            path: where it goes; an older file there is replaced at the end.
            channels: names from the topic table.
            keys: channel name to bus key.
            attachments: what the messages alone do not tell.
            raw: write the bytes of the bus, not JSON.

        Raises:
            OSError: it cannot be written; the message says what is left.
        """
        self.path = path
        self.partial = path.with_name(path.name + ".partial")
        self.counts = {name: new_count(name) for name in channels}
        self.unreadable = dict.fromkeys(self.counts, 0)
        self._raw = raw
        try:
            self._file = self.partial.open("wb")
            self._writer = Writer(
                self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.LZ4
            )
            self._writer.start(profile="", library="surefoot")
            self._ids = {name: self._declare(name, keys[name]) for name in self.counts}
            for entry in attachments:
                self._writer.add_attachment(
                    0, 0, entry.name, entry.media_type, entry.data
                )
            self._file.flush()
        except OSError as error:
            raise self._explained(error) from error

    def __enter__(self) -> Self:
        """Gives itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Completes the file, unless an error has cut it short.

        Raises:
            OSError: it cannot be completed.
        """
        try:
            if error is None:
                counts = {
                    name: msgspec.json.encode(count).decode()
                    for name, count in self.counts.items()
                }
                self._writer.add_metadata(COUNTS, counts)
                # mcap gives this method no types.
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._file.flush()
            self._file.close()
            if error is None:
                self.partial.replace(self.path)
        except OSError as failure:
            # What one error has cut short is told by that error.
            if error is None:
                raise self._explained(failure) from failure

    def add(self, samples: Iterable[Sample]) -> None:
        """Writes messages, at the time their sender stamped them.

        Raises:
            OSError: the disk is full, or the like.
        """
        try:
            self._check_room()
            for sample in samples:
                self._add(sample)
            self._file.flush()
        except OSError as error:
            raise self._explained(error) from error

    def _add(self, sample: Sample) -> None:
        name = sample.channel
        try:
            message: dict[str, Any] = msgspec.msgpack.decode(sample.data)
            tick, stamp_ns = message["tick"], message["stamp_ns"]
            data = sample.data if self._raw else msgspec.json.encode(message)
            count_message(self.counts[name], message)
        except (msgspec.DecodeError, KeyError, TypeError, ValueError):
            self.unreadable[name] += 1
            return
        self._writer.add_message(
            self._ids[name],
            log_time=stamp_ns,
            publish_time=stamp_ns,
            data=data,
            sequence=tick & _SEQUENCE_MASK,
        )

    def _check_room(self) -> None:
        if shutil.disk_usage(self.partial.parent).free < KEPT_FREE_BYTES:
            raise OSError(
                errno.ENOSPC,
                f"the disk is full but for {KEPT_FREE_BYTES >> 20} MiB, which are left "
                "to others; make room, or record elsewhere",
            )

    def _declare(self, name: str, key: str) -> int:
        entry = topic(name)
        schema = json_schema(entry.message)
        schema_id = self._writer.register_schema(
            name=f"surefoot.{entry.message.__name__}",
            encoding=SchemaEncoding.JSONSchema,
            data=json.dumps(schema).encode(),
        )
        return self._writer.register_channel(
            topic=f"/{name}",
            message_encoding=MSGPACK if self._raw else MessageEncoding.JSON,
            schema_id=schema_id,
            metadata={
                "key": key,
                "direction": entry.direction.value,
                "rate": entry.rate,
                "description": entry.description,
                "units": _UNITS,
            },
        )

    def _explained(self, error: OSError) -> OSError:
        reason = error.strerror or str(error)
        left = (
            f"; what was written so far is in {self.partial} "
            "(surefoot log info tells how much)"
            if self.partial.exists()
            else ""
        )
        return OSError(f"cannot record to {self.path}: {reason}{left}")
