"""Recorded ground from others' files: MCAP, CSV, .AT2 and K-NET."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Schema

from surefoot.schemas.arrays import Array
from surefoot.schemas.motions import Quantity, RecordedMotion
from surefoot.sim_robot.errors import ScenarioError

_NANOSECOND = 1e-9
_Decoder = Callable[[bytes], Any]
_PEER = {".at2": "acceleration", ".vt2": "velocity", ".dt2": "position"}
_PEER_HEAD_LINES = 4
_KNET_HEAD_LINES = 17
_UNITS = {"g": "g", "cm/s": "cm/s", "cm/sec": "cm/s", "cm": "cm", "cm/s/s": "cm/s2"}


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


_PEER_COUNT = re.compile(r"NPTS\s*=\s*(\d+)", re.IGNORECASE)
_PEER_STEP = re.compile(r"DT\s*=\s*([\d.]+(?:E[-+]?\d+)?)", re.IGNORECASE)
_PEER_OLD = re.compile(r"^\s*(\d+)\s+([\d.]+)\s+NPTS", re.IGNORECASE)
_PEER_UNITS = re.compile(r"UNITS?\s+OF\s+(\S+)", re.IGNORECASE)
_KNET_RATE = re.compile(r"^Sampling Freq\(Hz\)\s+([\d.]+)", re.MULTILINE)
_KNET_SCALE = re.compile(
    r"^Scale Factor\s+([\d.]+)\s*\(gal\)\s*/\s*([\d.]+)", re.MULTILINE
)


@dataclass(frozen=True)
class GroundRecord:
    """What a file says.

    Attributes:
        content: the file itself.
        quantity: what was measured.
        units: of the values; None when the file does not say.
        times: (n,) rising [s].
        values: (n,) in these units.
    """

    content: bytes
    quantity: Quantity
    units: str | None
    times: Array
    values: Array


def read_record(motion: RecordedMotion) -> GroundRecord:
    """Read the file of a recorded motion, of whatever kind.

    Raises:
        ScenarioError: it cannot be read, or holds no such record; ``field`` is the key
            of the motion to look at.
    """
    path = Path(motion.file)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise _error(
            "file",
            f"{path}: cannot be read ({error.strerror or error}); the name is relative "
            "to the scenario file",
        ) from error
    reader = _reader(path, content)
    record = reader(motion, content)
    if len(record.times) != len(record.values) or len(record.times) < 4:
        raise _error(
            "file", f"{path}: holds {len(record.values)} samples, expected 4 or more"
        )
    if not (np.isfinite(record.values).all() and np.isfinite(record.times).all()):
        raise _error("file", f"{path}: holds values that are no finite numbers")
    if (np.diff(record.times) <= 0.0).any():
        at = int(np.argmax(np.diff(record.times) <= 0.0))
        raise _error(
            "file",
            f"{path}: time goes from {record.times[at]:g} s to "
            f"{record.times[at + 1]:g} s, expected rising times",
        )
    if motion.quantity not in (None, record.quantity):
        raise _error(
            "quantity",
            f"got {motion.quantity!r}, but {path.name} says it holds "
            f"{record.quantity!r}; leave `quantity` out",
        )
    return record


def _reader(
    path: Path, content: bytes
) -> Callable[[RecordedMotion, bytes], GroundRecord]:
    if path.suffix.lower() == ".mcap":
        return _mcap
    if path.suffix.lower() in _PEER:
        return _peer
    if content.startswith(b"Origin Time"):
        return _knet
    return _text


def _peer(motion: RecordedMotion, content: bytes) -> GroundRecord:
    """PEER: four lines of heading, then values row by row."""
    lines = content.decode("latin-1").splitlines()
    head = lines[:_PEER_HEAD_LINES]
    count, step = (_found(pattern, head) for pattern in (_PEER_COUNT, _PEER_STEP))
    old = next((m for line in head if (m := _PEER_OLD.match(line))), None)
    if old is not None:
        count, step = old[1], old[2]
    if count is None or step is None or float(step) <= 0.0:
        raise _error(
            "file",
            f"{motion.file}: the first {_PEER_HEAD_LINES} lines do not say NPTS and "
            "DT, expected a record of PEER",
        )
    values = _numbers(motion, lines[_PEER_HEAD_LINES:])
    if len(values) < int(count):
        raise _error(
            "file",
            f"{motion.file}: holds {len(values)} values and its heading says {count}; "
            "it was cut off, fetch it again",
        )
    units = _found(_PEER_UNITS, head)
    quantity = _PEER[Path(motion.file).suffix.lower()]
    default = {"acceleration": "g", "velocity": "cm/s", "position": "cm"}[quantity]
    values = values[: int(count)]
    return GroundRecord(
        content=content,
        quantity=quantity,  # type: ignore[arg-type]
        units=default if units is None else _UNITS.get(units.lower(), units),
        times=float(step) * np.arange(len(values), dtype=np.float64),
        values=values,
    )


def _knet(motion: RecordedMotion, content: bytes) -> GroundRecord:
    """K-NET and KiK-net: 17 lines of heading, then counts."""
    text = content.decode("latin-1")
    rate, scale = _KNET_RATE.search(text), _KNET_SCALE.search(text)
    if rate is None or scale is None or float(rate[1]) <= 0.0:
        raise _error(
            "file",
            f"{motion.file}: its heading has no `Sampling Freq(Hz)` or `Scale Factor`, "
            "expected a record of K-NET",
        )
    counts = _numbers(motion, text.splitlines()[_KNET_HEAD_LINES:])
    return GroundRecord(
        content=content,
        quantity="acceleration",
        units="gal",
        times=np.arange(len(counts), dtype=np.float64) / float(rate[1]),
        values=counts * float(scale[1]) / float(scale[2]),
    )


def _text(motion: RecordedMotion, content: bytes) -> GroundRecord:
    """Time and values in columns, by commas, semicolons or blanks; # for remarks."""
    quantity = _stated_quantity(motion)
    rows = [
        re.split(r"[,;\s]+", line.strip().rstrip(",;"))
        for line in content.decode("utf-8-sig", "replace").splitlines()
        if line.strip() and not line.lstrip().startswith("#")
    ]
    heading: list[str] = []
    if rows and not _is_number(rows[0][0]):
        heading = rows.pop(0)
    column = 1
    if motion.column:
        if motion.column not in heading:
            raise _error(
                "column",
                f"got {motion.column!r}, but the first line of {motion.file} names "
                f"{', '.join(heading) or 'no columns'}",
            )
        column = heading.index(motion.column)
    try:
        table = np.array([[float(row[0]), float(row[column])] for row in rows])
    except (ValueError, IndexError) as error:
        raise _error(
            "file",
            f"{motion.file}: expected a time [s] and a value in each line ({error})",
        ) from error
    table = table.reshape(-1, 2)
    return GroundRecord(content, quantity, None, table[:, 0], table[:, 1])


def _mcap(motion: RecordedMotion, content: bytes) -> GroundRecord:
    """A number of every message of a channel."""
    quantity = _stated_quantity(motion)
    for key in ("channel", "field"):
        if not getattr(motion, key):
            raise _error(key, f"missing, and {motion.file} is an MCAP file; name it")
    times, values = read_mcap(
        content, file=motion.file, channel=motion.channel, field=motion.field
    )
    return GroundRecord(content, quantity, None, times, values)


def _stated_quantity(motion: RecordedMotion) -> Quantity:
    if motion.quantity is None:
        raise _error(
            "quantity",
            f"missing, and {Path(motion.file).name} does not say what it holds; "
            "expected one of 'position', 'velocity', 'acceleration'",
        )
    return motion.quantity


def _numbers(motion: RecordedMotion, lines: list[str]) -> Array:
    try:
        return np.array([float(word) for line in lines for word in line.split()])
    except ValueError as error:
        raise _error(
            "file", f"{motion.file}: expected numbers after the heading ({error})"
        ) from error


def _found(pattern: re.Pattern[str], lines: list[str]) -> str | None:
    return next((m[1] for line in lines if (m := pattern.search(line))), None)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _error(key: str, what: str) -> ScenarioError:
    return ScenarioError(f"{key}: {what}", field=key)
