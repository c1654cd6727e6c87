"""Exports records and signals to formats of other tools."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Collection, Iterable, Iterator
from itertools import chain, count
from pathlib import Path
from typing import IO, Any, Literal
from zipfile import ZIP_DEFLATED, BadZipFile, ZipFile

import numpy as np
from numpy.lib.format import write_array

from surefoot.errors import EnvironmentFailedError, UsageError
from surefoot.installation import lacking
from surefoot.out_folder import is_to_replace, new_file, undone_on_error
from surefoot.recording.read import Record, with_nan
from surefoot.schemas.arrays import Array
from surefoot.signals import Signals

Columns = dict[str, list[Any]]
Format = Literal["csv", "npz", "parquet"]
_UNSAFE = re.compile(r"[^A-Za-z0-9._#-]")
_LONGEST_NAME = 200
SIGNALS_STEM = "ticks"
_LARGEST_EXACT = 2**53
"""Largest integer up to which floats hold all integers exactly."""
PART_TICKS = 16384
"""Ticks in memory at a time, independent of the run's length."""


def export_record(
    record: Record, to: Format, out: Path, *, overwrite: bool = False
) -> list[Path]:
    """Write the channels of a record.

    npz is one file with an array per field, named ``channel.field``. NaN readings, null
    in a JSON record, are NaN. Fields of varying shape are JSON texts. Characters of
    foreign channels that a file name must not have become ``_``. csv and parquet are a
    file per channel, with a column per number: ``q.0``, ``q.1``, ...

    Returns:
        The files written.

    Raises:
        UsageError: a file exists and may not be replaced.
        EnvironmentFailedError: the package for parquet is not installed.
    """
    if to == "npz":
        arrays = _arrays(record)
        _check_place(out, arrays, overwrite=overwrite)
        with new_file(out, overwrite=overwrite) as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)
        return [out]
    write = _write_csv if to == "csv" else _parquet_writer()
    return _export_tables(record, out, suffix=to, write=write, overwrite=overwrite)


def _arrays(record: Record) -> dict[str, Array]:
    arrays: dict[str, Array] = {}
    safe = safe_names(record.channels)
    for channel in record.channels:
        messages = record.messages(channel)
        fields = dict.fromkeys(name for message in messages for name in message)
        for field, name in safe_names(fields).items():
            column = [message.get(field) for message in messages]
            arrays[_free(f"{safe[channel]}.{name}", arrays)] = _array(column)
    return arrays


def _write_csv(file: IO[bytes], parts: Iterable[Columns]) -> None:
    """Write columns, part after part, with their names in the first row."""
    text = io.TextIOWrapper(
        file, encoding="utf-8", errors="backslashreplace", newline=""
    )
    writer = csv.writer(text)
    for index, columns in enumerate(parts):
        if index == 0:
            writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    text.flush()
    text.detach()


def _parquet_writer() -> Callable[[IO[bytes], list[Columns]], None]:
    pyarrow = _pyarrow()

    def column_of(values: list[Any]) -> Any:
        try:
            return pyarrow.array(values)
        except (ValueError, TypeError, OverflowError):  # mixed types
            return pyarrow.array([json.dumps(v, default=repr) for v in values])

    def write(file: IO[bytes], parts: list[Columns]) -> None:
        (columns,) = parts
        arrays = {name: column_of(values) for name, values in columns.items()}
        pyarrow.parquet.write_table(pyarrow.table(arrays), file)

    return write


def export_signals(
    signals: Signals, to: Format, out: Path, *, overwrite: bool = False
) -> list[Path]:
    """Write the signals of a run, with only some ticks in memory at a time.

    npz is one file with an array per signal; its first axis is the tick. csv and
    parquet are ``ticks.csv`` and ``ticks.parquet``, with a row per tick and a column
    per number, such as ``F_id.f_z_left``. Missing values are empty fields in csv. In
    parquet each column's metadata holds its unit, frame and meaning.

    Returns:
        The file written.

    Raises:
        UsageError: the file exists and may not be replaced.
        EnvironmentFailedError: the package for parquet is not installed.
    """
    write = {"npz": _signals_npz, "csv": _signals_csv, "parquet": _signals_parquet}[to]
    if to == "parquet":
        _pyarrow()  # before a folder is made
    if to == "npz":
        path, names = out, list(signals)
    else:
        path = out / f"{SIGNALS_STEM}.{to}"
        names = [n for layout in map(signals.layout, signals) for n in layout.columns]
    with undone_on_error() as note_new:
        note_new(path)
        if to != "npz":
            _make_folder(out)
        _check_place(path, names, overwrite=overwrite)
        with new_file(path, overwrite=overwrite) as file:
            write(file, signals)
    return [path]


def _signals_npz(file: IO[bytes], signals: Signals) -> None:
    with ZipFile(file, "w", ZIP_DEFLATED) as archive:
        for name in signals:  # one in memory at a time
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                write_array(entry, signals.read(name, 0, signals.count))


def _signals_csv(file: IO[bytes], signals: Signals) -> None:
    _write_csv(
        file,
        (
            {name: _fields(column) for name, column in columns.items()}
            for columns in _parts(signals)
        ),
    )


def _signals_parquet(file: IO[bytes], signals: Signals) -> None:
    pyarrow = _pyarrow()
    schema = pyarrow.schema(
        [
            pyarrow.field(
                column,
                pyarrow.from_numpy_dtype(np.dtype(layout.dtype)),
                metadata={
                    "unit": unit,
                    "frame": layout.frame,
                    "meaning": layout.meaning,
                    "words": json.dumps(layout.words),
                },
            )
            for layout in map(signals.layout, signals)
            for column, unit in zip(layout.columns, layout.units, strict=True)
        ]
    )
    with pyarrow.parquet.ParquetWriter(file, schema) as writer:
        for columns in _parts(signals):
            whole = {name: np.ascontiguousarray(x) for name, x in columns.items()}
            writer.write_table(pyarrow.table(whole, schema=schema))


def _parts(signals: Signals) -> Iterator[dict[str, Array]]:
    """Yield the columns of all signals, some ticks at a time; at least one part."""
    for start in range(0, max(signals.count, 1), PART_TICKS):
        yield signals.columns(start, start + PART_TICKS)


def _fields(column: Array) -> list[Any]:
    """Return numbers as texts that read back exactly; empty if missing."""
    if column.dtype.kind == "f":
        return [repr(x) if x == x else "" for x in column.tolist()]
    return [x if x >= 0 else "" for x in column.tolist()]


def _pyarrow() -> Any:
    if words := lacking("parquet", "pyarrow", extra="parquet"):
        raise EnvironmentFailedError(f"{words}; csv and npz need nothing")
    import pyarrow.parquet

    return pyarrow


def _check_place(path: Path, names: Iterable[str], *, overwrite: bool) -> None:
    """Check that a file is free, or an export with the same columns.

    Raises:
        UsageError: it is neither.
    """
    if not is_to_replace(path, overwrite=overwrite):
        return
    if path.is_symlink() or _names_in(path) != list(names):
        raise UsageError(
            f"--out {path}: is there, and not what an export of this would be; it is "
            "left as it is, name another place"
        )


def _names_in(path: Path) -> list[str] | None:
    """Return the arrays or columns of an exported file; None for any other file."""
    try:
        if path.suffix == ".csv":
            with path.open(encoding="utf-8", newline="") as file:
                return next(csv.reader(file), None)
        if path.suffix == ".parquet":
            return list(_pyarrow().parquet.read_schema(path).names)
        with ZipFile(path) as archive:
            return [name.removesuffix(".npy") for name in archive.namelist()]
    except (OSError, ValueError, csv.Error, BadZipFile):
        return None


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise UsageError(f"--out {folder}: expected a folder or a new name") from error


def _export_tables(
    record: Record,
    folder: Path,
    *,
    suffix: str,
    write: Callable[[IO[bytes], list[Columns]], None],
    overwrite: bool,
) -> list[Path]:
    safe = safe_names(record.channels)
    paths = {
        channel: folder / f"{safe[channel]}.{suffix}"
        for channel in record.channels
        if next(record.each(channel), None) is not None
    }
    for channel, path in paths.items():  # check all before the first is replaced
        if path.exists() or path.is_symlink():
            columns = _columns(record.messages(channel))
            _check_place(path, columns, overwrite=overwrite)
    with undone_on_error() as note_new:
        note_new(folder)
        _make_folder(folder)
        for channel, path in paths.items():
            note_new(path)
            with new_file(path, overwrite=overwrite) as file:
                write(file, [_columns(record.messages(channel))])
    return list(paths.values())


def safe_names(names: Iterable[str]) -> dict[str, str]:
    """Return safe and distinct file names for channel names of any program."""
    safe: dict[str, str] = {}
    for name in names:
        short = _UNSAFE.sub("_", name).lstrip(".")[:_LONGEST_NAME] or "_"
        safe[name] = _free(short, safe.values())
    return safe


def _free(name: str, taken: Collection[str]) -> str:
    """Return a name, with a number behind it if it is taken."""
    tries = chain([name], (f"{name}-{number}" for number in count(2)))
    return next(one for one in tries if one not in taken)


def _columns(messages: list[dict[str, Any]]) -> Columns:
    """Return a column per number or text; None where a message lacks the entry."""
    found: dict[tuple[str, ...], list[Any]] = {}
    for row, message in enumerate(messages):
        for path, value in _flat((), message):
            column = found.setdefault(path, [])
            column.extend([None] * (row - len(column)))
            column.append(value)
    columns: Columns = {}
    for path, column in found.items():
        column.extend([None] * (len(messages) - len(column)))
        columns[_free(".".join(path), columns)] = column
    return columns


def _flat(path: tuple[str, ...], value: Any) -> list[tuple[tuple[str, ...], Any]]:
    if isinstance(value, dict):
        entries = list(value.items())
    elif isinstance(value, list):
        entries = [(str(index), item) for index, item in enumerate(value)]
    else:
        return [(path, value)]
    return [leaf for name, item in entries for leaf in _flat((*path, name), item)]


def _array(values: list[Any]) -> Array:
    is_reading = _is_reading(values)
    if is_reading:  # JSON holds NaN as null
        values = with_nan(values)
    try:
        array: Array = np.asarray(values)
    except ValueError:  # entries of varying length
        array = np.asarray(values, dtype=object)
    if array.dtype == object or not (is_reading or array.tolist() == values):
        array = np.asarray([json.dumps(value, default=repr) for value in values])
    return array


def _is_reading(value: Any) -> bool:
    """Whether a value holds only numbers and null, each exact as a float."""
    if isinstance(value, list):
        return all(map(_is_reading, value))
    if isinstance(value, int):
        return not isinstance(value, bool) and abs(value) <= _LARGEST_EXACT
    return value is None or isinstance(value, float)
