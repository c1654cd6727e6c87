"""Reads ticks files, even those that are cut off or damaged."""

from __future__ import annotations

import logging
import mmap
import struct
import zlib
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Header, Message, Metadata
from mcap.writer import MCAP0_MAGIC

from surefoot.robot_io.errors import TickFileError
from surefoot.robot_io.ticks.recorder import SignalArray, TickTable
from surefoot.robot_io.ticks.write import COUNTS, FIRST_TICK, LOST, PROFILE
from surefoot.schemas.errors import SchemaError
from surefoot.schemas.signals import SignalLayout, layout_from_metadata

_LOG = logging.getLogger(__name__)

_HEAD = struct.Struct("<BQ")
_CHANNEL_ID = struct.Struct("<H")
_INDEX_HEAD = _HEAD.pack(Opcode.MESSAGE_INDEX, 22)
"""Begins the record behind each chunk, which tells the chunk's signal."""
_LARGEST_CHUNK = 2**26
"""Larger chunks are damaged [bytes]: a block of a hundred joints takes half a MB."""
_DAMAGED = (McapError, SchemaError, zstandard.ZstdError, struct.error, ValueError)


def is_tick_file(path: Path) -> bool:
    """Return whether a file begins like a ticks file."""
    try:
        with path.open("rb") as file:
            return _profile(file.read(4096)) == PROFILE
    except OSError:
        return False


class _Record(NamedTuple):
    """Place of a record's content in the file."""

    opcode: int
    start: int
    stop: int


class TickFileTable(TickTable):
    """A ticks file. Ticks are read at once, every other signal on request."""

    def __init__(self, path: Path) -> None:
        """Find the signals of the file, which may still be written.

        Raises:
            TickFileError: it is no ticks file, or holds no whole block of ticks.
            OSError: it cannot be opened.
        """
        self.path = path
        self.layouts: dict[str, SignalLayout] = {}
        self.is_cut_off = True
        self.gaps: list[str] = []
        self._ids: dict[str, int] = {}
        self._ticks: list[SignalArray] = []
        self._chunks: list[dict[int, _Record]] = []
        """Records of each block, by channel."""
        with path.open("rb") as file:
            if _profile(file.read(4096)) != PROFILE:
                raise TickFileError(
                    f"{path}: not a ticks file; name one that `surefoot run --out` "
                    "wrote, or its folder"
                )
            self._data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        unmet = self._scan()
        for number, error in unmet.items():
            self._tell(f"signal {number} is damaged ({error}); it is left out")
        if not self._ticks:
            raise TickFileError(
                f"{path}: holds no whole block of ticks; it was cut off at its very "
                "beginning, or is damaged there"
            )
        if self.is_cut_off:
            has_end = self._data[-len(MCAP0_MAGIC) :] == MCAP0_MAGIC
            how = "damaged" if has_end else "cut off"
            last = self._ticks[-1][-1]
            self._tell(f"{how} after tick {last}; what follows counts as missing")

    @property
    def counts(self) -> Sequence[int]:
        """Number of ticks in each block."""
        return [len(ticks) for ticks in self._ticks]

    def load(self, name: str, block: int) -> SignalArray | None:
        """Return a signal in a block; None if it is missing or damaged there."""
        ticks = self._ticks[block]
        if name == "tick":
            return ticks
        record = self._chunks[block].get(self._ids[name])
        if record is None:
            return None
        try:
            _, message = self._read_chunk(record)
            return self._numbers(self.layouts[name], message, ticks)
        except _DAMAGED as error:
            self._tell(
                f"{name} is damaged in ticks {ticks[0]} to {ticks[-1]} ({error}); it "
                "counts as missing there"
            )
            return None

    def _numbers(
        self, layout: SignalLayout, message: Message, ticks: SignalArray
    ) -> SignalArray:
        (first_tick,) = FIRST_TICK.unpack_from(message.data)
        if message.channel_id != self._ids[layout.name] or first_tick != ticks[0]:
            raise ValueError("it belongs elsewhere")
        numbers = _numbers(message, layout)
        return numbers.reshape(len(ticks), *layout.shape)

    def _scan(self) -> dict[int, Exception]:
        """Find the record of each signal in each block; ``tick`` ends a block.

        Returns:
            Why the layout of a signal cannot be read, by its number in the file.
        """
        unmet: dict[int, Exception] = {}
        chunks: dict[int, _Record] = {}
        chunk: _Record | None = None
        for record in self._records():
            if record.opcode == Opcode.CHUNK:
                chunk = record
            elif record.opcode == Opcode.MESSAGE_INDEX and chunk is not None:
                (channel_id,) = _CHANNEL_ID.unpack_from(self._data, record.start)
                if channel_id not in self._ids.values():
                    try:
                        self._meet(channel_id, chunk)
                    except _DAMAGED as error:
                        unmet.setdefault(channel_id, error)
                    else:
                        was = unmet.pop(channel_id, None)
                        if was is not None and channel_id == self._ids.get("tick"):
                            self._tell(f"its first block of ticks is damaged ({was})")
                chunks[channel_id] = chunk
                if channel_id == self._ids.get("tick"):
                    self._end_block(chunks)
                    chunks = {}
                chunk = None
            elif record.opcode == Opcode.METADATA:
                self._count(self._data[record.start : record.stop])
            elif record.opcode == Opcode.FOOTER:
                self.is_cut_off = False
        return unmet

    def _meet(self, channel_id: int, chunk: _Record) -> None:
        """Read the layout of a signal from one of its chunks."""
        channel, _ = self._read_chunk(chunk)
        if channel is None or channel.id != channel_id:
            raise ValueError("nothing says which one it is")
        layout = layout_from_metadata(channel.topic, channel.metadata)
        self.layouts[channel.topic] = layout
        self._ids[channel.topic] = channel_id

    def _end_block(self, chunks: dict[int, _Record]) -> None:
        try:
            _, message = self._read_chunk(chunks[self._ids["tick"]])
            if message.channel_id != self._ids["tick"]:
                raise ValueError("another signal in its place")
            ticks = _numbers(message, self.layouts["tick"])
            if len(ticks) == 0:
                raise ValueError("no tick")
        except _DAMAGED as error:
            before = f"tick {self._ticks[-1][-1]}" if self._ticks else "the beginning"
            self._tell(f"a block of ticks after {before} is damaged ({error})")
            return
        self._ticks.append(ticks)
        self._chunks.append(chunks)

    def _count(self, data: bytes) -> None:
        """Read from the end of the file how many ticks did not reach it."""
        try:
            told = Metadata.read(ReadDataStream(BytesIO(data)))
            if told.name == COUNTS:
                self.lost_ticks = int(told.metadata[LOST])
        except (*_DAMAGED, KeyError):
            self._tell("its end is damaged: lost ticks are not known")

    def _records(self) -> Iterator[_Record]:
        """Yield all whole records in order; skipped contents are not read.

        Behind damage it goes on with the next index of a chunk.
        """
        at = len(MCAP0_MAGIC)
        while at + _HEAD.size <= len(self._data):
            opcode, length = _HEAD.unpack_from(self._data, at)
            start = at + _HEAD.size
            if self._is_whole(opcode, start, start + length):
                at = start + length
                yield _Record(opcode, start, at)
                continue
            found = self._data.find(_INDEX_HEAD, at + 1)
            if found < 0:
                return
            self._tell(f"damaged from byte {at} to {found}")
            at = found

    def _is_whole(self, opcode: int, start: int, stop: int) -> bool:
        """Whether a record is of a known kind, ends in the file, and before another."""
        if opcode == Opcode.CHUNK:  # its length is right if its index follows
            return self._data[stop : stop + _HEAD.size] == _INDEX_HEAD
        if opcode == Opcode.MESSAGE_INDEX:
            return self._data[start - _HEAD.size : start] == _INDEX_HEAD
        return stop <= len(self._data) and Opcode.HEADER <= opcode <= max(Opcode)

    def _read_chunk(self, record: _Record) -> tuple[Channel | None, Message]:
        """Return the message in a chunk, and its channel if the chunk holds it.

        Raises:
            ValueError: its checksum is wrong, or it holds something else.
        """
        if record.stop - record.start > _LARGEST_CHUNK:
            raise ValueError("too large a chunk")
        content = self._data[record.start : record.stop]
        chunk = Chunk.read(ReadDataStream(BytesIO(content)))
        if chunk.compression != "zstd" or chunk.uncompressed_size > _LARGEST_CHUNK:
            raise ValueError("unknown compression, or too large a chunk")
        data = zstandard.decompress(chunk.data, chunk.uncompressed_size)
        if zlib.crc32(data) != chunk.uncompressed_crc:
            raise ValueError("wrong checksum")
        stream = ReadDataStream(BytesIO(data))
        channel = None
        while stream.count < len(data):
            opcode, length = stream.read1(), stream.read8()
            if opcode == Opcode.CHANNEL:
                channel = Channel.read(stream)
            elif opcode == Opcode.MESSAGE:
                return channel, Message.read(stream, length)
            else:
                raise ValueError("unknown content")
        raise ValueError("no message in a chunk")

    def _tell(self, what: str) -> None:
        """Tell of damage, once however often it is met."""
        gap = f"{self.path.name}: {what}"
        if gap not in self.gaps:
            self.gaps.append(gap)
            _LOG.warning("%s: %s", self.path, what)


def _numbers(message: Message, layout: SignalLayout) -> SignalArray:
    little = np.dtype(layout.dtype).newbyteorder("<")
    numbers = np.frombuffer(message.data, dtype=little, offset=FIRST_TICK.size)
    return numbers.astype(layout.dtype)


def _profile(data: bytes) -> str | None:
    """Return the profile of an MCAP file from its beginning; None for other files."""
    try:
        if not data.startswith(MCAP0_MAGIC):
            return None
        opcode, length = _HEAD.unpack_from(data, len(MCAP0_MAGIC))
        start = len(MCAP0_MAGIC) + _HEAD.size
        if opcode != Opcode.HEADER or start + length > len(data):
            return None
        content = BytesIO(data[start : start + length])
        return str(Header.read(ReadDataStream(content)).profile)
    except _DAMAGED:
        return None
