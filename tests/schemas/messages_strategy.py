"""Random valid messages of every kind on the bus."""

from __future__ import annotations

from functools import cache

import msgspec
import msgspec.inspect
from hypothesis import strategies as st

from surefoot.schemas import messages
from surefoot.schemas.messages import SCHEMA_VERSION
from surefoot.schemas.topics import TOPICS

KINDS: tuple[type[msgspec.Struct], ...] = tuple(
    dict.fromkeys([*(topic.message for topic in TOPICS), messages.ServiceReply])
)
JOINT_COUNT = 5


@cache
def messages_of(kind: type[msgspec.Struct]) -> st.SearchStrategy[msgspec.Struct]:
    """Return valid messages of a kind, with JOINT_COUNT joints."""
    info = msgspec.inspect.type_info(kind)
    assert isinstance(info, msgspec.inspect.StructType)
    return _struct(info)


def _struct(info: msgspec.inspect.StructType) -> st.SearchStrategy[msgspec.Struct]:
    per_joint = getattr(info.cls, "PER_JOINT", ())
    fields = {}
    for field in info.fields:
        if field.name == "schema":
            fields[field.name] = st.just(SCHEMA_VERSION)
        elif field.name == "feet":
            both = st.lists(_values(field.type.item_type), min_size=2, max_size=2)
            fields[field.name] = st.just([]) | both
        elif field.name == "steps":  # several must be in order
            fields[field.name] = st.lists(_values(field.type.item_type), max_size=1)
        elif field.name in per_joint:
            size = JOINT_COUNT
            fields[field.name] = st.lists(_FLOATS, min_size=size, max_size=size)
        else:
            fields[field.name] = _values(field.type)
    return st.builds(info.cls, **fields)


_FLOATS = st.floats(allow_nan=False, allow_infinity=False)


def _between(info: msgspec.inspect.FloatType) -> st.SearchStrategy[float]:
    """Return numbers within the limits of a message."""
    least = info.gt if info.ge is None else info.ge
    return st.floats(
        min_value=least or 0.0, max_value=info.le, exclude_min=info.ge is None
    )


def _values(info: msgspec.inspect.Type) -> st.SearchStrategy:
    match info:
        case msgspec.inspect.FloatType():
            return _FLOATS if info.le is None else _between(info)
        case msgspec.inspect.LiteralType():
            return st.sampled_from(info.values)
        case msgspec.inspect.IntType():
            return st.integers(min_value=info.ge or 0, max_value=2**63 - 1)
        case msgspec.inspect.BoolType():
            return st.booleans()
        case msgspec.inspect.StrType():
            return st.text(max_size=20)
        case msgspec.inspect.EnumType():
            return st.sampled_from(list(info.cls))
        case msgspec.inspect.ListType():
            most = 4 if info.max_length is None else info.max_length
            items = _values(info.item_type)
            return st.lists(items, min_size=info.min_length or 0, max_size=most)
        case msgspec.inspect.DictType():
            return st.dictionaries(
                _values(info.key_type), _values(info.value_type), max_size=3
            )
        case msgspec.inspect.StructType():
            return _struct(info)
    raise AssertionError(f"no strategy for {info}")
