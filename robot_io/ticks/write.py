"""Writes the signals of every tick to a file during a run.

The file is MCAP: one channel per signal, one message per signal and block of ticks,
each in its own compressed chunk with a checksum. So a reader takes one signal without
touching the others, and a file that is cut off loses only its last block.
"""

from __future__ import annotations

import logging
import struct
import threading
import zlib
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Self

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import (
    Channel,
    Chunk,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    Statistics,
)
from mcap.writer import MCAP0_MAGIC

from surefoot.robot_io.realtime import leave_priority
from surefoot.robot_io.ticks.recorder import Block, BlockFormat, SignalArray
from surefoot.schemas.arrays import NS_PER_S

_LOG = logging.getLogger(__name__)

PROFILE = "surefoot-ticks"
"""Profile of the file; distinguishes it from a record of the bus."""
ENCODING = "surefoot/block"
"""Encoding of messages: ``FIRST_TICK``, then the numbers by row, little-endian."""
FIRST_TICK = struct.Struct("<q")
COUNTS = "surefoot/ticks"
"""Name of the metadata at the end of a whole file."""
LOST = "lost_ticks"
BLOCKS_UNDERWAY = 16
"""Most blocks that may wait for the disk: eight seconds of a run in real time."""
_COMPRESSION_LEVEL = 1
SEQUENCE_MASK = 2**32 - 1


class TickFile:
    """A sink that compresses and writes in its own thread. A context manager.

    The tick loop hands over a block and goes on. It waits only if it may, and only
    while ``BLOCKS_UNDERWAY`` blocks are not yet written. A failure of the disk ends the
    recording at once, but not the run; it is reported at the end.

    Attributes:
        path: path of the file.
        lost_ticks: ticks that are not in the file; final once it is closed.
        is_cut_off: whether to leave the file without its end.
    """

    def __init__(self, path: Path, *, may_wait: bool) -> None:
        """Create the file, replacing one of this name.

        Args:
            path: path of the file.
            may_wait: whether the tick loop may wait for the disk. If not, ticks that
                do not fit are lost, and counted.

        Raises:
            OSError: the file cannot be written.
        """
        self.path = path
        self.lost_ticks = 0
        self.is_cut_off = False
        self._failure: Exception | None = None
        self._may_wait = may_wait
        self._form = BlockFormat([])
        self._filling = Block(0)
        self._free: SimpleQueue[Block] = SimpleQueue()
        self._full: SimpleQueue[Block | None] = SimpleQueue()
        try:
            self._file = _Mcap(path)
        except OSError as error:
            reason = error.strerror or str(error)
            raise OSError(
                f"cannot record to {path}: {reason}; name a folder that can be "
                "written to, on a disk with room"
            ) from error
        self._thread = threading.Thread(target=self._write, name="ticks", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Write the remaining ticks, whatever ended the run, and close the file.

        Raises:
            OSError: the disk failed. Everything written until then stays.
        """
        if self._filling.count:
            self._full.put(self._filling)
        self._full.put(None)
        self._thread.join()
        if self._failure is not None:
            if error is None:
                raise self._failure
        elif self.lost_ticks:
            _LOG.warning(
                "%s lacks %d ticks: the disk was too slow", self.path, self.lost_ticks
            )

    def open(self, form: BlockFormat) -> Block:
        """Begin; see :class:`TickSink`."""
        self._form = form
        for _ in range(BLOCKS_UNDERWAY):
            self._free.put(Block(form.width))
        self._filling = Block(form.width)
        return self._filling

    def put(self, block: Block) -> Block:
        """Take a full block; see :class:`TickSink`."""
        try:
            free = self._free.get(block=self._may_wait)
        except Empty:
            self.lost_ticks += block.count
            block.count = 0
            return block
        self._full.put(block)
        self._filling = free
        return free

    def _write(self) -> None:
        """Write block after block in the thread, until no more come."""
        leave_priority()
        while (block := self._full.get()) is not None:
            if self._failure is None:
                try:
                    self._file.add(self._form, block)
                except Exception as error:  # the tick loop waits for this thread
                    self._fail(error)
            if self._failure is not None:
                self.lost_ticks += block.count
            block.count = 0
            self._free.put(block)
        try:
            if self._failure is None and not self.is_cut_off:
                self._file.finish(lost_ticks=self.lost_ticks)
        except OSError as error:
            self._fail(error)
        finally:
            self._file.close()

    def _fail(self, error: Exception) -> None:
        if self._failure is None:
            if isinstance(error, OSError):
                error.filename = error.filename or str(self.path)
            self._failure = error
            reason = getattr(error, "strerror", None) or error
            _LOG.warning("%s: %s; recording ends, the run goes on", self.path, reason)


class _Mcap:
    """The MCAP file. It keeps no index, so memory does not grow with the run."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb")
        self._compressor = zstandard.ZstdCompressor(level=_COMPRESSION_LEVEL)
        self._channels: dict[str, Channel] = {}
        self._counts: dict[int, int] = {}
        self._first_ns = self._last_ns = self._chunks = 0
        self._file.write(MCAP0_MAGIC)
        self._file.write(record_bytes(Header(profile=PROFILE, library="surefoot")))
        self._file.flush()

    def add(self, form: BlockFormat, block: Block) -> None:
        """Write a block and flush it to the system, where it survives this process."""
        signals = form.signals(block)
        times_ns = self._last_ns, self._last_ns
        if "time_s" in signals:  # a copy of a damaged file may lack them
            begin_s, end_s = np.nan_to_num(signals["time_s"][[0, -1]]).tolist()
            times_ns = round(NS_PER_S * begin_s), round(NS_PER_S * end_s)
        # Ticks come last: a block with readable ticks is whole.
        for name in sorted(signals, key="tick".__eq__):
            self._add(form, name, signals[name], int(signals["tick"][0]), times_ns)
        self._file.flush()

    def _add(
        self,
        form: BlockFormat,
        name: str,
        values: SignalArray,
        first_tick: int,
        times_ns: tuple[int, int],
    ) -> None:
        begin_ns, end_ns = times_ns
        if name not in self._channels:
            channel = Channel(
                id=1 + len(self._channels),
                topic=name,
                message_encoding=ENCODING,
                schema_id=0,
                metadata=form.layouts[name].metadata(),
            )
            self._channels[name] = channel
            self._counts[channel.id] = 0
        channel_id = self._channels[name].id
        # In every chunk: if one is damaged, the others can still be read.
        layout = record_bytes(self._channels[name])
        little = values.astype(values.dtype.newbyteorder("<"), copy=False)
        message = Message(
            channel_id=channel_id,
            sequence=first_tick & SEQUENCE_MASK,
            log_time=begin_ns,
            publish_time=begin_ns,
            data=FIRST_TICK.pack(first_tick) + little.tobytes(),
        )
        index = MessageIndex(channel_id, [(begin_ns, len(layout))])
        data = layout + record_bytes(message)
        chunk = Chunk(
            compression="zstd",
            data=self._compressor.compress(data),
            message_start_time=begin_ns,
            message_end_time=begin_ns,
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        self._file.write(record_bytes(chunk))
        self._file.write(record_bytes(index))
        self._chunks += 1
        self._counts[channel_id] += 1
        if self._chunks == 1:
            self._first_ns = begin_ns
        self._last_ns = end_ns

    def finish(self, *, lost_ticks: int) -> None:
        """Write the end, which shows a reader that the file is whole."""
        counts = Metadata(name=COUNTS, metadata={LOST: str(lost_ticks)})
        self._file.write(record_bytes(counts) + record_bytes(DataEnd(0)))
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._chunks,
            message_count=sum(self._counts.values()),
            message_end_time=self._last_ns,
            message_start_time=self._first_ns,
            metadata_count=1,
            schema_count=0,
        )
        footer = Footer(
            summary_start=self._file.tell(), summary_offset_start=0, summary_crc=0
        )
        ends = [*self._channels.values(), statistics, footer]
        self._file.write(b"".join(map(record_bytes, ends)) + MCAP0_MAGIC)
        self._file.flush()

    def close(self) -> None:
        """Close the file as it is."""
        with suppress(OSError):  # a disk that failed once fails again
            self._file.close()


def record_bytes(record: McapRecord) -> bytes:
    """Return an MCAP record as bytes of a file."""
    builder = RecordBuilder()
    record.write(builder)
    # mcap gives this method no types.
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
