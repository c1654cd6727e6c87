"""The simplest valid message of every kind, in built-in types."""

from __future__ import annotations

from typing import Any

import msgspec
import msgspec.inspect

from surefoot.schemas.messages import SCHEMA_VERSION


def simplest_message(
    kind: type[msgspec.Struct], *, joint_count: int = 0
) -> dict[str, Any]:
    """Return zeros, empty texts and lists, with the right sizes and version."""
    info = msgspec.inspect.type_info(kind)
    assert isinstance(info, msgspec.inspect.StructType)
    plain = {field.name: _simplest(field.type) for field in info.fields}
    if "schema" in plain:
        plain["schema"] = SCHEMA_VERSION
    for name in getattr(kind, "PER_JOINT", ()):
        plain[name] = [0.0] * joint_count
    return plain


def _simplest(info: msgspec.inspect.Type) -> Any:
    match info:
        case msgspec.inspect.FloatType():
            return 0.0
        case msgspec.inspect.IntType():
            return info.ge or 0
        case msgspec.inspect.BoolType():
            return False
        case msgspec.inspect.StrType():
            return ""
        case msgspec.inspect.EnumType():
            return str(next(iter(info.cls)))
        case msgspec.inspect.LiteralType():
            return info.values[0]
        case msgspec.inspect.ListType():
            return [_simplest(info.item_type)] * (info.min_length or 0)
        case msgspec.inspect.DictType():
            return {}
        case msgspec.inspect.StructType():
            return simplest_message(info.cls)
    raise AssertionError(f"no simplest value for {info}")
