"""A Markdown table of a struct: each field's type, unit, range, default and meaning."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import msgspec
import msgspec.inspect as inspect

from surefoot.presentation import markdown, split_unit
from surefoot.schemas.json_schema import field_docs

_UNIT = re.compile(r"\s*\[([^\]]+)\]")
_NBSP = "\N{NO-BREAK SPACE}"
_HEADINGS = {"text": "what it is", "type": "holds"}
_POWERS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class FieldRow:
    """One field, in words; texts are empty where there is nothing to say.

    Attributes:
        name: as written in files and messages.
        type: number, text, list and so on.
        unit: of a number.
        range: what values are allowed.
        default: value when it is left out; None when it must be given.
        text: what it does.
        is_numeric: whether it is a number, or several.
    """

    name: str
    type: str
    unit: str
    range: str
    default: str | None
    text: str
    is_numeric: bool


def field_rows(kind: type[msgspec.Struct]) -> list[FieldRow]:
    """Describe every field of a struct."""
    docs = field_docs(kind)
    info = inspect.type_info(kind)
    assert isinstance(info, inspect.StructType)
    return [_row(field, docs.get(field.encode_name, "")) for field in info.fields]


def table(rows: list[FieldRow], columns: tuple[str, ...]) -> str:
    """Markdown table of some attributes of rows; empty columns are left out."""
    kept = [name for name in columns if any(getattr(row, name) != "" for row in rows)]
    rows_shown = [[_cell(name, getattr(row, name)) for name in kept] for row in rows]
    return markdown([_HEADINGS.get(name, name) for name in kept], rows_shown)


def first_line(kind: type) -> str:
    """First paragraph of a docstring, on one line."""
    return " ".join((kind.__doc__ or "").strip().split("\n\n")[0].split())


def literals(text: str) -> str:
    """Docstrings' ``literal`` as Markdown's `literal`."""
    return text.replace("``", "`")


def _row(field: inspect.Field, doc: str) -> FieldRow:
    found = _UNIT.search(doc)
    is_numeric = _is_numeric(field.type)
    unit = found[1] if found else ""
    if not unit and is_numeric:
        _, unit = split_unit(field.name)
    text = literals(_UNIT.sub("", doc, count=1) if found else doc).strip()
    return FieldRow(
        name=field.encode_name,
        type=type_words(field.type),
        unit=re.sub(r"\^(-?\d+)", lambda m: m[1].translate(_POWERS), unit),
        range=_range(field.type),
        default=_default(field),
        text=text,
        is_numeric=is_numeric,
    )


def type_words(kind: inspect.Type) -> str:
    """What a field holds, in the words of someone who writes TOML or MessagePack."""
    match kind:
        case inspect.FloatType():
            return "number"
        case inspect.IntType():
            return "whole number"
        case inspect.BoolType():
            return "true or false"
        case inspect.StrType() | inspect.EnumType() | inspect.LiteralType():
            return "text"
        case inspect.TupleType(item_types=items):
            return f"{len(items)} {type_words(items[0])}s"
        case inspect.ListType(item_type=item, min_length=low, max_length=high):
            count = f"{low} " if low is not None and low == high else ""
            return f"{count}{_plural(item)}" if count else f"list of {_plural(item)}"
        case inspect.DictType(value_type=value):
            return f"table of {_plural(value)}"
        case inspect.StructType(cls=cls):
            return cls.__name__
        case inspect.UnionType(types=options):
            words = [type_words(o) for o in options if not _is_none(o)]
            return " or ".join(dict.fromkeys(words))
    return "anything"


def _plural(kind: inspect.Type) -> str:
    if isinstance(kind, inspect.BoolType):
        return "true or false"
    if isinstance(kind, inspect.StructType | inspect.UnionType):
        return type_words(kind)
    return f"{type_words(kind)}s"


def _range(kind: inspect.Type) -> str:
    match kind:
        case inspect.FloatType() | inspect.IntType():
            return _bounds(kind)
        case inspect.LiteralType(values=values):
            return ", ".join(f"`{value}`" for value in values)
        case inspect.EnumType(cls=cls):
            return ", ".join(f"`{value.value}`" for value in cls)
        case inspect.TupleType(item_types=items):
            return _range(items[0])
        case inspect.ListType(item_type=item):
            return _range(item)
        case inspect.UnionType(types=options):
            return next(filter(None, map(_range, options)), "")
    return ""


def _bounds(kind: inspect.FloatType | inspect.IntType) -> str:
    low = f">{_NBSP}{kind.gt:g}" if kind.gt is not None else ""
    low = f"≥{_NBSP}{kind.ge:g}" if kind.ge is not None else low
    high = f"<{_NBSP}{kind.lt:g}" if kind.lt is not None else ""
    if kind.le is not None and kind.le < 2**53:
        high = f"≤{_NBSP}{kind.le:g}"
    return ", ".join(filter(None, (low, high)))


def _default(field: inspect.Field) -> str | None:
    if field.required:
        return None
    value = field.default
    if value is msgspec.NODEFAULT:
        value = field.default_factory() if callable(field.default_factory) else ""
    return value_words(value)


def value_words(value: Any) -> str:
    """A default as it is written in TOML; several equal numbers as one."""
    if isinstance(value, tuple | list):
        if len(value) > 1 and len(set(map(str, value))) == 1:
            return value_words(value[0])
        return "[" + ", ".join(map(value_words, value)) + "]"
    if isinstance(value, msgspec.Struct) or value == {}:
        return ""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    return f'"{value}"' if isinstance(value, str) else str(value)


def _is_numeric(kind: inspect.Type) -> bool:
    match kind:
        case inspect.FloatType() | inspect.IntType():
            return True
        case inspect.TupleType(item_types=items):
            return _is_numeric(items[0])
        case inspect.ListType(item_type=item):
            return _is_numeric(item)
        case inspect.UnionType(types=options):
            return any(map(_is_numeric, options))
    return False


def _is_none(kind: inspect.Type) -> bool:
    return isinstance(kind, inspect.NoneType)


def _cell(column: str, value: str | None) -> str:
    if value is None:
        return "*required*"
    text = value.replace("|", "\\|")
    is_code = column == "name" or (column == "default" and text)
    return f"`{text}`" if is_code else text
