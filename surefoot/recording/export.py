"""Writes the channels of a record in formats of other tools."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Iterable
from itertools import count
from pathlib import Path
from typing import IO, Any

import numpy as np

from surefoot.errors import EnvironmentFailedError, UsageError
from surefoot.installation import install_command
from surefoot.recording.read import Record
from surefoot.robot_io.atomic_file import atomic_file
from surefoot.run_folder import write_arrays
from surefoot.schemas.arrays import Array

Columns = dict[str, list[Any]]
_UNSAFE = re.compile(r"[^A-Za-z0-9._#-]")
_LONGEST_NAME = 200


def export_npz(record: Record, path: Path) -> list[Path]:
    """Write one file with an array per field, named ``channel.field``.

    Fields of varying shape are kept as JSON texts; a channel of another program
    is named with ``_`` for what no file name may hold.
    """
    arrays: dict[str, Array] = {}
    safe = safe_names(record.channels)
    for channel in record.channels:
        messages = record.messages(channel)
        fields = dict.fromkeys(name for message in messages for name in message)
        for field, name in safe_names(fields).items():
            column = [message.get(field) for message in messages]
            arrays[f"{safe[channel]}.{name}"] = _array(column)
    write_arrays(path, arrays)
    return [path]


def export_csv(record: Record, folder: Path) -> list[Path]:
    """Write a file per channel, with a column per number: ``q.0``, ``q.1``, ..."""

    def write(file: IO[bytes], columns: Columns) -> None:
        text = io.TextIOWrapper(
            file, encoding="utf-8", errors="backslashreplace", newline=""
        )
        writer = csv.writer(text)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
        text.flush()
        text.detach()

    return _export_tables(record, folder, suffix="csv", write=write)


def export_parquet(record: Record, folder: Path) -> list[Path]:
    """Write a file per channel, with the columns of :func:`export_csv`.

    Raises:
        EnvironmentFailedError: the package for it is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise EnvironmentFailedError(
            "parquet needs pyarrow, which is not installed: "
            f"{install_command('parquet')}; csv and npz need nothing"
        ) from error

    def column_of(values: list[Any]) -> Any:
        try:
            return pyarrow.array(values)
        except (ValueError, TypeError, OverflowError):  # of several types
            return pyarrow.array([json.dumps(value) for value in values])

    def write(file: IO[bytes], columns: Columns) -> None:
        arrays = {name: column_of(values) for name, values in columns.items()}
        pyarrow.parquet.write_table(pyarrow.table(arrays), file)

    return _export_tables(record, folder, suffix="parquet", write=write)


def _export_tables(
    record: Record,
    folder: Path,
    *,
    suffix: str,
    write: Callable[[IO[bytes], Columns], None],
) -> list[Path]:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise UsageError(f"--out {folder}: expected a folder or a new name") from error
    written = []
    safe = safe_names(record.channels)
    for channel in record.channels:
        messages = record.messages(channel)
        if messages:
            path = folder / f"{safe[channel]}.{suffix}"
            with atomic_file(path) as file:
                write(file, _columns(messages))
            written.append(path)
    return written


def safe_names(names: Iterable[str]) -> dict[str, str]:
    """Names of any program as names of files that lead nowhere else, all different."""
    safe: dict[str, str] = {}
    for name in names:
        short = _UNSAFE.sub("_", name).lstrip(".")[:_LONGEST_NAME] or "_"
        taken = set(safe.values())
        tries = (f"{short}-{number}" for number in count(2))
        safe[name] = (
            short
            if short not in taken
            else next(other for other in tries if other not in taken)
        )
    return safe


def _columns(messages: list[dict[str, Any]]) -> Columns:
    """Return a column per number or text; None if a message has no such entry."""
    columns: Columns = {}
    for row, message in enumerate(messages):
        for name, value in _flat("", message):
            column = columns.setdefault(name, [])
            column.extend([None] * (row - len(column)))
            column.append(value)
    for column in columns.values():
        column.extend([None] * (len(messages) - len(column)))
    return columns


def _flat(prefix: str, value: Any) -> list[tuple[str, Any]]:
    if isinstance(value, dict):
        entries = list(value.items())
    elif isinstance(value, list):
        entries = [(str(index), item) for index, item in enumerate(value)]
    else:
        return [(prefix, value)]
    dot = "." if prefix else ""
    return [leaf for name, item in entries for leaf in _flat(prefix + dot + name, item)]


def _array(values: list[Any]) -> Array:
    try:
        array: Array = np.asarray(values)
    except ValueError:  # of varying length
        array = np.asarray(values, dtype=object)
    if array.dtype == object:
        array = np.asarray([json.dumps(value) for value in values])
    return array
