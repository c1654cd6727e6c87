"""Messages of a bus as text, and statistics of their timing."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
from rich.table import Table

from surefoot.cli.console import new_table
from surefoot.errors import UsageError
from surefoot.robot_io.client_side.listener import RawMessage
from surefoot.robot_io.realtime import distribution_of
from surefoot.schemas.arrays import NS_PER_MS, NS_PER_S
from surefoot.schemas.codec import decode, decode_head
from surefoot.schemas.errors import MessageError
from surefoot.schemas.reasons import NONE, given
from surefoot.schemas.result import Distribution
from surefoot.schemas.topics import Topic
from surefoot.schemas.validation import nearest

_DIGITS = ".6g"
_HEADER = ("schema", "tick", "stamp_ns")
RESTART_TICKS = 1000
"""A tick this far behind the newest belongs to a new run, not to a late message."""
_FINE_MS, _COARSE_MS = 10.0, 100.0
"""Below these, two digits and one digit after the point are shown [ms]."""
_HEADINGS = (
    "Hz",
    *("jitter\nmedian", "(ms)\np99", "\nmax"),
    *("delay\nmedian", "(ms)\np99", "\nmax"),
    *("gaps", "double", "late", "bad"),
)


def check_fields(paths: Iterable[str], kind: type[msgspec.Struct]) -> None:
    """Refuse paths whose first part is not a field of the message.

    Raises:
        UsageError: a path is wrong; names the nearest valid field.
    """
    names = [field.encode_name for field in msgspec.structs.fields(kind)]
    for path in paths:
        name = path.split(".")[0]
        if name not in names:
            raise UsageError(
                f"--field {path}: {kind.__name__} has no {name!r}"
                f"{nearest(name, names)}; fields are {', '.join(names)}"
            )


def pick(message: Any, path: str) -> Any:
    """Return the value at a path of a message, of built-in types.

    Raises:
        UsageError: the message has nothing at this path.
    """
    value = message
    for part in path.split("."):
        try:
            value = value[int(part)] if isinstance(value, list) else value[part]
        except (KeyError, ValueError, IndexError, TypeError) as error:
            raise UsageError(
                f"--field {path}: nothing at {part!r}; {_there_is(value)}"
            ) from error
    return value


def _there_is(value: Any) -> str:
    if isinstance(value, list):
        return f"there are {len(value)} entries, 0 to {len(value) - 1}"
    if isinstance(value, dict):
        return f"there are {', '.join(map(str, value)) or 'no entries'}"
    return f"the value is {value!r} and has no parts"


def message_lines(channel: str, message: dict[str, Any], *, size: int) -> list[str]:
    """Return a message as lines of text."""
    fields = {name: value for name, value in message.items() if name not in _HEADER}
    return [
        f"{channel}  tick {message['tick']}, "
        f"stamp {message['stamp_ns'] / NS_PER_S:.6f} s, {size} bytes",
        *field_lines(fields),
    ]


def field_lines(fields: dict[str, Any]) -> list[str]:
    """Return one indented line per field, with aligned values."""
    width = max(map(len, fields), default=0)
    return [f"  {name:<{width}}  {text_of(value)}" for name, value in fields.items()]


def text_of(value: Any) -> str:
    """Return a value as text, floats with six significant digits."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return format(value, _DIGITS)
    if isinstance(value, list):
        return f"[{', '.join(map(text_of, value))}]"
    if isinstance(value, dict):
        return ", ".join(f"{k} {text_of(v)}" for k, v in value.items()) or NONE
    return str(value) if value != "" else NONE


class Echo:
    """Formats messages of one channel.

    Attributes:
        count: messages shown so far.
    """

    def __init__(
        self,
        topic: Topic,
        *,
        joint_count: int,
        fields: Iterable[str],
        rate_hz: float | None,
        as_json: bool,
    ) -> None:
        """Store what to show: all fields if empty, all messages if the rate is None."""
        self.count = 0
        self._topic, self._joint_count = topic, joint_count
        self._fields = list(fields)
        self._pause_ns = 0 if rate_hz is None else round(NS_PER_S / rate_hz)
        self._due_ns = 0
        self._as_json = as_json

    def lines(self, heard: RawMessage) -> list[str]:
        """Return the lines to print for a message; none when the rate skips it.

        Raises:
            UsageError: the message has no such field.
        """
        if heard.received_ns < self._due_ns:
            return []
        self._due_ns = heard.received_ns + self._pause_ns
        self.count += 1
        try:
            message = decode(
                heard.data, self._topic.message, joint_count=self._joint_count
            )
        except MessageError as error:
            return self._malformed(str(error), size=len(heard.data))
        return self._shown(msgspec.to_builtins(message), size=len(heard.data))

    def _shown(self, message: dict[str, Any], *, size: int) -> list[str]:
        if not self._fields:
            if self._as_json:
                return [_json(message)]
            return message_lines(self._topic.name, message, size=size)
        picked = {path: pick(message, path) for path in self._fields}
        if self._as_json:
            return [_json({"tick": message["tick"], **picked})]
        return [f"{self._topic.name}  tick {message['tick']}", *field_lines(picked)]

    def _malformed(self, reason: str, *, size: int) -> list[str]:
        if self._as_json:
            return [_json({"malformed": reason, "bytes": size})]
        return [f"{self._topic.name}  MALFORMED, {size} bytes: {reason}"]


def _json(value: dict[str, Any]) -> str:
    return json.dumps(value, ensure_ascii=False)


class ChannelTiming(msgspec.Struct, kw_only=True):
    """One line of ``surefoot hz``.

    Rate, jitter and delay are taken over the window, the counts over everything heard.
    """

    channel: str
    messages: int
    rate_hz: float | None
    """None with fewer than two messages in the window."""
    period_ms: float | None
    """Median time between two messages."""
    jitter_ms: Distribution | None
    """Absolute deviation of the times between messages from that median."""
    delay_ms: Distribution | None
    """From the sender's stamp to receipt; None when their clocks differ."""
    gaps: int | None
    """Missing ticks; None for a channel that does not publish every tick."""
    duplicates: int | None
    out_of_order: int | None
    restarts: int | None
    unreadable: int


class TimingMeter:
    """Collects the timing of one channel's messages."""

    def __init__(
        self, channel: str, *, every_tick: bool, window_s: float, has_delay: bool
    ) -> None:
        """Start empty.

        Args:
            channel: name of the channel.
            every_tick: the channel publishes every tick, so ticks can be missing.
            window_s: time over which rate, jitter and delay are taken [s].
            has_delay: stamps and receipts use the same clock.
        """
        self._channel, self._every_tick = channel, every_tick
        self._window_ns = round(window_s * NS_PER_S)
        self._has_delay = has_delay
        self._recent: deque[tuple[int, int]] = deque()
        self._messages = self._unreadable = 0
        self._newest: int | None = None
        self._gaps = self._duplicates = self._late = self._restarts = 0

    def add(self, data: bytes, *, received_ns: int) -> None:
        """Count a message, malformed or not."""
        self._messages += 1
        try:
            head = decode_head(data)
        except MessageError:
            self._unreadable += 1
            return
        self._recent.append((received_ns, received_ns - head.stamp_ns))
        self._forget_before(received_ns - self._window_ns)
        if self._every_tick:
            self._count(head.tick)

    def timing(self, now_ns: int) -> ChannelTiming:
        """Summarise the channel at a time of the monotonic clock [ns]."""
        self._forget_before(now_ns - self._window_ns)
        received = [time for time, _ in self._recent]
        periods = [(b - a) / NS_PER_MS for a, b in pairwise(received)]
        span_s = (received[-1] - received[0]) / NS_PER_S if periods else 0.0
        period = float(np.median(periods)) if periods else None
        delays = [delay / NS_PER_MS for _, delay in self._recent]
        counts = self._every_tick
        return ChannelTiming(
            channel=self._channel,
            messages=self._messages,
            rate_hz=len(periods) / span_s if span_s > 0.0 else None,
            period_ms=period,
            jitter_ms=(
                None
                if period is None
                else distribution_of([abs(value - period) for value in periods])
            ),
            delay_ms=distribution_of(delays) if self._has_delay and delays else None,
            gaps=self._gaps if counts else None,
            duplicates=self._duplicates if counts else None,
            out_of_order=self._late if counts else None,
            restarts=self._restarts if counts else None,
            unreadable=self._unreadable,
        )

    def _count(self, tick: int) -> None:
        newest = self._newest
        if newest is None or tick < newest - RESTART_TICKS:
            self._restarts += newest is not None
            self._newest = tick
        elif tick == newest:
            self._duplicates += 1
        elif tick < newest:
            self._late += 1
        else:
            self._gaps += tick - newest - 1
            self._newest = tick

    def _forget_before(self, time_ns: int) -> None:
        while self._recent and self._recent[0][0] < time_ns:
            self._recent.popleft()


def hz_table(timings: Iterable[ChannelTiming]) -> Table:
    """Return a table with one row per channel."""
    table = new_table("", figures=("channel", *_HEADINGS), boxed=False)
    table.columns[0].justify, table.padding = "left", (0, 1, 0, 0)
    for timing in timings:
        table.add_row(
            timing.channel,
            given(timing.rate_hz, ".1f"),
            *_times(timing.jitter_ms),
            *_times(timing.delay_ms),
            given(timing.gaps),
            given(timing.duplicates),
            given(timing.out_of_order),
            str(timing.unreadable),
        )
    return table


def _times(times: Distribution | None) -> tuple[str, str, str]:
    if times is None:
        return NONE, NONE, NONE
    return _ms(times.median), _ms(times.p99), _ms(times.max)


def _ms(value: float) -> str:
    """Format milliseconds with three significant digits, in four or five characters."""
    if abs(value) < _FINE_MS:
        return f"{value:.2f}"
    return f"{value:.1f}" if abs(value) < _COARSE_MS else f"{value:.0f}"
