"""Picks fields of a message by path, such as ``q.0`` or ``force``."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

import msgspec

from cli.errors import UsageError


def check_fields(paths: Iterable[str], kind: type[msgspec.Struct]) -> None:
    """Refuses paths whose first part is no field of the message.

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
    """The value at a path of a message, as :func:`msgspec.to_builtins` gives it.

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
