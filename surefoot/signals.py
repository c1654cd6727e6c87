"""Signals of a run by name: named arrays at every tick, from memory or from files.

>>> signals = read_signals(Path("out/fast"))
>>> signals["F_meas"][:, 2]  # normal force on the left sole, at every tick [N]
>>> print(signals.describe())
"""

from __future__ import annotations

import difflib
import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from surefoot.errors import UnknownSignalError, UsageError
from surefoot.robot_io.errors import TickFileError
from surefoot.robot_io.ticks.read import TickFileTable, is_tick_file
from surefoot.robot_io.ticks.recorder import (
    BLOCK_TICKS,
    BlockFormat,
    MemoryTicks,
    SignalArray,
    TickSink,
    TickTable,
    missing_rows,
)
from surefoot.robot_io.ticks.write import TickFile
from surefoot.run_folder import CONTROLLER_TICKS, MARKER, NO_RUN, TICKS, settle_run
from surefoot.schemas.arrays import Array
from surefoot.schemas.signals import BY_NAME, SignalLayout

_LOG = logging.getLogger(__name__)

_SHOWN_LABELS = 12
_HEADINGS = ("name", "shape", "unit", "frame", "columns", "meaning")


class Signals(Mapping[str, SignalArray]):
    """All signals of a run at every tick, by name.

    ``signals["q"]`` is (n, n_a): the first axis is the ticks of robot and controller,
    joined. An array is read at its first use, then kept; do not write to it. A signal
    without a value at a tick is NaN there, or -1 for whole numbers.

    Attributes:
        lost_ticks: number of ticks that were not recorded, since the disk was too slow
            or full.
        is_cut_off: whether a file has no end; its complete ticks are here.
    """

    def __init__(self, tables: Sequence[TickTable]) -> None:
        """Join the tables of a run's recorders.

        Args:
            tables: one per recorder; the robot's first.
        """
        self._tables = list(tables)
        self._ticks = _join([table.read("tick") for table in tables if len(table)])
        self._rows = [
            _rows_at(self._ticks, table.read("tick")) if len(table) else None
            for table in tables
        ]
        self._cache: dict[str, SignalArray] = {}
        self.lost_ticks = sum(table.lost_ticks for table in tables)
        self.is_cut_off = any(table.is_cut_off for table in tables)
        found: dict[str, SignalLayout] = {}
        for table in reversed(self._tables):
            found.update(table.layouts)
        known = [name for name in BY_NAME if name in found]
        others = [name for name in found if name not in BY_NAME]
        self._layouts = {name: found[name] for name in (*known, *others)}

    @property
    def gaps(self) -> list[str]:
        """What was found missing so far: damage may show when a signal is read."""
        return [gap for table in self._tables for gap in table.gaps]

    @property
    def ticks(self) -> SignalArray:
        """(n,) the robot's tick counter; the same as ``signals["tick"]``."""
        return self["tick"]

    @property
    def count(self) -> int:
        """Number of ticks."""
        return len(self._ticks)

    @property
    def time_s(self) -> Array:
        """(n,) the robot's time [s]; the same as ``signals["time_s"]``."""
        return self["time_s"]

    def layout(self, name: str) -> SignalLayout:
        """Return unit, frame, shape, labels and meaning of a signal.

        Raises:
            UnknownSignalError: the run has no such signal.
        """
        try:
            return self._layouts[name]
        except KeyError:
            raise UnknownSignalError(self._unknown(name)) from None

    def read(self, name: str, start: int, stop: int) -> SignalArray:
        """Read some rows of a signal and keep none: for runs that fill the memory.

        Args:
            name: of the signal.
            start: first row.
            stop: row after the last.

        Returns:
            (stop - start, *shape).

        Raises:
            UnknownSignalError: the run has no such signal.
        """
        layout = self.layout(name)
        ticks = self._ticks[start:stop]
        if name == "tick":
            return ticks
        values = missing_rows(layout, len(ticks))
        for table, rows in reversed(list(zip(self._tables, self._rows, strict=True))):
            if name not in table.layouts or rows is None:
                continue
            here = np.flatnonzero(rows[start:stop] >= 0)
            wanted = rows[start:stop][here]
            if len(here):
                first, last = int(wanted.min()), int(wanted.max())
                found = table.read(name, first, last + 1)
                # Usually every tick is there, in order: nothing to sort.
                is_plain = np.array_equal(wanted, np.arange(first, last + 1))
                values[here] = found if is_plain else found[wanted - first]
        return values

    def columns(self, start: int, stop: int) -> dict[str, SignalArray]:
        """Return some rows of all signals as plain columns, for tables.

        Args:
            start: first row.
            stop: row after the last.

        Returns:
            (stop - start,) each, by name of the column, such as ``F_id.f_z_left``.
        """
        found: dict[str, SignalArray] = {}
        for name, layout in self._layouts.items():
            values = self.read(name, start, stop)
            flat = values.reshape(len(values), -1)
            found.update(zip(layout.columns, flat.T, strict=True))
        return found

    def copy_to(self, sinks: TickSinks) -> None:
        """Write all signals to sinks, as the recorders of the run did.

        Args:
            sinks: the robot's and the controller's.
        """
        for table, sink in zip(self._tables, sinks, strict=False):
            form = BlockFormat(list(table.layouts.values()))
            names = [name for name in form.layouts if name != "tick"]
            sink.lost_ticks, sink.is_cut_off = table.lost_ticks, table.is_cut_off
            block = sink.open(form)
            count = len(table)
            for start in range(0, count, BLOCK_TICKS):
                stop = min(start + BLOCK_TICKS, count)
                block.ticks[: stop - start] = table.read("tick", start, stop)
                columns = [
                    table.read(name, start, stop).reshape(stop - start, -1)
                    for name in names
                ]
                block.rows[: stop - start] = np.hstack(columns)
                block.count = stop - start
                if stop - start == BLOCK_TICKS:
                    block = sink.put(block)

    def describe(self) -> str:
        """Return a text table: name, shape, unit, frame, columns and meaning."""
        rows = [_HEADINGS, *map(self._described, self._layouts.values())]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = (
            "  ".join(
                cell.ljust(width) for cell, width in zip(row, widths, strict=True)
            )
            for row in rows
        )
        return "\n".join(line.rstrip() for line in lines)

    def __getitem__(self, name: str) -> SignalArray:
        """Return a signal at every tick, (n, *shape).

        Raises:
            UnknownSignalError: the run has no such signal.
        """
        if name not in self._cache:
            values = self.read(name, 0, self.count)
            values.flags.writeable = False
            self._cache[name] = values
        return self._cache[name]

    def __contains__(self, name: object) -> bool:
        """Return whether the run has such a signal."""
        return name in self._layouts

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names, in the order of the table of signals."""
        return iter(self._layouts)

    def __len__(self) -> int:
        """Return the number of signals."""
        return len(self._layouts)

    def __repr__(self) -> str:
        """Return the numbers of signals and ticks."""
        return f"<Signals: {len(self)} signals at {self.count} ticks>"

    def _described(self, layout: SignalLayout) -> tuple[str, ...]:
        labels = [label for label in layout.labels if label]
        if len(labels) > _SHOWN_LABELS:
            labels = [*labels[:2], "...", *labels[-2:]]
        words = ", ".join(f"{n} {word}" for n, word in enumerate(layout.words))
        return (
            layout.name,
            str((self.count, *layout.shape)),
            layout.unit,
            layout.frame or "-",
            " ".join(labels) or "-",
            layout.meaning + (f" {words}." if words else ""),
        )

    def _unknown(self, name: str) -> str:
        if name in BY_NAME:
            who = BY_NAME[name].known_by
            return f"signal {name!r}: this run has none; its {who} told nothing of it"
        near = difflib.get_close_matches(name, self._layouts, n=3)
        hint = (
            f"did you mean {' or '.join(map(repr, near))}?"
            if near
            else f"there are {', '.join(self._layouts)}"
        )
        return f"signal {name!r}: there is no such signal; {hint}"


class TickSinks(NamedTuple):
    """Sinks for the signals of each tick, of both sides of a run in one process."""

    robot: TickSink
    controller: TickSink


def memory_sinks() -> TickSinks:
    """Keep the signals of a run in memory, which grows with it."""
    return TickSinks(MemoryTicks(), MemoryTicks())


@contextmanager
def file_sinks(folder: Path) -> Iterator[TickSinks]:
    """Write the signals during a run; the files are complete however the run ends.

    Args:
        folder: gets the two ticks files.

    Raises:
        OSError: the disk failed.
    """
    with (
        TickFile(folder / TICKS, may_wait=True) as robot,
        TickFile(folder / CONTROLLER_TICKS, may_wait=True) as controller,
    ):
        yield TickSinks(robot, controller)


def read_signals(place: str | Path) -> Signals:
    """Read the signals of a recorded run.

    Args:
        place: folder of the run, or one ticks file.

    Raises:
        UsageError: there is no record, or it cannot be read.
    """
    place = Path(place)
    settle_run(place)
    if not place.is_dir():
        return Signals([_read_table(place)])
    tables = []
    for path in (place / TICKS, place / CONTROLLER_TICKS):
        if path.exists():
            try:
                tables.append(_read_table(path))
            except UsageError as error:
                if path.name == TICKS:
                    raise
                _LOG.warning("%s", error)
    if not tables:
        if not (place / MARKER).is_file():
            raise UsageError(f"{place}: {NO_RUN}")
        raise UsageError(
            f"{place / TICKS}: missing; the run ended before it kept a tick, or had no "
            "--out. Make it again with --out, and let it run"
        )
    return Signals(tables)


class SignalsInfo(msgspec.Struct, kw_only=True):
    """The signals of a run in figures."""

    is_cut_off: bool
    ticks: int
    first_tick: int | None
    last_tick: int | None
    lost_ticks: int
    """Ticks missing from a ticks file, since the disk was too slow or full."""
    gaps: list[str]
    """What is missing in damaged or cut off files, in words."""
    signals: dict[str, list[int]]
    """Shape of each signal, by name."""


def signals_info(signals: Signals) -> SignalsInfo:
    """Return the signals of a run in figures; all are read, since damage shows then."""
    count = signals.count
    for name in signals:
        for start in range(0, count, BLOCK_TICKS):
            signals.read(name, start, start + BLOCK_TICKS)
    return SignalsInfo(
        is_cut_off=signals.is_cut_off,
        ticks=count,
        first_tick=int(signals.ticks[0]) if count else None,
        last_tick=int(signals.ticks[-1]) if count else None,
        lost_ticks=signals.lost_ticks,
        gaps=signals.gaps,
        signals={n: [count, *signals.layout(n).shape] for n in signals},
    )


def holds_signals(place: Path) -> bool:
    """Return whether a place is one for :func:`read_signals`: folder or ticks file."""
    settle_run(place)
    return place.is_dir() or is_tick_file(place)


def _read_table(path: Path) -> TickTable:
    try:
        return TickFileTable(path)
    except TickFileError as error:
        raise UsageError(str(error)) from error
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror or error}") from error


def _join(ticks: list[SignalArray]) -> SignalArray:
    """All ticks of all recorders, each once and in order."""
    if not ticks:
        return np.zeros(0, dtype=np.int64)
    joined: SignalArray = np.unique(np.concatenate(ticks))
    joined.flags.writeable = False
    return joined


def _rows_at(ticks: SignalArray, own: SignalArray) -> SignalArray:
    """Row of each tick in a recorder: the last one of several, -1 if there is none."""
    order = np.argsort(own, kind="stable")
    at = np.searchsorted(own[order], ticks, side="right") - 1
    rows = order[np.maximum(at, 0)]
    found: SignalArray = np.where((at >= 0) & (own[rows] == ticks), rows, -1)
    return found
