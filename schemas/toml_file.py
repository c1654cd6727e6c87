"""Reads TOML files into frozen structs; errors name the file, the key and the fix."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from schemas.codec import field_of
from schemas.errors import FileFormatError

_T = TypeVar("_T", bound=msgspec.Struct)


class FileStruct(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of every struct a user writes as TOML: frozen, unknown keys refused."""


def read_toml(path: Path) -> dict[str, Any]:
    """Reads a TOML table.

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
    """Turns a table into a struct.

    Args:
        raw: what was read.
        kind: struct to build.
        source: named in errors, usually the path of the file.

    Raises:
        FileFormatError: a key is unknown, missing, of the wrong type or out of
            range; the message holds its path and the nearest valid name.
    """
    try:
        return msgspec.convert(raw, kind)
    except msgspec.ValidationError as error:
        field = field_of(error)
        hint = _nearest_key(field, kind) if "unknown field" in str(error) else ""
        raise FileFormatError(f"{source}: {field}: {error}{hint}", field=field) from (
            error
        )


def load(path: Path, kind: type[_T]) -> _T:
    """Reads a file into a struct; see :func:`read_toml` and :func:`convert`."""
    return convert(read_toml(path), kind, source=str(path))


def _nearest_key(field: str, kind: type[msgspec.Struct]) -> str:
    name = field.rsplit(".", 1)[-1]
    names = sorted(_all_keys(kind))
    near = difflib.get_close_matches(name, names, n=1)
    return f"; did you mean {near[0]!r}?" if near and near[0] != name else ""


def _all_keys(kind: type[msgspec.Struct]) -> set[str]:
    """Names of all keys at any depth of a file format."""
    schema = msgspec.json.schema(kind)
    keys: set[str] = set()
    for definition in schema.get("$defs", {}).values():
        keys.update(definition.get("properties", {}))
    return keys
