"""Reads TOML files into frozen structs. Errors name the file, the key and the fix.

Also writes files of any kind atomically: whole, or not at all.
"""

from __future__ import annotations

import json
import math
import os
import secrets
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, TypeVar

import msgspec
import tomli_w

from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.validation import (
    dotted,
    explain,
    find_non_finite,
    nearest,
    suggest_key,
)

_T = TypeVar("_T", bound=msgspec.Struct)
LARGEST_NUMBER = 1e12
"""Largest number in any table: no SI quantity comes near it, and its square is
finite."""
_MOST_NAMED = 5
"""Number of files of a folder that an error names."""


class FileStruct(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of every struct a user writes as TOML: frozen, unknown keys refused."""


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML table.

    Raises:
        FileFormatError: the file is missing, empty, unreadable or not TOML.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")  # Windows marks it
        if not text.strip():  # cut off; defaults would take its place unnoticed
            raise FileFormatError(
                f"{path}: is empty, expected a TOML file; write it anew, or a # into "
                "it for a file that sets nothing"
            )
        return tomllib.loads(text)
    except FileNotFoundError as error:
        raise FileFormatError(f"{path}: no such file") from error
    except IsADirectoryError as error:
        raise FileFormatError(
            f"{path}: is a folder, expected a TOML file{_inside(path)}"
        ) from error
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: is no text, expected a TOML file") from error
    except OSError as error:
        raise FileFormatError(
            f"{path}: cannot be read ({error.strerror or error})"
        ) from error
    except tomllib.TOMLDecodeError as error:
        raise FileFormatError(f"{path}: not valid TOML: {error}") from error


def find_toml(
    name_or_path: str | Path,
    shipped: Mapping[str, Path],
    *,
    what: str,
    error: type[Exception],
) -> Path:
    """Return the path of a file, given a shipped name or a path.

    Args:
        name_or_path: a path ends in .toml.
        shipped: path of each shipped file, by name.
        what: kind of thing that the file describes, for messages.
        error: raised when no file is found; its message lists the shipped names.
    """
    path, name = Path(name_or_path), str(name_or_path)
    if path.suffix == ".toml":
        if path.is_file():
            return path
        problem = "is a folder, no" if path.is_dir() else "no such"
        raise error(f"{path}: {problem} {what} file")
    if name in shipped:
        return shipped[name]
    if path.exists():
        got = f"a folder{_inside(path)}" if path.is_dir() else "a file of another kind"
        raise error(f"{path}: expected a {what} file (.toml), got {got}")
    raise error(
        f"no {what} named {name!r}{nearest(name, shipped)}; shipped are "
        f"{', '.join(shipped)}, or give the path of a {what} file (.toml)"
    )


def _inside(folder: Path) -> str:
    """Name files of the folder that may have been meant."""
    names = sorted(path.name for path in folder.glob("*.toml"))[:_MOST_NAMED]
    return f"; it holds {', '.join(names)}" if names else ""


def convert(raw: dict[str, Any], kind: type[_T], *, source: str) -> _T:
    """Turn a table into a struct.

    Raises:
        FileFormatError: a key is unknown, missing, of the wrong type, out of
            range or not finite; the message holds its path and, for an unknown
            key, the nearest valid name.
    """
    _check_numbers(raw, source=source)
    try:
        converted = msgspec.convert(raw, kind)
    except msgspec.ValidationError as error:
        field, text = explain(error, raw, kind)
        if "unknown field" in text:
            text = f"no such key{suggest_key(field, kind)}"
        field = dotted(field)
        place = f"{source}: {field}" if field else source
        raise FileFormatError(f"{place}: {text}", field=field) from error
    # Whole numbers are floats here wherever the file format has floats.
    _check_numbers(msgspec.to_builtins(converted), source=source)
    return converted


def _check_numbers(table: Any, *, source: str) -> None:
    bad = find_non_finite(table, largest=LARGEST_NUMBER)
    if bad is None:
        return
    expected = "a finite number"
    if math.isfinite(bad.value):
        expected = f"a number of at most {LARGEST_NUMBER:g}"
    raise FileFormatError(
        f"{source}: {bad.path}: got {bad.value}, expected {expected}", field=bad.path
    )


def load(path: Path, kind: type[_T]) -> _T:
    """Read a file into a struct; see :func:`read_toml` and :func:`convert`."""
    return convert(read_toml(path), kind, source=str(path))


def toml_text(table: dict[str, Any]) -> str:
    """Write a table, nested ones included, as TOML.

    Args:
        table: texts, numbers, booleans, lists and tables; keys without a value (None)
            are left out.

    Returns:
        TOML that reads back as the same table.
    """
    return tomli_w.dumps(_without_none(table))


def struct_table(value: FileStruct) -> dict[str, Any]:
    """Return the table that reads back as a struct."""
    table: dict[str, Any] = _without_none(plain(value))
    return table


def plain(value: Any) -> Any:
    """Return a value given in Python as built-in types.

    Numbers and arrays of numpy become numbers and lists, structs tables, and all else
    that can be iterated over, such as a range, a list.

    Raises:
        FileFormatError: it holds something else.
    """
    return msgspec.to_builtins(value, enc_hook=_as_builtin)


def _as_builtin(value: Any) -> Any:
    if hasattr(value, "tolist"):  # numpy's, without loading it
        return value.tolist()
    if isinstance(value, Iterable):
        return list(value)
    raise FileFormatError(
        f"got {value!r}, expected numbers, texts, booleans, lists or tables of them",
        field="",
    )


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    if isinstance(value, (list, tuple)):
        return [_without_none(item) for item in value]
    return value


def parse_override(
    text: str, *, option: str, example: str = "friction=0.4"
) -> tuple[str, Any]:
    """Split ``KEY=VALUE``; the value is written as in TOML.

    Raises:
        FileFormatError: there is no ``=``, or the value is not valid TOML.
    """
    path, equals, value = text.partition("=")
    if not equals or not path.strip():
        raise FileFormatError(
            f"{option} {text!r}: expected KEY=VALUE, such as {example}", field=text
        )
    return path.strip(), parse_value(value, what=f"{option} {path.strip()}")


def override_texts(values: Mapping[str, Any]) -> list[str]:
    """Return values as texts ``KEY=VALUE``, which :func:`parse_override` reads back."""
    return [f"{key}={json.dumps(value)}" for key, value in plain(values).items()]


def parse_value(text: str, *, what: str) -> Any:
    """Read one TOML value; a bare word counts as a text.

    Raises:
        FileFormatError: the text is neither.
    """
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError as error:
        if text.strip().replace("-", "").replace("_", "").isalnum():
            return text.strip()
        raise FileFormatError(
            f"{what}: got {text!r}, expected a number, a list such as "
            '[0.0, 120.0, 0.0], or a text such as "a.csv", in quotation marks',
            field=what,
        ) from error


@contextmanager
def atomic_file(
    path: Path, *, overwrite: bool = True, mode: int = 0o666
) -> Iterator[IO[bytes]]:
    """Open a file for writing that gets its name only once it is complete.

    Until then it is called ``NAME.<random>.partial``, so that two writers of one name
    do not write into each other's file.

    Args:
        path: final path of the file.
        overwrite: replace an existing file of that name.
        mode: permissions of the file from the first moment on, minus the umask.

    Yields:
        The open binary file.

    Raises:
        FileExistsError: a file of that name exists and may not be replaced.
    """
    partial = path.with_name(f"{path.name}.{secrets.token_hex(4)}.partial")
    try:
        opened = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        with os.fdopen(opened, "wb") as file:
            yield file
        if not overwrite:
            _take_name(path, partial)
        partial.replace(path)
    except OSError as error:
        if error.filename in (None, str(partial)):  # a failed write names no file
            error.filename = str(path)
        raise
    finally:
        partial.unlink(missing_ok=True)


def _take_name(path: Path, partial: Path) -> None:
    """Give a file a new name, its second one; unlike a renaming, replace nothing.

    Raises:
        FileExistsError: the name is taken.
    """
    try:
        os.link(partial, path)
    except FileExistsError:
        raise
    except OSError:  # FAT and some network drives have no second names
        os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL))
