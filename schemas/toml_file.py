"""Reads TOML files into frozen structs; errors name the file, the key and the fix."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.finite import find_non_finite
from surefoot.schemas.key_names import suggest_key
from surefoot.schemas.validation import explain

_T = TypeVar("_T", bound=msgspec.Struct)


class FileStruct(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of every struct a user writes as TOML: frozen, unknown keys refused."""


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML table.

    Raises:
        FileFormatError: the file is missing, unreadable or not TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise FileFormatError(f"{path}: no such file") from error
    except (OSError, UnicodeDecodeError) as error:
        raise FileFormatError(f"{path}: cannot be read ({error})") from error
    except tomllib.TOMLDecodeError as error:
        raise FileFormatError(f"{path}: not valid TOML: {error}") from error


def convert(raw: dict[str, Any], kind: type[_T], *, source: str) -> _T:
    """Turn a table into a struct.

    Args:
        raw: what was read.
        kind: struct to build.
        source: named in errors, usually the path of the file.

    Raises:
        FileFormatError: a key is unknown, missing, of the wrong type, out of
            range or not finite; the message holds its path and, for an unknown
            key, the nearest valid name.
    """
    bad = find_non_finite(raw)
    if bad is not None:
        raise FileFormatError(
            f"{source}: {bad.path}: got {bad.value}, expected a finite number",
            field=bad.path,
        )
    try:
        return msgspec.convert(raw, kind)
    except msgspec.ValidationError as error:
        field, text = explain(error, raw, kind)
        if "unknown field" in text:
            text = f"no such key{suggest_key(field, kind)}"
        place = f"{source}: {field}" if field else source
        raise FileFormatError(f"{place}: {text}", field=field) from error


def load(path: Path, kind: type[_T]) -> _T:
    """Read a file into a struct; see :func:`read_toml` and :func:`convert`."""
    return convert(read_toml(path), kind, source=str(path))


def toml_text(tables: dict[str, dict[str, Any]]) -> str:
    """Write tables of numbers, texts, booleans and lists of them.

    Args:
        tables: table name to its keys; both plain names.

    Returns:
        TOML that reads back as the same tables.
    """
    blocks = []
    for name, table in tables.items():
        blocks.append(f"[{name}]\n{toml_keys(table)}")
    return "\n\n".join(blocks) + "\n"


def toml_keys(table: dict[str, Any]) -> str:
    """Write the keys of one table, without its name."""
    return "\n".join(f"{key} = {_value(value)}" for key, value in table.items())


def _value(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_value, value))}]"
    # JSON and TOML write booleans, finite numbers and escapes alike; but TOML wants
    # characters beyond the 16-bit plane as they are, and DEL escaped.
    text = json.dumps(value, allow_nan=False, ensure_ascii=False)
    return text.replace("\x7f", "\\u007F")
