"""Finds NaN and infinities in messages and tables."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from functools import cache
from typing import Any, NamedTuple

import msgspec
import msgspec.inspect


class NonFinite(NamedTuple):
    """A NaN or infinity, and its place."""

    path: str
    value: float


def find_non_finite(
    value: Any, path: str = "", *, largest: float = sys.float_info.max
) -> NonFinite | None:
    """Find the first NaN or infinity at any depth.

    Args:
        value: a number, struct, list or dict; other types hold no numbers.
        path: where ``value`` itself stands, put before what is found.
        largest: what is larger is taken for infinite; of structs only their default.

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
    """Check by sums, since a finite sum has finite terms: a microsecond per message."""
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
    """Return fields with floats; None when some are deeper than a list."""
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
