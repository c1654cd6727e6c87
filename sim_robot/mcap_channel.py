"""Reads one number of every message of an MCAP channel."""

from __future__ import annotations

import json
from collections.abc import Callable
from io import BytesIO
from typing import Any

import msgpack
import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Schema

from surefoot.schemas.arrays import Array
from surefoot.sim_robot.errors import ScenarioError

_NANOSECOND = 1e-9
_Decoder = Callable[[bytes], Any]


def read_mcap(
    content: bytes, *, file: str, channel: str, field: str
) -> tuple[Array, Array]:
    """Read times [s] and values of a channel, each (n,).

    Messages in JSON and MessagePack are read, and those of ROS 2 where the package
    ``mcap-ros2-support`` is installed. Times are those of measuring where messages
    carry one (``stamp_ns`` or ``header.stamp``), otherwise of logging.

    Args:
        content: of the file.
        file: its name, for errors.
        channel: topic.
        field: path of a number in the messages, such as ``linear_acceleration.0``.

    Raises:
        ScenarioError: no such file, channel or field; ``field`` is the key to look at.
    """
    times, values = [], []
    decoders: dict[int, _Decoder] = {}
    try:
        reader = make_reader(BytesIO(content))
        for schema, about, message in reader.iter_messages(topics=[channel]):
            if about.id not in decoders:
                decoders[about.id] = _decoder(schema, about, file)
            decoded = decoders[about.id](message.data)
            values.append(_value(decoded, field, channel))
            times.append(_stamp_ns(decoded, message.log_time))
        if not values:
            topics = sorted({c.topic for c in _channels(content)})
            raise _error(
                "channel",
                f"{file} has no messages of {channel!r}; it has {', '.join(topics)}",
            )
    except (McapError, ValueError, msgpack.UnpackException, EOFError) as error:
        if isinstance(error, ScenarioError):
            raise
        raise _error("file", f"{file}: cannot be read as MCAP ({error})") from error
    stamps = np.array(times, dtype=np.int64)
    return _NANOSECOND * (stamps - stamps[0]), np.array(values)


def _channels(content: bytes) -> list[Channel]:
    summary = make_reader(BytesIO(content)).get_summary()
    return [] if summary is None else list(summary.channels.values())


def _decoder(schema: Schema | None, channel: Channel, file: str) -> _Decoder:
    if channel.message_encoding == "json":
        return json.loads
    if channel.message_encoding == "msgpack":
        return _unpack
    if channel.message_encoding == "cdr":
        try:
            from mcap_ros2.decoder import DecoderFactory
        except ImportError as error:
            raise _error(
                "channel",
                f"{file}: {channel.topic!r} holds messages of ROS 2; `pip install "
                "mcap-ros2-support` reads them",
            ) from error
        decode: _Decoder | None = DecoderFactory().decoder_for("cdr", schema)
        if decode is not None:
            return decode
    raise _error(
        "channel",
        f"{file}: messages of {channel.topic!r} are {channel.message_encoding!r}, "
        "expected json, msgpack or cdr; export them as .csv",
    )


def _unpack(data: bytes) -> Any:
    return msgpack.unpackb(data)


def _value(message: Any, path: str, channel: str) -> float:
    place = message
    for step in path.split("."):
        try:
            place = _inside(place, step)
        except (KeyError, IndexError, AttributeError, ValueError, TypeError):
            raise _error(
                "field", f"messages of {channel!r} have no {path!r}: no {step!r}"
            ) from None
    if isinstance(place, bool) or not isinstance(place, (int, float)):
        raise _error(
            "field",
            f"{path!r} of {channel!r} is no number; name one in it, such as {path}.0",
        )
    return float(place)


def _inside(place: Any, step: str) -> Any:
    if isinstance(place, dict):
        return place[step]
    if step.isdigit():
        return place[int(step)]
    return getattr(place, step)


def _stamp_ns(message: Any, logged_ns: int) -> int:
    """When a message was measured, as far as it says so [ns]."""
    if isinstance(message, dict):
        stamp = message.get("stamp_ns")
        return int(stamp) if isinstance(stamp, int) and stamp > 0 else logged_ns
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return logged_ns
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec) or logged_ns


def _error(key: str, what: str) -> ScenarioError:
    return ScenarioError(f"{key}: {what}", field=key)
