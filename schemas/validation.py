"""Reads msgspec's validation errors: where, what came, and what would be valid."""

from __future__ import annotations

import difflib
import re
from typing import Any

import msgspec

from surefoot.schemas.key_names import items_of, required_keys, valid_values

_PLACE = re.compile(r" - at `(?:key` in `)?\$\.?([^`]*)`$")
_NAMED_FIELD = re.compile(r"field `([^`]+)`")
_CHOICE = re.compile(r"^Invalid (?:enum )?value ")
_EXPECTED = re.compile(r"^Expected `([^`]+)`(.*?)(?:, got `[^`]+`)?$")
_STEP = re.compile(r"\[(\d+)\]|([^.\[\]]+)")
_LONGEST = 60
_WORDS = {
    "float": "a number",
    "int": "a whole number",
    "str": "a text",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
}


def explain(
    error: msgspec.ValidationError, raw: Any, kind: type[msgspec.Struct]
) -> tuple[str, str]:
    """Take a validation error apart.

    Args:
        error: what msgspec said.
        raw: what was to be turned into a struct.
        kind: the struct.

    Returns:
        Path of the offending field, such as ``platform[0].motion[1].axis`` (empty
        when the whole is at fault), and the complaint without the path: what came,
        what was expected, and the valid values where there are only some.
    """
    text = str(error)
    place = _PLACE.search(text)
    path = place.group(1) if place else ""
    if place:
        text = text[: place.start()]
    named = _NAMED_FIELD.search(text)
    if named:
        path = f"{path}.{named.group(1)}" if path else named.group(1)
        if text.startswith("Object missing"):
            return path, _missing(path, raw, kind)
        return path, text + _choices(valid_values(path, kind), None)
    return path, _reworded(text, path, raw, kind)


def _reworded(text: str, path: str, raw: Any, kind: type[msgspec.Struct]) -> str:
    got, is_found = _value_at(raw, path)
    if not is_found:
        return text
    if _CHOICE.match(text):
        return f"got {_short(got)}{_choices(valid_values(path, kind), got)}"
    expected = _EXPECTED.match(text)
    if expected is None:
        return text
    what = " or ".join(
        _WORDS.get(name.strip(), name.strip()) for name in expected[1].split("|")
    )
    if _is_lone_table(expected[1], got):
        what = f"a list of tables: write [[{path}]]"
    elif expected[1].startswith("array") and items_of(path, kind):
        what = f"a list of {items_of(path, kind)}"
    else:
        what += expected[2]
    return f"got {_short(got)}, expected {what}"


def _missing(path: str, raw: Any, kind: type[msgspec.Struct]) -> str:
    """Say that a key is missing, and which others are."""
    around, _, name = path.rpartition(".")
    table, _ = _value_at(raw, around)
    others = [key for key in required_keys(path, kind) if key not in {name, *table}]
    also = f", and so {'are' if len(others) > 1 else 'is'} {', '.join(others)}"
    choices = _choices(valid_values(path, kind), None)
    return f"is missing{choices}{also if others else ''}"


def _is_lone_table(expected: str, got: Any) -> bool:
    """Return whether a table stands for a list of tables: [x] instead of [[x]]."""
    return expected.startswith("array") and isinstance(got, dict)


def _choices(valid: list[str], got: Any) -> str:
    if not valid:
        return ""
    words = f", expected one of {', '.join(map(repr, valid))}"
    near = difflib.get_close_matches(got, valid, n=1) if isinstance(got, str) else []
    return f"{words}; did you mean {near[0]!r}?" if near else words


def _value_at(raw: Any, path: str) -> tuple[Any, bool]:
    """Return the value at a path, and whether there is one."""
    for index, name in _STEP.findall(path):
        try:
            raw = raw[int(index)] if index else raw[name]
        except (KeyError, IndexError, TypeError):
            return None, False
    return raw, True


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
