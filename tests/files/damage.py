"""Damages files as disks, links and other programs do."""

from __future__ import annotations

import random
import struct
from pathlib import Path

from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

KINDS = ("cut", "zeros", "flip", "bits", "insert", "drop", "swap", "length")


def damaged(data: bytes, seed: int) -> bytes:
    """Return a damaged copy, which depends on the seed only."""
    rng = random.Random(seed)
    kind = KINDS[seed % len(KINDS)]
    at = rng.randrange(len(data))
    # Heads and tails of files hold what is worth hitting, so every third is there.
    if seed % 3 == 0:
        at = rng.choice((rng.randrange(64), len(data) - 1 - rng.randrange(2000)))
        at = max(0, min(at, len(data) - 1))
    size = min(rng.choice((1, 8, 100, 5000, 100_000)), len(data) - at)
    copy = bytearray(data)
    match kind:
        case "cut":
            del copy[at:]
        case "zeros":
            copy[at : at + size] = bytes(size)
        case "flip":
            for _ in range(rng.choice((1, 3, 30))):
                place = rng.randrange(len(copy)) if rng.random() < 0.5 else at
                copy[place] = rng.randrange(256)
        case "bits":
            copy[at] ^= 1 << rng.randrange(8)
        case "insert":
            copy[at:at] = rng.randbytes(size)
        case "drop":
            del copy[at : at + size]
        case "swap":
            other = rng.randrange(len(copy))
            part = bytes(copy[other : other + size])
            copy[at : at + len(part)] = part
        case "length":
            copy[at : at + 8] = rng.choice(
                (b"\xff" * 8, b"\xff" * 4 + bytes(4), b"\x00\x00\x00\x40" + bytes(4))
            )
    return bytes(copy)


def damage_first_block(ticks: Path, signal: str) -> None:
    """Change a byte of a signal's first block in a ticks file."""
    data = bytearray(ticks.read_bytes())
    with ticks.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    (wanted,) = (n for n, it in summary.channels.items() if it.topic == signal)
    at = len(MCAP0_MAGIC)
    while True:
        chunk, length = at, struct.unpack_from("<Q", data, at + 1)[0]
        at += 9 + length
        # Behind each chunk an index tells whose it is.
        if data[chunk] == Opcode.CHUNK and data[at + 9] == wanted:
            break
    data[(chunk + at) // 2] ^= 0xFF
    ticks.write_bytes(data)


def foreign_record(path: Path, what: str) -> Path:
    """Return a record as another program might write it."""
    with path.open("wb") as file:
        writer = Writer(
            file,
            compression=(
                CompressionType.NONE if what == "plain" else CompressionType.ZSTD
            ),
            use_chunking=what != "unchunked",
        )
        writer.start(profile="ros1" if what == "ros1" else "", library="other")
        if what != "no channels":
            _fill(writer, what)
        writer.finish()
    return path


FOREIGN = (
    *("no channels", "json", "protobuf", "ros1", "no schema", "wrong schema", "plain"),
    *("unchunked", "our names", "our names in protobuf", "our names, other content"),
    *("outside", "not objects", "huge numbers", "texts for numbers", "two encodings"),
)


def _fill(writer: Writer, what: str) -> None:
    encoding = {
        "protobuf": "protobuf",
        "our names in protobuf": "protobuf",
        "ros1": "ros1",
    }.get(what, "json")
    schema = 0
    if what != "no schema":
        schema = writer.register_schema(
            name="other.Thing",
            encoding="jsonschema",
            data=b"{]" if what == "wrong schema" else b'{"type": "object"}',
        )
    names = ["/tf", "/camera/image"]
    if what.startswith("our names") or what in _CONTENTS:
        names = ["/joints", "/imu", "/left_ankle_ft", "/right_ankle_ft"]
        names += ["/joint_command", "/status", "/stabilizer"]
    if what == "outside":
        names = ["/../../outside", "/a b", "", "/" + "x" * 300, "/..", "/nul\x00"]
    for name in names:
        channel = writer.register_channel(
            topic=name, message_encoding=encoding, schema_id=schema
        )
        for number in range(5):
            writer.add_message(
                channel,
                log_time=number * 10**6,
                publish_time=number,
                data=_CONTENTS.get(what, b'{"a": [1, 2], "b": {"c": "d"}}'),
                sequence=number,
            )
    if what == "two encodings":
        again = writer.register_channel(
            topic="/tf", message_encoding="cbor", schema_id=schema
        )
        writer.add_message(again, log_time=1, publish_time=1, data=b"\xa0")


_CONTENTS = {
    "our names, other content": b'{"tick": 1, "stamp_ns": 2, "q": "none"}',
    "not objects": b"[1, 2, 3]",
    "huge numbers": b'{"tick": 123456789012345678901234567890, "stamp_ns": 1e300}',
    "texts for numbers": b'{"tick": "one", "stamp_ns": null, "commander": 5}',
}
