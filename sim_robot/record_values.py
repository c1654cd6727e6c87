"""Reads the numbers of recorded ground, from texts and from MCAP channels."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import msgpack
import numpy as np
from mcap.reader import McapReader, NonSeekingReader, make_reader
from mcap.records import Channel, Schema
from mcap.stream_reader import StreamReader

from surefoot.schemas.arrays import Array
from surefoot.sim_robot.catalogue import ScenarioError

SIMULATED = "simulated"
"""Begins the metadata ``log_time`` of channels whose log times are simulated ones."""
_NANOSECOND = 1e-9
_LATEST_NS = 2**63
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[EDed][-+]?\d+)?", re.ASCII)
_RUN_TOGETHER = re.compile(r"(?<=[\d.])(?=[-+])")
_Decoder = Callable[[bytes], Any]


def read_mcap(
    content: bytes, *, file: str, channel: str, field: str
) -> tuple[Array, Array]:
    """Read times [s] and values of a channel, each (n,).

    It reads messages in JSON and MessagePack, and those of ROS 2 if the package
    ``mcap-ros2-support`` is installed. Times are times of measurement if the messages
    carry them (``stamp_ns`` or ``header.stamp``), otherwise times of logging; in
    records of simulations in lockstep they are simulated times.

    Args:
        content: bytes of the file.
        file: name of the file, for errors.
        channel: topic, with or without its leading slash.
        field: path of a number in the messages, such as ``linear_acceleration.0``.

    Raises:
        ScenarioError: no such file, channel or field; ``field`` is the key to correct.
    """
    times, values = [], []
    decoders: dict[int, _Decoder] = {}
    try:
        reader, channels = _opened(content)
        topics = sorted({about.topic for about in channels})
        slashed = f"/{channel}"  # our records write /imu where others write imu
        wanted = slashed if channel not in topics and slashed in topics else channel
        for schema, about, message in reader.iter_messages(topics=[wanted]):
            if about.id not in decoders:
                decoders[about.id] = _decoder(schema, about, file)
            decoded = decoders[about.id](message.data)
            values.append(_value(decoded, field, channel))
            # In lockstep, stamps tell how fast the machine was.
            is_simulated = about.metadata.get("log_time", "").startswith(SIMULATED)
            stamped = None if is_simulated else decoded
            times.append(_stamp_ns(stamped, message.log_time, channel))
    except ScenarioError:
        raise
    except Exception as error:  # each library has errors of its own for damage
        raise bad_key(
            "file",
            f"{file}: cannot be read as MCAP "
            f"({type(error).__name__}: {short(str(error))}); it is damaged or was cut "
            "off, fetch it again or mend it with `mcap recover`",
        ) from error
    if not values:
        raise bad_key(
            "channel",
            f"{file} has no messages of {channel!r}; it has "
            f"{', '.join(topics) or 'none at all'}",
        )
    stamps = np.array(times, dtype=np.int64)
    order = np.argsort(stamps, kind="stable")  # a logger may swap messages
    stamps, found = stamps[order], np.array(values)[order]
    # A sensor that is slower than its messages sends the same reading again.
    is_new = np.append(True, (np.diff(stamps) != 0) | (np.diff(found) != 0.0))
    return _NANOSECOND * (stamps - stamps[0])[is_new], found[is_new]


def _opened(content: bytes) -> tuple[McapReader, list[Channel]]:
    """Return a reader of a file's messages, and the file's channels.

    The summary gives a faster reader, but may be missing or name no channels.
    """
    reader = make_reader(BytesIO(content), validate_crcs=True)
    summary = reader.get_summary()
    if summary is not None and summary.channels:
        return reader, list(summary.channels.values())
    records = StreamReader(BytesIO(content), validate_crcs=True).records
    channels = [record for record in records if isinstance(record, Channel)]
    return NonSeekingReader(BytesIO(content), validate_crcs=True), channels


def _decoder(schema: Schema | None, channel: Channel, file: str) -> _Decoder:
    if channel.message_encoding == "json":
        return json.loads
    if channel.message_encoding == "msgpack":
        unpack: _Decoder = msgpack.unpackb
        return unpack
    if channel.message_encoding == "cdr":
        try:
            from mcap_ros2.decoder import DecoderFactory
        except ImportError as error:
            raise bad_key(
                "channel",
                f"{file}: {channel.topic!r} holds messages of ROS 2; `pip install "
                "mcap-ros2-support` reads them",
            ) from error
        decode: _Decoder | None = DecoderFactory().decoder_for("cdr", schema)
        if decode is not None:
            return decode
    raise bad_key(
        "channel",
        f"{file}: messages of {channel.topic!r} are {channel.message_encoding!r}, "
        "expected json, msgpack or cdr; export them as .csv",
    )


def _value(message: Any, path: str, channel: str) -> float:
    place = message
    for step in path.split("."):
        try:
            place = _inside(place, step)
        except (KeyError, IndexError, AttributeError, ValueError, TypeError):
            raise bad_key(
                "field", f"messages of {channel!r} have no {path!r}: no {step!r}"
            ) from None
    if isinstance(place, bool) or not isinstance(place, (int, float)):
        raise bad_key(
            "field",
            f"{path!r} of {channel!r} is no number; name one in it, such as {path}.0",
        )
    try:
        value = float(place)
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise bad_key(
            "field",
            f"{path!r} of {channel!r} is {value:g} in a message, expected a finite "
            "number; cut a piece without it out of the file",
        )
    return value


def _inside(place: Any, step: str) -> Any:
    if isinstance(place, dict):
        return place[step]
    if step.isdigit():
        return place[int(step)]
    return getattr(place, step)


def _stamp_ns(message: Any, logged_ns: int, channel: str) -> int:
    """Return the measurement time of a message; without one its log time [ns]."""
    stamp_ns = _whole(_first(message, "stamp_ns"))
    stamp = _first(_first(message, "header"), "stamp")
    if not stamp_ns and stamp is not None:
        seconds = _whole(_first(stamp, "sec", "secs"))
        rest_ns = _whole(_first(stamp, "nanosec", "nsec", "nsecs"))
        stamp_ns = seconds * 1_000_000_000 + rest_ns
    stamp_ns = stamp_ns if stamp_ns > 0 else logged_ns
    if stamp_ns >= _LATEST_NS:
        raise bad_key(
            "channel",
            f"a message of {channel!r} has the stamp {short(str(stamp_ns))} ns, "
            f"expected less than {_LATEST_NS}; what wrote it has no sound clock",
        )
    return stamp_ns


def _first(place: Any, *names: str) -> Any:
    """Return the first of these fields that a message has; None when it has none."""
    if isinstance(place, dict):
        return next((place[name] for name in names if name in place), None)
    return next((getattr(place, name) for name in names if hasattr(place, name)), None)


def _whole(stamp: Any) -> int:
    """Return a stamp as a whole number, 0 if it is none; JSON may have it as text."""
    if isinstance(stamp, str) and re.fullmatch(r"[0-9]{1,25}", stamp):
        return int(stamp)
    if isinstance(stamp, float):
        return int(stamp) if math.isfinite(stamp) else 0
    return stamp if isinstance(stamp, int) else 0


def short(text: str) -> str:
    """Return text of a file, shortened for an error message."""
    return text if len(text) <= 60 else f"{text[:60]}..."


def bad_key(key: str, what: str) -> ScenarioError:
    """Return the error for a key of a recorded motion."""
    return ScenarioError(f"{key}: {what}", field=key)


@dataclass(frozen=True)
class Numbers:
    """Reads the numbers of a text file, also in Fortran's notation.

    Attributes:
        file: name of the file, for errors.
        decimal_comma: whether 0,5 is a half; then no number has a point.
    """

    file: str
    decimal_comma: bool = False

    def __call__(
        self, word: str, what: str, *, line: int = 0, above: float = -math.inf
    ) -> float:
        """Return a finite number.

        Raises:
            ScenarioError: the word is no number, or not above the bound.
        """
        plain = word.strip()
        if self.decimal_comma:
            plain = plain.replace(".", "?").replace(",", ".")
        value = math.nan
        if _NUMBER.fullmatch(plain):
            value = float(plain.upper().replace("D", "E"))
        if math.isfinite(value) and value > above:
            return value
        bound = "" if above == -math.inf else f" above {above:g}"
        mark = " with a decimal comma" if self.decimal_comma else ""
        raise self.bad(what, word, f"a number{bound}{mark}", line=line)

    def bad(
        self, what: str, got: str, expected: str, *, line: int = 0
    ) -> ScenarioError:
        """Return the error for text that is not the expected number."""
        place = f", line {line}" if line else ""
        got = repr(short(got)) if got.strip() else "nothing"
        return bad_key(
            "file",
            f"{self.file}{place}: {what} is {got}, expected {expected}; mend or remove "
            "it",
        )

    def rows(self, lines: Iterable[str], *, first_line: int) -> Array:
        """Return all numbers of some lines, (n,); in fixed widths they may touch."""
        return np.array(
            [
                self(part, "a value", line=at)
                for at, line in enumerate(lines, start=first_line)
                for word in line.split()
                for part in _parts(word)
            ],
            dtype=np.float64,
        )

    def enough(self, found: int, told: float) -> None:
        """Check that there are at least as many values as the heading says."""
        if found < math.floor(told + 1e-6):
            raise bad_key(
                "file",
                f"{self.file}: holds {found} values and its heading says {told:g}; "
                "it was cut off, fetch it again",
            )

    def no_more(self, found: int, told: float, lines: Iterable[str]) -> None:
        """Check that values beyond the heading's count only fill the last row."""
        words = ([_parts(word) for word in line.split()] for line in lines)
        row = max((sum(map(len, line)) for line in words), default=0)
        if found >= told + row:
            raise bad_key(
                "file",
                f"{self.file}: holds {found} values and its heading says {told:g}; one "
                "of the two is wrong, fetch it again or mend the heading",
            )


def _parts(word: str) -> list[str]:
    """Return touching numbers one by one; leave an exponent such as 1.5-101 whole."""
    parts = _RUN_TOGETHER.split(word)
    return parts if all("." in part for part in parts) else [word]


def plain_units(units: str) -> str:
    """Return the units of a heading, however written, in the spelling of scenarios."""
    plain = re.sub(r"[\s().]", "", units.lower()).replace("°", "deg")
    plain = plain.replace("seconds", "s").replace("second", "s").replace("sec", "s")
    plain = re.sub(r"/s(/s|\*\*2|\^2|2|²)$", "/s2", plain)
    return re.sub(r"^(g|gal)'?s$", r"\1", plain)


def is_number(cell: str, delimiter: str) -> bool:
    """Return whether a cell is a number; between tabs or semicolons 0,5 is one."""
    plain = cell.strip().strip('"')
    if delimiter in ";\t":
        plain = plain.replace(",", ".")
    return _NUMBER.fullmatch(plain) is not None
