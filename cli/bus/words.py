"""Messages in words: a heading and one line a field."""

from __future__ import annotations

from typing import Any

NS_PER_S = 1e9
_DIGITS = ".6g"
_HEADER = ("schema", "tick", "stamp_ns")


def message_lines(channel: str, message: dict[str, Any], *, size: int) -> list[str]:
    """A message as lines of text.

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
    """One indented line a field, the values under each other."""
    width = max(map(len, fields), default=0)
    return [f"  {name:<{width}}  {text_of(value)}" for name, value in fields.items()]


def text_of(value: Any) -> str:
    """A value in few digits."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return format(value, _DIGITS)
    if isinstance(value, list):
        return f"[{', '.join(map(text_of, value))}]"
    if isinstance(value, dict):
        return ", ".join(f"{k} {text_of(v)}" for k, v in value.items()) or "-"
    return str(value) if value != "" else "-"
