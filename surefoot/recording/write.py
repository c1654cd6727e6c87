"""Writes bus messages to an MCAP file."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple, Self

import msgspec
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from surefoot.errors import UsageError
from surefoot.out_folder import is_to_replace
from surefoot.recording.mcap_records import BAD_CONTENT
from surefoot.recording.read import LARGEST_GAP, Rounds, count_message, new_count
from surefoot.robot_io.client_side.observer import Sample
from surefoot.robot_io.ticks.write import SEQUENCE_MASK, record_bytes
from surefoot.schemas.codec import Head, decode_map
from surefoot.schemas.errors import MessageError
from surefoot.schemas.json_schema import json_schema
from surefoot.schemas.topics import topic

_NEW_RUN_TICKS = 1000
"""A tick this far behind belongs to a new run of the robot, not to a late message."""
_NO_TICKS = ("reference", "walk")
"""Channels of planners, which need not count ticks; their messages are of now."""
_LAST_NS = 2**62
"""No robot gets so old; a file's times end at four times as much [ns]."""
CHUNK_BYTES = 128 * 1024
"""Small, since a crash loses the chunk that is being filled."""
KEPT_FREE_BYTES = 64 * 2**20
"""Space left on the disk for the other files of a run."""
LIBRARY = "surefoot"
"""Name in a file's header that marks our own records."""
MSGPACK = "msgpack"
UNREADABLE, BYTES = "unreadable", "application/octet-stream"
"""Subchannel, and its encoding, for bytes that are no message of their channel."""
COUNTS = "surefoot/counts"
"""Name of the metadata that hold the counts of each channel."""
_UNITS = "SI units and radians; wrenches and orientations as the schema says"


def claim_file(path: Path, *, overwrite: bool = False) -> BinaryIO:
    """Open ``NAME.partial`` for a file that will be called ``NAME`` when complete.

    Args:
        path: final name.
        overwrite: replace a file of this name, or the partial file of a command that
            was cut off.

    Returns:
        The empty open file, locked until it is closed.

    Raises:
        UsageError: the name is taken or in use.
        OSError: the file cannot be written.
    """
    is_to_replace(path, overwrite=overwrite)
    partial = path.with_name(path.name + ".partial")
    file = partial.open("ab")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if file.tell() and not overwrite:
            raise UsageError(
                f"--out {path}: {partial} was left by a command that was cut off; "
                "move it away, name another file, or overwrite it (--overwrite)"
            )
    except BlockingIOError as error:
        file.close()
        raise UsageError(
            f"--out {path}: another command is writing it now; name another file"
        ) from error
    except UsageError:
        file.close()
        raise
    file.truncate(0)
    return file


class Attachment(NamedTuple):
    """A file that is stored in a record."""

    name: str
    media_type: str
    data: bytes


class LogTimes:
    """Log times of messages: the senders' stamps, or simulated time from ticks.

    In lockstep, wall-clock times have no meaning, but ticks do. The ticks of a
    restarted robot are shifted behind the earlier ones, so that times never decrease.

    Attributes:
        latest: latest time returned [ns]; 0 before the first.
    """

    def __init__(self, period_ns: int | None) -> None:
        """Start at time 0.

        Args:
            period_ns: period of a tick for simulated time [ns]; None for stamps.
        """
        self.latest = 0
        self._period_ns = period_ns
        self._begins = [0]
        self._rounds = Rounds(late_ticks=_NEW_RUN_TICKS)
        self._told: dict[str, int] = {}

    @property
    def meaning(self) -> str:
        """What the times mean, for readers of the file."""
        if self._period_ns is None:
            return "the sender's monotonic clock, as publish time"
        return "simulated: tick times period; publish time is the sender's clock"

    def of(self, channel: str, head: Head) -> int:
        """Return the log time of a message [ns]."""
        time_ns = self._time_ns(channel, head)
        self.latest = max(self.latest, time_ns)
        return time_ns

    def _time_ns(self, channel: str, head: Head) -> int:
        if self._period_ns is None:
            return head.stamp_ns
        if channel in _NO_TICKS or self._is_foreign(channel, head.tick):
            return self.latest
        turn = self._rounds.of(channel, head.tick)
        if turn == len(self._begins):
            self._begins.append(self.latest + self._period_ns)
        begin = self._begins[turn]
        return min(begin + head.tick * self._period_ns, 4 * _LAST_NS - 1)

    def _is_foreign(self, channel: str, tick: int) -> bool:
        """Whether a tick is near neither the robot's nor the channel's one before."""
        before = self._told.get(channel, -LARGEST_GAP - 1)
        self._told[channel] = tick
        now = tick if self._rounds.now is None else self._rounds.now
        is_far = min(tick - now, abs(tick - before)) > LARGEST_GAP
        return is_far or tick * (self._period_ns or 0) > _LAST_NS


class McapFile:
    """An MCAP file that gets its name when it is complete.

    A context manager. Until it is left without an error the file is called
    ``NAME.partial``. If it is cut short, that file remains with all chunks written so
    far.

    Attributes:
        path: final name.
        partial: name until the file is complete.
        counts: message counts by channel.
    """

    def __init__(
        self,
        path: Path,
        *,
        channels: Iterable[str],
        keys: dict[str, str],
        attachments: Iterable[Attachment],
        raw: bool,
        times: LogTimes | None = None,
        overwrite: bool = False,
    ) -> None:
        """Create the file and write schemas, channels and attachments.

        Args:
            path: final name.
            channels: names from the topic table.
            keys: bus key by channel.
            attachments: files to store beside the messages.
            raw: write MessagePack as on the bus, not JSON.
            times: gives the log times; the senders' stamps when None.
            overwrite: replace a record of this name at the end.

        Raises:
            UsageError: the name is taken or in use, or a file that is no record of ours
                has it.
            OSError: the file cannot be written; the message says what is left.
        """
        self.path = path
        self.partial = path.with_name(path.name + ".partial")
        self.counts = {name: new_count(name) for name in channels}
        self._raw, self._overwrite = raw, overwrite
        self._times = times or LogTimes(None)
        self._kept_apart: dict[str, int] = {}
        try:
            for file in (path, self.partial):
                _refuse_foreign(file)
            self._file = claim_file(path, overwrite=overwrite)
            self._writer = Writer(
                self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.LZ4
            )
            self._index = _IndexOnDisk(path.parent)
            # mcap has no other place for it.
            vars(self._writer)["_Writer__chunk_indices"] = self._index
            self._writer.start(profile="", library=LIBRARY)
            self._ids = {name: self._declare(name, keys[name]) for name in self.counts}
            for entry in attachments:
                self._writer.add_attachment(
                    0, 0, entry.name, entry.media_type, entry.data
                )
            self._file.flush()
        except OSError as error:
            raise self._explained(error) from error

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Complete the file, unless an error has cut it short.

        Raises:
            OSError: the file cannot be completed.
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
            self._index.close()
            if error is None:
                if not self._overwrite and os.path.lexists(self.path):
                    raise OSError(errno.EEXIST, "another command wrote it meanwhile")
                self.partial.replace(self.path)
        except OSError as failure:
            # After another error, that error is reported, not this one.
            if error is None:
                raise self._explained(failure) from failure

    def add(self, samples: Iterable[Sample]) -> None:
        """Write messages; other bytes go to a channel beside, as they came.

        Raises:
            OSError: the disk is full or cannot be written.
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
            message = decode_map(sample.data)
            data = sample.data if self._raw else msgspec.json.encode(message)
            head = count_message(self.counts[name], message)
        except (MessageError, TypeError, ValueError, RecursionError):
            head = None
        if head is None:
            self._keep_apart(sample)
        else:
            self._write(self._ids[name], name, head, data)

    def _write(self, channel_id: int, name: str, head: Head, data: bytes) -> None:
        self._writer.add_message(
            channel_id,
            log_time=self._times.of(name, head),
            publish_time=head.stamp_ns,
            data=data,
            sequence=head.tick & SEQUENCE_MASK,
        )

    def _keep_apart(self, sample: Sample) -> None:
        """Write bytes that are no message of their channel to its subchannel."""
        name = sample.channel
        self.counts[name].unreadable += 1
        if name not in self._kept_apart:
            self._kept_apart[name] = self._writer.register_channel(
                topic=f"/{name}/{UNREADABLE}",
                message_encoding=BYTES,
                schema_id=0,
                metadata={"description": f"what came on {name} and is no message"},
            )
        self._writer.add_message(
            self._kept_apart[name],
            log_time=self._times.latest or sample.received_ns,
            publish_time=sample.received_ns,
            data=sample.data,
            sequence=self.counts[name].unreadable & SEQUENCE_MASK,
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
                "log_time": self._times.meaning,
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


class _IndexOnDisk:
    """The positions of the chunks, which the MCAP writer would keep in memory.

    They would grow by a hundred megabytes an hour.
    """

    def __init__(self, folder: Path) -> None:
        # A file without a name, which vanishes in any case.
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115  # see close

    def append(self, index: ChunkIndex) -> None:
        """Store the position of one chunk."""
        self._file.write(record_bytes(index))

    def __iter__(self) -> Iterator[Self]:
        """Yield all positions as one record."""
        yield self

    def write(self, builder: RecordBuilder) -> None:
        """Write all positions."""
        self._file.seek(0)
        builder.write(self._file.read())

    def close(self) -> None:
        """Delete the positions."""
        self._file.close()


def _refuse_foreign(path: Path) -> None:
    """Check that an existing, non-empty file is a record of ours.

    Raises:
        UsageError: it is another file, which is never replaced.
    """
    if not path.is_file() or not path.stat().st_size:
        return
    try:
        with path.open("rb") as file:
            is_ours = make_reader(file).get_header().library == LIBRARY
    except BAD_CONTENT:
        is_ours = False
    if not is_ours:
        raise UsageError(
            f"--out {path}: exists and is no record of surefoot, so it is kept; name "
            "another file"
        )
