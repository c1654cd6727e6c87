"""Names of the keys a file format knows, and of the values a key may have."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

import msgspec
import msgspec.inspect

_INDEX = re.compile(r"\[[^\]]*\]")


def nearest(name: str, known: Iterable[str]) -> str:
    """Word a hint for an unknown name.

    Returns:
        ``; did you mean 'standing'?`` when a known name is near; otherwise nothing.
    """
    near = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def suggest_key(field: str, kind: type[msgspec.Struct]) -> str:
    """Word a hint for an unknown key.

    Args:
        field: its path, such as ``platform[0].motion[1].frequency``.
        kind: the struct the whole file should have been.

    Returns:
        ``; did you mean 'frequency_hz'?`` when a valid key of the same table is
        near, otherwise the list of the valid ones, each starting with ``;``.
    """
    structs, name = _structs_around(field, kind)
    names = sorted(set(_key_names(structs)))
    near = difflib.get_close_matches(name, names, n=1)
    if near:
        return f"; did you mean {near[0]!r}?"
    return f"; valid are {', '.join(names)}" if names else ""


def valid_values(field: str, kind: type[msgspec.Struct]) -> list[str]:
    """Return the texts that a field may hold, if they are limited.

    Args:
        field: its path, such as ``platform[0].motion[1].axis``.
        kind: the struct the whole should have been.

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

    None for a table that may be one of several kinds.
    """
    structs, _ = _structs_around(field, kind)
    if len(structs) != 1:
        return []
    return [member.encode_name for member in structs[0].fields if member.required]


def items_of(field: str, kind: type[msgspec.Struct]) -> str:
    """Word what a list holds: ``texts``, ``numbers``; empty when that is unknown."""
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


def _key_names(structs: Iterable[msgspec.inspect.StructType]) -> Iterable[str]:
    for struct in structs:
        if struct.tag_field is not None:
            yield struct.tag_field
        for member in struct.fields:
            yield member.encode_name


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
