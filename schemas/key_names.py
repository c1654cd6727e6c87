"""Names of the keys a file format knows, for a helpful word about an unknown one."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

import msgspec
import msgspec.inspect

_INDEX = re.compile(r"\[[^\]]*\]")


def suggest_key(field: str, kind: type[msgspec.Struct]) -> str:
    """Words a hint for an unknown key.

    Args:
        field: its path, such as ``platform[0].motion[1].frequency``.
        kind: the struct the whole file should have been.

    Returns:
        ``; did you mean 'frequency_hz'?`` when a valid key of the same table is
        near, otherwise the list of the valid ones, each starting with ``;``.
    """
    *parents, name = _INDEX.sub("", field).split(".")
    structs: list[msgspec.inspect.StructType] = _structs(
        msgspec.inspect.type_info(kind)
    )
    for parent in parents:
        structs = [
            inner
            for struct in structs
            for member in struct.fields
            if member.encode_name == parent
            for inner in _structs(member.type)
        ]
    names = sorted(set(_key_names(structs)))
    near = difflib.get_close_matches(name, names, n=1)
    if near:
        return f"; did you mean {near[0]!r}?"
    return f"; valid are {', '.join(names)}" if names else ""


def _key_names(structs: Iterable[msgspec.inspect.StructType]) -> Iterable[str]:
    for struct in structs:
        if struct.tag_field is not None:
            yield struct.tag_field
        for member in struct.fields:
            yield member.encode_name


def _structs(info: msgspec.inspect.Type) -> list[msgspec.inspect.StructType]:
    """Struct types directly behind a type: itself, its items or its alternatives."""
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
