"""Structs inside structs, and where a TOML file writes them."""

from __future__ import annotations

import msgspec
import msgspec.inspect as inspect


def structs_within(kind: type[msgspec.Struct]) -> dict[type[msgspec.Struct], str]:
    """A struct and all structs at any depth of its fields, outer ones first.

    Returns:
        Struct to the head of its table in TOML, such as ``[[platform.motion]]``;
        empty for the outermost.
    """
    found: dict[type[msgspec.Struct], str] = {}

    def visit(info: inspect.Type, path: str, brackets: str) -> None:
        match info:
            case inspect.StructType(cls=cls, fields=fields):
                head = f"{brackets[:2]}{path}{brackets[2:]}" if path else ""
                found.setdefault(cls, head.replace(" ", ""))
                for field in fields:
                    inner = f"{path}.{field.encode_name}" if path else field.encode_name
                    visit(field.type, inner, "[ ]")
            case inspect.ListType(item_type=inner):
                visit(inner, path, "[[]]")
            case inspect.DictType(value_type=inner):
                visit(inner, f"{path}.NAME", "[ ]")
            case inspect.UnionType(types=options):
                for option in options:
                    visit(option, path, brackets)

    visit(inspect.type_info(kind), "", "[ ]")
    return found
