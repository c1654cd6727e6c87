"""Turns what is heard on a channel into lines."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable
from typing import Any

import msgspec

from surefoot.errors import UsageError
from surefoot.robot_io.client_side.listener import RawMessage
from surefoot.schemas.codec import decode
from surefoot.schemas.errors import MessageError
from surefoot.schemas.topics import Topic

NS_PER_S = 1e9
_DIGITS = ".6g"
_HEADER = ("schema", "tick", "stamp_ns")


def check_fields(paths: Iterable[str], kind: type[msgspec.Struct]) -> None:
    """Refuse paths whose first part is no field of the message.

    Raises:
        UsageError: with the nearest valid name.
    """
    names = [field.encode_name for field in msgspec.structs.fields(kind)]
    for path in paths:
        name = path.split(".")[0]
        if name not in names:
            near = difflib.get_close_matches(name, names, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise UsageError(
                f"--field {path}: {kind.__name__} has no {name!r}; {hint}"
                f"fields are {', '.join(names)}"
            )


def pick(message: Any, path: str) -> Any:
    """Return the value at a path of a message, as built-in types.

    Raises:
        UsageError: this message has nothing there.
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
    """Return a message as lines of text.

    Args:
        channel: its name.
        message: as :func:`msgspec.to_builtins` gives it.
        size: on the bus [bytes].
    """
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
    """Return a value in few digits."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return format(value, _DIGITS)
    if isinstance(value, list):
        return f"[{', '.join(map(text_of, value))}]"
    if isinstance(value, dict):
        return ", ".join(f"{k} {text_of(v)}" for k, v in value.items()) or "-"
    return str(value) if value != "" else "-"


class Echo:
    """Shows messages of one channel.

    Attributes:
        count: messages shown, malformed ones included.
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
        """Keep what to show.

        Args:
            topic: the channel.
            joint_count: n_a of the robot.
            fields: paths; all of the message when there are none.
            rate_hz: most messages shown in a second; others are passed over.
            as_json: a JSON object instead of words.
        """
        self.count = 0
        self._topic, self._joint_count = topic, joint_count
        self._fields = list(fields)
        self._pause_ns = 0 if rate_hz is None else round(NS_PER_S / rate_hz)
        self._due_ns = 0
        self._as_json = as_json

    def lines(self, heard: RawMessage) -> list[str]:
        """Return lines to print for a message; none when it is passed over.

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
