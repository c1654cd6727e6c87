"""Reads the records of an MCAP file, also of a damaged or malicious one.

Only this module passes a foreign file to the MCAP and compression libraries. It checks
every record's length against the size of the file, so that a false length allocates
nothing. A chunk with a wrong checksum is skipped. An error of a library inside a record
becomes :class:`Damage`, and reading continues behind it.
"""

from __future__ import annotations

import os
import struct
import zlib
from bisect import bisect_right
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, Any, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Statistics,
)

from surefoot.errors import UsageError
from surefoot.robot_io.ticks.read import is_tick_file

MAGIC = b"\x89MCAP0\r\n"
_NAME_A_RECORD = "name what surefoot record or surefoot run --out wrote"
_HEAD = struct.Struct("<BQ")
_CRC = struct.Struct("<I")
_FOOTER_BYTES = 20
_MESSAGE_HEAD = struct.Struct("<HIQQ")
"""Channel, sequence, log time and publish time."""
_LAST_KNOWN = max(Opcode)
_FIRST_PRIVATE = 0x80
_PIECE_BYTES = 2**20
_LARGEST_EXPANSION = 255
"""Largest compression ratio of LZ4; a robot's data stay far below, also with zstd."""
BAD_CONTENT = (
    McapError,
    struct.error,
    ValueError,
    EOFError,
    OverflowError,
    MemoryError,
    RuntimeError,
    zstandard.ZstdError,
)
"""Exceptions of the libraries on malformed bytes."""
_KINDS: dict[int, Any] = {
    Opcode.CHANNEL: Channel,
    Opcode.ATTACHMENT: Attachment,
    Opcode.METADATA: Metadata,
}
_READ = (Opcode.CHUNK, Opcode.MESSAGE, *_KINDS)
_INDICES: dict[int, Any] = {
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.METADATA_INDEX: MetadataIndex,
}


class RecordError(UsageError):
    """A file that holds no readable record."""


class Damage(NamedTuple):
    """A place of a file that cannot be read, and why."""

    offset: int
    what: str

    def __str__(self) -> str:
        """Return the place and the reason in words."""
        return f"byte {self.offset}: {self.what}"


class _Frame(NamedTuple):
    """A record that lies within the file; begin and length in bytes."""

    opcode: int
    begin: int
    length: int

    @property
    def end(self) -> int:
        return self.begin + _HEAD.size + self.length


class McapRecords:
    """The records of one file, read once from the beginning.

    Attributes:
        path: path of the file.
        is_cut_off: whether the file lacks its end; known after reading.
        damage: what could not be read, in the order of the file; grows while reading.
    """

    def __init__(self, path: Path) -> None:
        """Prepare; the file is not opened yet."""
        self.path = path
        self.is_cut_off = True
        self.damage: list[Damage] = []
        self._size = 0
        self._starts: list[int] = []
        self._told: Statistics | None = None
        self._messages = 0

    def read(self) -> Iterator[McapRecord]:
        """Yield channels, messages, attachments and metadata, in the file's order.

        Channels in the file's summary come first, since the chunk with their other
        description may be damaged.

        Raises:
            RecordError: there is no such file, or it does not begin as MCAP.
        """
        try:
            with self.path.open("rb") as file:
                self._size = os.fstat(file.fileno()).st_size
                self._check_beginning(file)
                yield from self._summary(file)
                yield from self._data(file)
        except IsADirectoryError as error:
            raise RecordError(_folder_advice(self.path)) from error
        except OSError as error:
            raise RecordError(
                f"{self.path}: {error.strerror or error}; {_NAME_A_RECORD}"
            ) from error
        told = self._told.message_count if self._told is not None else 0
        if told > self._messages:
            lost = told - self._messages
            what = f"{lost} of {told} messages that the file once held are not readable"
            self.damage.append(Damage(self._size, what))

    def _check_beginning(self, file: IO[bytes]) -> None:
        begin = file.read(len(MAGIC))
        if begin == MAGIC:
            return
        if begin and MAGIC.startswith(begin):
            what = f"cut off after {len(begin)} bytes, so nothing can be read"
        elif not begin:
            what = "the file is empty"
        else:
            what = f"begins with {begin!r}, an MCAP file with {MAGIC!r}"
        raise RecordError(f"{self.path}: not an MCAP file: {what}; {_NAME_A_RECORD}")

    def _summary(self, file: IO[bytes]) -> Iterator[Channel]:
        """Yield channels from the summary; store chunk positions and statistics.

        Yields nothing when the file lacks its end, or the end is damaged.
        """
        tail = _HEAD.size + _FOOTER_BYTES + len(MAGIC)
        footer_at = self._size - tail
        if footer_at < len(MAGIC):
            return
        file.seek(footer_at)
        end = file.read(tail)
        if end[-len(MAGIC) :] != MAGIC or _HEAD.unpack_from(end) != (
            Opcode.FOOTER,
            _FOOTER_BYTES,
        ):
            return
        footer: Footer = _parsed(Footer, end[_HEAD.size : -len(MAGIC)])
        if not len(MAGIC) <= footer.summary_start < footer_at:
            return
        file.seek(footer.summary_start)
        summary = file.read(footer_at - footer.summary_start)
        covered = summary + end[: -len(MAGIC) - _CRC.size]
        if footer.summary_crc and zlib.crc32(covered) != footer.summary_crc:
            self.damage.append(
                Damage(footer.summary_start, "a summary that belies its checksum")
            )
            return
        try:
            yield from self._in_summary(summary)
        except BAD_CONTENT as error:
            self.damage.append(
                Damage(footer.summary_start, f"a broken summary ({error})")
            )

    def _in_summary(self, summary: bytes) -> Iterator[Channel]:
        for opcode, content in _inner(summary):
            if opcode == Opcode.CHANNEL:
                yield _parsed(Channel, content)
            elif opcode == Opcode.STATISTICS:
                self._told = _parsed(Statistics, content)
            elif opcode in _INDICES:
                index = _parsed(_INDICES[opcode], content)
                is_chunk = isinstance(index, ChunkIndex)
                self._starts.append(
                    index.chunk_start_offset if is_chunk else index.offset
                )
        self._starts.sort()

    def _data(self, file: IO[bytes]) -> Iterator[McapRecord]:
        at = len(MAGIC)
        while True:
            frame = self._frame(file, at)
            if frame is None:
                at = self._next_start(at)
                if not at:
                    return
                continue
            if frame.opcode in (Opcode.DATA_END, Opcode.FOOTER):
                self.is_cut_off = not self._has_end(file)
                return
            at = frame.end
            if frame.opcode in _READ:
                yield from self._content(frame, file.read(frame.length))
            elif _LAST_KNOWN < frame.opcode < _FIRST_PRIVATE:
                what = f"a record of unknown kind {frame.opcode}, skipped"
                self.damage.append(Damage(frame.begin, what))

    def _frame(self, file: IO[bytes], at: int) -> _Frame | None:
        """Return the record that begins at a byte; None, with damage, if none does."""
        file.seek(at)
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            self.damage.append(Damage(at, "the file ends here, without its end"))
            return None
        opcode, length = _HEAD.unpack(head)
        frame = _Frame(opcode, at, length)
        limit = self._next_start(at) or self._size
        if opcode == 0:
            self.damage.append(Damage(at, "zeros where a record should begin"))
        elif frame.end > self._size:
            what = (
                f"a record of {length} bytes, of which the file holds "
                f"{self._size - at - _HEAD.size}"
            )
            self.damage.append(Damage(at, what))
        elif frame.end > limit:
            self.damage.append(Damage(at, "a record that reaches into the next chunk"))
        else:
            return frame
        return None

    def _next_start(self, at: int) -> int:
        """Return where reading can continue behind damage; 0 if nowhere."""
        following = bisect_right(self._starts, at)
        return self._starts[following] if following < len(self._starts) else 0

    def _has_end(self, file: IO[bytes]) -> bool:
        if self._size < 2 * len(MAGIC):
            return False
        file.seek(-len(MAGIC), os.SEEK_END)
        if file.read() == MAGIC:
            return True
        self.damage.append(Damage(self._size, "the file lacks its last bytes"))
        return False

    def _content(self, frame: _Frame, data: bytes) -> Iterator[McapRecord]:
        """Yield the content of a record; if damaged, its first part or nothing."""
        name = "chunk" if frame.opcode == Opcode.CHUNK else "record"
        try:
            if frame.opcode == Opcode.CHUNK:
                yield from self._in_chunk(data)
            elif frame.opcode == Opcode.MESSAGE:
                yield self._message(data)
            else:
                if frame.opcode == Opcode.ATTACHMENT:
                    _check_crc(data[: -_CRC.size], _CRC.unpack(data[-_CRC.size :])[0])
                yield _parsed(_KINDS[frame.opcode], data)
        except BAD_CONTENT as error:
            words = str(error) or type(error).__name__
            self.damage.append(Damage(frame.begin, f"a {name} left out: {words}"))

    def _in_chunk(self, data: bytes) -> Iterator[McapRecord]:
        chunk: Chunk = _parsed(Chunk, data)
        body = _unpacked(chunk)
        _check_crc(body, chunk.uncompressed_crc)
        for opcode, content in _inner(body):
            if opcode == Opcode.CHANNEL:
                yield _parsed(Channel, content)
            elif opcode == Opcode.MESSAGE:
                yield self._message(content)

    def _message(self, data: bytes) -> Message:
        if len(data) < _MESSAGE_HEAD.size:
            raise ValueError(f"a message of {len(data)} bytes, shorter than its head")
        channel_id, sequence, log_time, publish_time = _MESSAGE_HEAD.unpack_from(data)
        self._messages += 1
        return Message(
            channel_id=channel_id,
            log_time=log_time,
            data=data[_MESSAGE_HEAD.size :],
            publish_time=publish_time,
            sequence=sequence,
        )


def _folder_advice(path: Path) -> str:
    found = sorted(path.glob("*.mcap*"))
    inside = ", ".join(file.name for file in found if not is_tick_file(file))
    where = f"name a file in it ({inside})" if inside else "it holds none"
    if found and not inside:
        where += " of the bus: a run with --inline has none; run it without"
    return f"{path}: a folder, expected a record (.mcap); {where}"


def _parsed(kind: Any, data: bytes) -> Any:
    """Parse a record that must use up all bytes."""
    stream = ReadDataStream(BytesIO(data))
    record = kind.read(stream)
    if stream.count != len(data):
        raise ValueError(f"{kind.__name__} with {len(data) - stream.count} bytes over")
    return record


def _inner(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and content of consecutive records.

    Raises:
        ValueError: a record reaches beyond the end.
    """
    at = 0
    while at < len(data):
        if len(data) - at < _HEAD.size:
            raise ValueError("ends within a record")
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if length > len(data) - at:
            raise ValueError(f"holds a record of {length} bytes, more than it has")
        yield opcode, data[at : at + length]
        at += length


def _check_crc(data: bytes, crc: int) -> None:
    if crc and zlib.crc32(data) != crc:
        raise ValueError("it belies its checksum")


def _unpacked(chunk: Chunk) -> bytes:
    """Return the content of a chunk; memory grows with the real size, not the claim.

    Raises:
        ValueError: its size differs from the claim, or its compression is unknown.
    """
    wanted, data = chunk.uncompressed_size, chunk.data
    if wanted > _LARGEST_EXPANSION * len(data):
        raise ValueError(f"claims to unpack {len(data)} bytes to {wanted}")
    if chunk.compression == "":
        body = data
    elif chunk.compression == "lz4":
        body = _unpacked_lz4(data, wanted)
    elif chunk.compression == "zstd":
        body = _unpacked_zstd(data, wanted)
    else:
        raise ValueError(f"compressed by {chunk.compression!r}, expected lz4 or zstd")
    if len(body) != wanted:
        raise ValueError(f"unpacks to {len(body)} bytes or more, {wanted} expected")
    return body


def _unpacked_lz4(data: bytes, wanted: int) -> bytes:
    unpacker = lz4.frame.LZ4FrameDecompressor()
    pieces = []
    size = 0
    while not unpacker.eof and size <= wanted:
        piece = unpacker.decompress(data, max_length=_PIECE_BYTES)
        data = b""
        if not piece and unpacker.needs_input:
            break
        pieces.append(piece)
        size += len(piece)
    return b"".join(pieces)


def _unpacked_zstd(data: bytes, wanted: int) -> bytes:
    pieces = []
    size = 0
    with zstandard.ZstdDecompressor().stream_reader(data) as reader:
        while size <= wanted and (piece := reader.read(_PIECE_BYTES)):
            pieces.append(piece)
            size += len(piece)
    return b"".join(pieces)
