"""Writes the channels of a record in formats of other tools."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import numpy as np

from surefoot.errors import EnvironmentFailedError, UsageError
from surefoot.recording.read import Record
from surefoot.robot_io.atomic_file import atomic_file
from surefoot.run_folder import write_arrays
from surefoot.schemas.arrays import Array

Columns = dict[str, list[Any]]


def export_npz(record: Record, path: Path) -> list[Path]:
    """Write one file with an array per field, named ``channel.field``.

    Fields of varying shape are kept as JSON texts.
    """
    arrays: dict[str, Array] = {}
    for channel in record.channels:
        messages = record.messages(channel)
        for name in messages[0] if messages else ():
            arrays[f"{channel}.{name}"] = _array([m[name] for m in messages])
    write_arrays(path, arrays)
    return [path]


def export_csv(record: Record, folder: Path) -> list[Path]:
    """Write a file per channel, with a column per number: ``q.0``, ``q.1``, ..."""

    def write(file: IO[bytes], columns: Columns) -> None:
        text = io.TextIOWrapper(file, encoding="utf-8", newline="")
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
            "pip install 'surefoot[parquet]'; csv and npz need nothing"
        ) from error

    def write(file: IO[bytes], columns: Columns) -> None:
        pyarrow.parquet.write_table(pyarrow.table(columns), file)

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
    for channel in record.channels:
        messages = record.messages(channel)
        if messages:
            path = folder / f"{channel}.{suffix}"
            with atomic_file(path) as file:
                write(file, _columns(messages))
            written.append(path)
    return written


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
