"""Reads recorded ground from others' files: CSV, .AT2 and K-NET texts, and MCAP."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.motions import Quantity, RecordedMotion
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.record_values import (
    Numbers,
    bad_key,
    is_number,
    plain_units,
    read_mcap,
)

_PEER: dict[str, tuple[Quantity, str]] = {
    ".at2": ("acceleration", "g"),
    ".vt2": ("velocity", "cm/s"),
    ".dt2": ("position", "cm"),
}
_PEER_MOST_HEAD_LINES = 10
_SECONDS = dict.fromkeys(("", "s", "sec", "secs", "second", "seconds"), 1.0)
_SECONDS |= dict.fromkeys(("ms", "msec", "msecs", "millis", "milliseconds"), 1e-3)
_SECONDS |= {"us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9}  # micro, and Greek mu
_OTHER_TIMES = re.compile(r"min(ute)?s?|h|hrs?|hours?|d|days?")
_PEER_COUNT = re.compile(r"NPTS\s*=\s*([^\s,;]*)", re.IGNORECASE)
_PEER_STEP = re.compile(
    r"\bDT\s*=\s*([^\s,;A-Z]*(?:[ED][-+]?\d+)?)\s*(?!NPTS)([A-Z]*)", re.IGNORECASE
)
_PEER_OLD = re.compile(r"^\s*([^\s,]+)[\s,]+([^\s,]+)[\s,]+NPTS", re.IGNORECASE)
_PEER_UNITS = re.compile(  # after such words, or by themselves
    r"(?i)(?:UNITS?\s*(?:OF|IN|[:=])\s*|\b(?=[CM]?M/S|GALS?\b))([^,;]+?)\s*(?:[,;]|$)"
)
_KNET_RATE = re.compile(r"^Sampling Freq\(Hz\)\s+(\S+?)(?:Hz)?\s*$", re.MULTILINE)
_KNET_SCALE = re.compile(r"^Scale Factor\s+(\S+?)\s*\(gal\)\s*/\s*(\S+)", re.MULTILINE)
_KNET_LASTS = re.compile(r"^Duration Time\(s\)\s+(\S+)", re.MULTILINE)
_KNET_HEAD_END = re.compile(r"^Memo\b.*$", re.MULTILINE)
_IN_BRACKETS = re.compile(r"\s*(\[[^\]]*\]|\([^)]*\))\s*$")
_STATED_UNIT = re.compile(r"(?:\[([^\]]*)\]|\(([^)]*)\))\s*$")
_BETWEEN_WORDS = re.compile(r"[\s_,;:.-]+|(?<=[a-z])(?=[A-Z])")
_TIME_NAME = re.compile(
    r"(t|times?|timestamp|stamp|s|secs?|seconds?|elapsed)([\s_,(\[].*)?", re.IGNORECASE
)


@dataclass(frozen=True)
class GroundRecord:
    """The content of a record's file.

    Attributes:
        content: bytes of the file.
        quantity: the measured quantity.
        units: units of the values; None when the file does not say.
        times: (n,) rising times [s].
        values: (n,) in these units.
    """

    content: bytes
    quantity: Quantity
    units: str | None
    times: Array
    values: Array


def read_record(motion: RecordedMotion) -> GroundRecord:
    """Read the file of a recorded motion, of any supported kind.

    Raises:
        ScenarioError: the file cannot be read, or holds no such record; ``field`` is
            the key of the motion to correct.
    """
    path = Path(motion.file)
    if path.exists() and not path.is_file():  # a pipe has no end, or none yet
        raise bad_key("file", f"{path}: is no file, expected a record")
    try:
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        raise bad_key(
            "file",
            f"{path}: cannot be read ({getattr(error, 'strerror', None) or error}); "
            "the name is relative to the scenario file",
        ) from error
    if not content.strip():
        raise bad_key("file", f"{path}: is empty, expected a record; fetch it again")
    record = _reader(path, content)(motion, content)
    if len(record.times) != len(record.values) or len(record.times) < 4:
        raise bad_key(
            "file", f"{path}: holds {len(record.values)} samples, expected 4 or more"
        )
    if not (np.isfinite(record.values).all() and np.isfinite(record.times).all()):
        raise bad_key("file", f"{path}: holds values that are no finite numbers")
    falls = np.diff(record.times) <= 0.0
    if falls.any():
        at = int(np.argmax(falls))
        raise bad_key(
            "file",
            f"{path}: time goes from {record.times[at]:g} s to "
            f"{record.times[at + 1]:g} s, expected rising times",
        )
    if motion.quantity not in (None, record.quantity):
        raise bad_key(
            "quantity",
            f"got {motion.quantity!r}, but {path.name} says it holds "
            f"{record.quantity!r}; leave `quantity` out",
        )
    return record


def _reader(
    path: Path, content: bytes
) -> Callable[[RecordedMotion, bytes], GroundRecord]:
    if path.suffix.lower() == ".mcap":
        return _mcap
    if path.suffix.lower() in _PEER:
        return _peer
    if _decoded(path, content).lstrip().startswith("Origin Time"):
        return _knet
    return _text


def _decoded(file: str | Path, content: bytes) -> str:
    """Return a file as text: UTF-8, otherwise Latin-1."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\0" in content:
        raise bad_key(
            "file",
            f"{file}: is UTF-16 or no text at all, expected text in UTF-8; save it "
            "anew as such",
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _peer(motion: RecordedMotion, content: bytes) -> GroundRecord:
    """Read a PEER record: a heading that ends with NPTS and DT, then rows of values."""
    lines = _decoded(motion.file, content).splitlines()
    told = [
        index
        for index, line in enumerate(lines[:_PEER_MOST_HEAD_LINES])
        if "NPTS" in line.upper() or _PEER_STEP.search(line)
    ]
    length = told[-1] + 1 if told else 0
    head = "\n".join(lines[:length])
    count, step = _PEER_COUNT.search(head), _PEER_STEP.search(head)
    words = [count and count[1], step and step[1], step and step[2]]
    if told and count is None and (old := _PEER_OLD.match(lines[told[-1]])):
        words = [old[1], old[2], ""]
    if words[0] is None or words[1] is None:
        raise bad_key(
            "file",
            f"{motion.file}: the first {_PEER_MOST_HEAD_LINES} lines do not say NPTS "
            "and DT, expected a record of PEER",
        )
    number = Numbers(motion.file)
    samples = number(words[0], "NPTS", above=0.0)
    per_second = _SECONDS.get((words[2] or "").lower())
    if per_second is None:
        raise number.bad("DT", f"{words[1]} {words[2]}", "seconds (SEC or MSEC)")
    step_s = per_second * number(words[1], "DT", above=0.0)
    values = number.rows(lines[length:], first_line=length + 1)
    number.enough(len(values), samples)
    number.no_more(len(values), samples, lines[length:])
    values = values[: int(samples)]
    quantity, default = _PEER[Path(motion.file).suffix.lower()]
    units = next((m[1] for m in map(_PEER_UNITS.search, lines[:length]) if m), None)
    return GroundRecord(
        content=content,
        quantity=quantity,
        units=default if units is None else plain_units(units),
        times=step_s * np.arange(len(values), dtype=np.float64),
        values=values,
    )


def _knet(motion: RecordedMotion, content: bytes) -> GroundRecord:
    """Read a K-NET or KiK-net record: a heading that ends with `Memo.`, then counts."""
    text = _decoded(motion.file, content)
    end = _KNET_HEAD_END.search(text)
    head = text if end is None else text[: end.end()]
    rate, scale = _KNET_RATE.search(head), _KNET_SCALE.search(head)
    if end is None or rate is None or scale is None:
        raise bad_key(
            "file",
            f"{motion.file}: its heading has no `Sampling Freq(Hz)`, `Scale Factor` or "
            "`Memo.`, expected a record of K-NET",
        )
    number = Numbers(motion.file)
    rate_hz = number(rate[1], "Sampling Freq(Hz)", above=0.0)
    gal, steps = (number(scale[at], "Scale Factor", above=0.0) for at in (1, 2))
    body = text[end.end() :].splitlines()
    counts = number.rows(body, first_line=head.count("\n") + 1)
    if lasts := _KNET_LASTS.search(head):
        told = number(lasts[1], "Duration Time(s)") * rate_hz
        number.enough(len(counts), told)
        number.no_more(len(counts), told, body)
    with np.errstate(over="ignore"):  # the caller reports it
        values = counts * gal / steps
        times = np.arange(len(counts), dtype=np.float64) / rate_hz
    return GroundRecord(content, "acceleration", "gal", times, values)


def _text(motion: RecordedMotion, content: bytes) -> GroundRecord:
    """Read columns of time and values, cut by comma, semicolon or blank; # remarks."""
    quantity = _stated_quantity(motion)
    number = Numbers(motion.file)
    lines, remark = [], ""
    for at, line in enumerate(_decoded(motion.file, content).splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            lines.append((at, line.strip(" ")))
        elif line.strip() and not lines:
            remark = line.lstrip().lstrip("#").strip()
    delimiter = _delimiter(lines)
    rows = _rows(motion.file, lines, delimiter)
    first = rows[0][1] if rows else []
    heading, must_fit = [], delimiter == " "
    if not any(is_number(cell, delimiter) for cell in first):
        heading = first
        rows, first = rows[1:], rows[1][1] if rows[1:] else []
    elif remark:
        must_fit = True
        with suppress(ScenarioError):  # words with a quotation mark
            heading = _rows(motion.file, [(0, remark)], delimiter)[0][1]
    if delimiter == " ":
        heading = _with_units(heading)
    if must_fit and len(heading) != len(first):
        heading = []
    time = _time_column(motion.file, heading)
    column = _column(motion, heading) if motion.column else time + 1
    width = max(len(heading) or len(first), column + 1)
    for at, cells in rows:
        if len(cells) > width:
            raise bad_key(
                "file",
                f"{motion.file}, line {at}: has {len(cells)} cells, expected {width}; "
                "decimal commas need semicolons between cells",
            )
        cells.extend([""] * (width - len(cells)))
    used = [(at, cells[time], cells[column]) for at, cells in rows]
    if delimiter in ";\t" and any("," in when + value for _, when, value in used):
        number = Numbers(motion.file, decimal_comma=True)
    name = heading[column] if column < len(heading) else f"column {column + 1}"
    time_name = heading[time] if heading else ""
    per_second = _time_unit(motion.file, time_name)
    table = np.array(
        [
            (number(when, "time [s]", line=at), number(value, name, line=at))
            for at, when, value in used
        ],
        dtype=np.float64,
    ).reshape(-1, 2)
    units = _value_units(name, motion, quantity)
    times = per_second * table[:, 0]
    return GroundRecord(content, quantity, units or None, times, table[:, 1])


def _time_column(file: str, heading: list[str]) -> int:
    """Return the index of the times: the first column, unless another is named so.

    Raises:
        ScenarioError: the heading does not tell which column it is.
    """
    named = [at for at, cell in enumerate(heading) if _TIME_NAME.fullmatch(cell)]
    if 0 in named or (not named and (not heading or heading[0])):
        return 0
    if len(named) == 1:
        return named[0]
    raise bad_key(
        "file",
        f"{file}: the heading {', '.join(map(repr, heading))} does not tell which "
        "column has the times; put them first, named 't' or 'time'",
    )


def _value_units(name: str, motion: RecordedMotion, quantity: Quantity) -> str | None:
    """Return the units of a column as its name says in brackets.

    Raises:
        ScenarioError: it ends like a unit: `a_g` may be in g, or of the ground.
    """
    if (stated := _in_brackets(name)) is not None:
        return plain_units(stated)
    words = _BETWEEN_WORDS.split(name.strip())
    default, *others = motion.units_for(quantity)
    for units in map(plain_units, ("/".join(words[-2:]), *words[-1:])):
        if units in others and motion.units is None:
            raise bad_key(
                "units",
                f"missing, and {name!r} of {motion.file} may be in {units} or in "
                f"{default}; say which",
            )
    return None


def _in_brackets(name: str) -> str | None:
    """Return the unit at the end of a column's name; None for a name without."""
    found = _STATED_UNIT.search(name)
    return None if found is None else found[1] or found[2] or ""


def _time_unit(file: str, name: str) -> float:
    """Return the unit of a column of times in seconds, as its name says.

    Raises:
        ScenarioError: the unit is none of time.
    """
    stated, last = _in_brackets(name), _BETWEEN_WORDS.split(name.strip())[-1]
    unit = (last if stated is None else stated).strip()
    if unit.lower() in _SECONDS:
        return _SECONDS[unit.lower()]
    if stated is None and not _OTHER_TIMES.fullmatch(unit.lower()):
        return 1.0
    raise bad_key(
        "file",
        f"{file}: times are in {unit!r}, as the heading {name!r} says, expected "
        "s, ms, us or ns; mend the heading, or save the record with seconds",
    )


def _delimiter(lines: list[tuple[int, str]]) -> str:
    """Return the delimiter between the cells of a text.

    A middle line decides: the first may be a heading, and the last may be cut off.
    """
    line = lines[len(lines) // 2][1] if lines else ""
    for delimiter in ";\t,":
        if delimiter in line and is_number(line.split(delimiter)[0], delimiter):
            return delimiter
    if is_number(line.partition(" ")[0], " "):
        return " "
    return next((delimiter for delimiter in ";\t," if delimiter in line), " ")


def _with_units(heading: list[str]) -> list[str]:
    """Join units in brackets to the names that blanks part them from."""
    joined: list[str] = []
    for cell in heading:
        if joined and re.fullmatch(r"\[.*\]|\(.*\)", cell):
            joined[-1] += f" {cell}"
        else:
            joined.append(cell)
    return joined


def _rows(
    file: str, lines: list[tuple[int, str]], delimiter: str
) -> list[tuple[int, list[str]]]:
    """Return line numbers and cells, without empty cells at a line's end."""
    texts = (f"{line}\n" for _, line in lines)
    if delimiter == " ":
        texts = (" ".join(line.split()) for _, line in lines)
    reader = csv.reader(texts, delimiter=delimiter, skipinitialspace=True, strict=True)
    rows: list[tuple[int, list[str]]] = []
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            while len(cells) > 2 and not cells[-1]:
                cells.pop()
            rows.append((lines[reader.line_num - 1][0], cells))
    except csv.Error as error:
        at = lines[min(reader.line_num, len(lines)) - 1][0]
        raise bad_key(
            "file",
            f"{file}, line {at}: cannot be read as columns ({error}); is a quotation "
            "mark left open?",
        ) from error
    return rows


def _column(motion: RecordedMotion, heading: list[str]) -> int:
    """Return the index of the named column; the name may lack its unit."""
    names = (heading, [_IN_BRACKETS.sub("", cell) for cell in heading])
    found = next((name for name in names if motion.column in name), [])
    if found.count(motion.column) == 1:
        return found.index(motion.column)
    named = ", ".join(heading) or "no columns"
    what = f"{found.count(motion.column)} such columns: " if found else ""
    raise bad_key(
        "column",
        f"got {motion.column!r}, but the heading of {motion.file} names {what}{named}",
    )


def _mcap(motion: RecordedMotion, content: bytes) -> GroundRecord:
    """Read one number from every message of a channel."""
    quantity = _stated_quantity(motion)
    for key in ("channel", "field"):
        if not getattr(motion, key):
            raise bad_key(key, f"missing, and {motion.file} is an MCAP file; name it")
    times, values = read_mcap(
        content, file=motion.file, channel=motion.channel, field=motion.field
    )
    return GroundRecord(content, quantity, None, times, values)


def _stated_quantity(motion: RecordedMotion) -> Quantity:
    if motion.quantity is None:
        raise bad_key(
            "quantity",
            f"missing, and {Path(motion.file).name} does not say what it holds; "
            "expected one of 'position', 'velocity', 'acceleration'",
        )
    return motion.quantity
