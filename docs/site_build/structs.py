"""Structs inside structs."""

from __future__ import annotations

import msgspec
import msgspec.inspect as inspect


def structs_within(kind: type[msgspec.Struct]) -> list[type[msgspec.Struct]]:
    """A struct and all structs at any depth of its fields, outer ones first."""
    found: dict[type[msgspec.Struct], None] = {}

    def visit(info: inspect.Type) -> None:
        match info:
            case inspect.StructType(cls=cls, fields=fields):
                found[cls] = None
                for field in fields:
                    visit(field.type)
            case inspect.ListType(item_type=inner) | inspect.DictType(value_type=inner):
                visit(inner)
            case inspect.UnionType(types=options):
                for option in options:
                    visit(option)

    visit(inspect.type_info(kind))
    return list(found)
