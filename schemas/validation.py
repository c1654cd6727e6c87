"""Explains what is wrong with a message or table: place, value, valid values."""

from __future__ import annotations

import difflib
import math
import re
import sys
from collections.abc import Iterable
from functools import cache
from typing import Any, NamedTuple

import msgspec
import msgspec.inspect

_LONGEST = 60
_WORDS = {
    "float": "a number",
    "int": "a whole number",
    "str": "a text",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
}


class NonFinite(NamedTuple):
    """A NaN or infinity, and its place."""

    path: str
    value: float


def find_non_finite(
    value: Any, path: str = "", *, largest: float = sys.float_info.max
) -> NonFinite | None:
    """Find the first NaN or infinity at any depth.

    Args:
        value: a number, struct, list or dict; other types contain no numbers.
        path: path of ``value`` itself, put before the path that is found.
        largest: a larger number counts as infinite; for structs only the default works.

    Returns:
        The first one found, or None when every number is finite.
    """
    if isinstance(value, float):
        return None if abs(value) <= largest else NonFinite(path, value)
    if isinstance(value, (list, tuple)):
        places = ((f"{path}[{index}]", item) for index, item in enumerate(value))
        return _first(places, largest)
    if isinstance(value, msgspec.Struct):
        if _surely_finite(value):
            return None
        value = {name: getattr(value, name) for name in value.__struct_fields__}
    if isinstance(value, dict):
        prefix = f"{path}." if path else ""
        places = ((f"{prefix}{name}", item) for name, item in value.items())
        return _first(places, largest)
    return None


def _first(places: Iterable[tuple[str, Any]], largest: float) -> NonFinite | None:
    for path, item in places:
        found = find_non_finite(item, path, largest=largest)
        if found is not None:
            return found
    return None


def _surely_finite(message: msgspec.Struct) -> bool:
    """Check by sums (a finite sum has finite terms): one microsecond per message."""
    fields = _float_fields(type(message))
    if fields is None:
        return False
    total = 0.0
    for name in fields.numbers:
        total += getattr(message, name)
    for name in fields.lists:
        total += sum(getattr(message, name))
    return math.isfinite(total)


class _FloatFields(NamedTuple):
    """Names of the fields that hold floats."""

    numbers: tuple[str, ...]
    lists: tuple[str, ...]


@cache
def _float_fields(kind: type[msgspec.Struct]) -> _FloatFields | None:
    """Return the fields with floats; None when some are nested deeper than a list."""
    numbers, lists = [], []
    for field in msgspec.structs.fields(kind):
        info = msgspec.inspect.type_info(field.type)
        if isinstance(info, msgspec.inspect.FloatType):
            numbers.append(field.name)
        elif isinstance(info, msgspec.inspect.ListType):
            if not isinstance(info.item_type, msgspec.inspect.FloatType):
                return None
            lists.append(field.name)
        elif not isinstance(info, _WITHOUT_FLOATS):
            return None
    return _FloatFields(tuple(numbers), tuple(lists))


_WITHOUT_FLOATS = (
    msgspec.inspect.IntType,
    msgspec.inspect.StrType,
    msgspec.inspect.BoolType,
    msgspec.inspect.EnumType,
)


_INDEX = re.compile(r"\[[^\]]*\]")


def nearest(name: str, known: Iterable[str]) -> str:
    """Word a hint for an unknown name.

    Returns:
        ``; did you mean 'standing'?`` when a known name is near, otherwise "".
    """
    by_letters = {other.lower(): other for other in known}
    near = difflib.get_close_matches(name.lower(), by_letters, n=1)
    return f"; did you mean {by_letters[near[0]]!r}?" if near else ""


def nearest_or_all(name: str, known: Iterable[str]) -> str:
    """Word a hint for an unknown name: the nearest known one, or else all of them.

    Returns:
        ``; did you mean 'standing'?`` or ``; valid are ...``.
    """
    names = sorted(set(known))
    others = f"; valid are {', '.join(names)}" if names else ""
    return nearest(name, names) or others


def suggest_key(field: str, kind: type[msgspec.Struct]) -> str:
    """Word a hint for an unknown key.

    Args:
        field: its path, such as ``platform[0].motion[1].frequency``.
        kind: struct that the whole file was to be.

    Returns:
        ``; did you mean 'frequency_hz'?`` when a valid key of the same table is
        near, otherwise the list of the valid ones, each starting with ``;``.
    """
    structs, name = _structs_around(field, kind)
    names = [s.tag_field for s in structs if s.tag_field is not None]
    names += [member.encode_name for s in structs for member in s.fields]
    return nearest_or_all(name, names)


def valid_values(field: str, kind: type[msgspec.Struct]) -> list[str]:
    """Return the valid texts of a field, if they are limited.

    Args:
        field: its path, such as ``platform[0].motion[1].axis``.
        kind: struct that the whole was to be.

    Returns:
        The texts in the order of their definition; none for any other field.
    """
    structs, name = _structs_around(field, kind)
    values: dict[str, None] = {}
    for struct in structs:
        if struct.tag_field == name:
            values[str(struct.tag)] = None
        for member in struct.fields:
            if member.encode_name == name:
                values.update(dict.fromkeys(_texts(member.type)))
    return list(values)


def required_keys(field: str, kind: type[msgspec.Struct]) -> list[str]:
    """Return the keys that the table around a field must have, in their order.

    The list is empty for a table that may be one of several kinds.
    """
    structs, _ = _structs_around(field, kind)
    if len(structs) != 1:
        return []
    return [member.encode_name for member in structs[0].fields if member.required]


def items_of(field: str, kind: type[msgspec.Struct]) -> str:
    """Name the kind of items in a list: ``texts``, ``numbers``; empty when unknown."""
    structs, name = _structs_around(field, kind)
    infos = [
        member.type
        for struct in structs
        for member in struct.fields
        if member.encode_name == name
    ]
    return next(filter(None, map(_items, infos)), "")


def _items(info: msgspec.inspect.Type) -> str:
    if isinstance(info, msgspec.inspect.UnionType):
        return next(filter(None, map(_items, info.types)), "")
    if isinstance(info, msgspec.inspect.TupleType):
        return f"{len(info.item_types)} {_plural(info.item_types[0])}"
    if isinstance(info, msgspec.inspect.ListType):
        is_fixed = info.min_length is not None and info.min_length == info.max_length
        count = f"{info.min_length} " if is_fixed else ""
        return count + _plural(info.item_type)
    return ""


def _plural(info: msgspec.inspect.Type) -> str:
    if isinstance(info, (msgspec.inspect.FloatType, msgspec.inspect.IntType)):
        return "numbers"
    if isinstance(info, msgspec.inspect.StrType):
        return "texts"
    return "tables" if _structs(info) else "entries"


def _structs_around(
    field: str, kind: type[msgspec.Struct]
) -> tuple[list[msgspec.inspect.StructType], str]:
    """Return the structs that may hold the last key of a path, and that key."""
    *parents, name = _INDEX.sub("", field).split(".")
    structs = _structs(msgspec.inspect.type_info(kind))
    for parent in parents:
        structs = [
            inner
            for struct in structs
            for member in struct.fields
            if member.encode_name == parent
            for inner in _structs(member.type)
        ]
    return structs, name


def _texts(info: msgspec.inspect.Type) -> list[str]:
    """Return the texts that a type allows, if they are limited."""
    if isinstance(info, msgspec.inspect.LiteralType):
        return [value for value in info.values if isinstance(value, str)]
    if isinstance(info, msgspec.inspect.EnumType):
        return [str(member.value) for member in info.cls]
    if isinstance(info, msgspec.inspect.UnionType):
        return [text for kind in info.types for text in _texts(kind)]
    if isinstance(info, msgspec.inspect.ListType):
        return _texts(info.item_type)
    if isinstance(info, msgspec.inspect.Metadata):
        return _texts(info.type)
    return []


def _structs(info: msgspec.inspect.Type) -> list[msgspec.inspect.StructType]:
    """Return the struct types in a type: itself, its items or its alternatives."""
    if isinstance(info, msgspec.inspect.StructType):
        return [info]
    if isinstance(info, msgspec.inspect.ListType):
        return _structs(info.item_type)
    if isinstance(info, msgspec.inspect.DictType):
        return _structs(info.value_type)
    if isinstance(info, msgspec.inspect.UnionType):
        return [struct for kind in info.types for struct in _structs(kind)]
    if isinstance(info, msgspec.inspect.Metadata):
        return _structs(info.type)
    return []


_PLACE = re.compile(r" - at `(?:key` in `)?\$\.?([^`]*)`$")
_WITHIN = re.compile(r"^at `([^`]+)`: ")
"""How a check of a whole struct names the wrong field."""
_NAMED_FIELD = re.compile(r"field `([^`]+)`")
_CHOICE = re.compile(r"^Invalid (?:enum )?value ")
_EXPECTED = re.compile(r"^Expected `([^`]+)`(.*?)(?:, got `[^`]+`)?$")
_ANY_KEY = "[...]"
"""What msgspec calls a key of a table that may have any."""
_KEY = re.compile(r"\[([^\d.\]][^\]]*)\]")
_STEP = re.compile(r"\[(\d+)\]|([^.\[\]]+)")


def explain(
    error: msgspec.ValidationError, raw: Any, kind: type[msgspec.Struct]
) -> tuple[str, str]:
    """Split a validation error into place and complaint.

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
    if _ANY_KEY in path:
        path = _with_key(path, error, raw, kind)
    within = _WITHIN.match(text)
    if within:
        path = f"{path}.{within.group(1)}" if path else within.group(1)
        return path, text[within.end() :]
    named = _NAMED_FIELD.search(text)
    if named:
        path = f"{path}.{named.group(1)}" if path else named.group(1)
        if text.startswith("Object missing"):
            return path, _missing(path, raw, kind)
        return path, text + _choices(valid_values(path, kind), None)
    return path, _reworded(text, path, raw, kind)


def dotted(path: str) -> str:
    """Return a path as TOML writes it: keys behind dots, places in brackets."""
    return _KEY.sub(r".\1", path)


def _with_key(
    path: str, error: msgspec.ValidationError, raw: Any, kind: type[msgspec.Struct]
) -> str:
    """Say which key of a table that may have any is meant: ``profiles[mine].lag_s``."""
    around, _, rest = path.partition(_ANY_KEY)
    table, is_found = _value_at(raw, around)
    for key, value in table.items() if is_found and isinstance(table, dict) else ():
        try:
            msgspec.convert(_replaced(raw, around, {key: value}), kind)
        except msgspec.ValidationError as alone:
            if str(alone) == str(error):
                return f"{around}[{key}]{rest}"
    return path


def _replaced(raw: Any, path: str, value: Any) -> Any:
    """A table with another value at a path of keys."""
    name, _, rest = path.partition(".")
    return {**raw, name: _replaced(raw[name], rest, value) if rest else value}


def _reworded(text: str, path: str, raw: Any, kind: type[msgspec.Struct]) -> str:
    got, is_found = _value_at(raw, path)
    if not is_found:
        return text
    if _CHOICE.match(text):
        return f"got {_short(got)}{_choices(valid_values(path, kind), got)}"
    expected = _EXPECTED.match(text)
    if expected is None:
        return text
    names = [name.strip() for name in expected[1].split("|")]
    what = " or ".join(_WORDS.get(name, name) for name in names if name != "null")
    if expected[1].startswith("array") and isinstance(got, dict):
        what = f"a list of tables: write [[{path}]]"
    elif expected[1].startswith("array") and items_of(path, kind):
        what = f"a list of {items_of(path, kind)}"
    else:
        what += expected[2].replace("-0.0", "0.0")  # of what has to be negative
    return f"got {_short(got)}, expected {what}"


def _missing(path: str, raw: Any, kind: type[msgspec.Struct]) -> str:
    """Say that a key is missing, and name the other missing ones."""
    around, _, name = path.rpartition(".")
    table, _ = _value_at(raw, around)
    others = [key for key in required_keys(path, kind) if key not in {name, *table}]
    also = f", and so {'are' if len(others) > 1 else 'is'} {', '.join(others)}"
    choices = _choices(valid_values(path, kind), None)
    return f"is missing{choices}{also if others else ''}"


def _choices(valid: list[str], got: Any) -> str:
    if not valid:
        return ""
    hint = nearest(got, valid) if isinstance(got, str) else ""
    return f", expected one of {', '.join(map(repr, valid))}{hint}"


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
