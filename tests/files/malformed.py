"""Malformed messages."""

from __future__ import annotations

import random
from typing import Any

import msgpack

from surefoot.schemas.topics import ALL_CHANNELS, topic
from tests.schemas.simplest_message import simplest_message

ODD: tuple[Any, ...] = (
    *(1.5, -1, 2**63, 2**64 - 1, -(2**63), float("nan"), float("inf"), 1e300),
    *("text", "", None, True, [], [1], {}, b"bytes", msgpack.ExtType(7, b"x")),
    msgpack.Timestamp(1, 2),
)
"""Values to put where an integer, a number or a list should be."""
NO_MESSAGES = (
    *(b"", b"\xc1", b"\xff" * 16, bytes(100), b"\x91" * 5000, b"\xa1\xff", b"x" * 9000),
    *(b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff"),
    *(b"\x81\xc0\x01", b"\x81\xca\x7f\xc0\x00\x00\x01", b"\x2a", b"\xc0"),
    msgpack.packb({"tick": 1, 2: 3}),
    msgpack.packb([1, 2, 3]),
)


def malformed(seed: int, channel: str, *, joint_count: int) -> bytes:
    """Return a malformed message of a channel, which depends on the seed only."""
    rng = random.Random(f"{seed} {channel}")
    if rng.random() < 0.2:
        return rng.choice(NO_MESSAGES)
    message = simplest_message(topic(channel).message, joint_count=joint_count)
    match rng.randrange(5):
        case 0:
            message[rng.choice(("tick", "stamp_ns"))] = rng.choice(ODD)
        case 1:
            message[rng.choice(list(message))] = rng.choice(ODD)
        case 2:
            del message[rng.choice(list(message))]
        case 3:
            message["tick"] = rng.choice((2**40, 2**53, 2**62, 2**63 - 1))
            message["stamp_ns"] = rng.choice((0, 2**62, 2**63 - 1))
        case 4:
            data = bytearray(msgpack.packb(message))
            for _ in range(rng.randrange(1, 5)):
                data[rng.randrange(len(data))] = rng.randrange(256)
            return bytes(data)
    return msgpack.packb(message)


def many(count: int, *, joint_count: int) -> list[tuple[str, bytes]]:
    """Return malformed messages of all channels in turn."""
    return [
        (name, malformed(seed, name, joint_count=joint_count))
        for seed in range(count)
        for name in (ALL_CHANNELS[seed % len(ALL_CHANNELS)],)
    ]
