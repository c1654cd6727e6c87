"""Collects the signals of a run's ticks in blocks, for memory or disk."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from surefoot.schemas.arrays import Array
from surefoot.schemas.signals import SignalLayout

BLOCK_TICKS = 512
"""Ticks in a block: the most that a crash costs, and the unit of reading."""
SignalArray = NDArray[Any]
"""Values of any signal: float64, int64 or int8."""


class Block:
    """Numbers of up to ``BLOCK_TICKS`` ticks, one row each.

    Attributes:
        ticks: (BLOCK_TICKS,) the robot's tick counter.
        rows: (BLOCK_TICKS, width) all signals side by side, whole numbers as floats.
        count: number of filled rows.
    """

    def __init__(self, width: int) -> None:
        """Allocate a full block."""
        self.ticks = np.zeros(BLOCK_TICKS, dtype=np.int64)
        self.rows: Array = np.zeros((BLOCK_TICKS, width))
        self.count = 0


class BlockFormat:
    """Assigns the columns of a block's rows to signals.

    Attributes:
        layouts: layouts by name, in the order of the columns; ``tick``, wherever it
            stands among them, has no columns.
        width: number of columns.
    """

    def __init__(self, layouts: Sequence[SignalLayout]) -> None:
        """Lay the signals side by side."""
        self.layouts = {layout.name: layout for layout in layouts}
        self._columns: dict[str, slice] = {}
        self.width = 0
        for layout in layouts:
            if layout.name == "tick":
                continue
            end = self.width + len(layout.labels)
            self._columns[layout.name] = slice(self.width, end)
            self.width = end

    def signals(self, block: Block) -> dict[str, SignalArray]:
        """Copy all signals out of a block.

        Returns:
            Arrays by name, (count, *shape) in the signal's dtype. A signal that is
            missing in all ticks of the block is left out.
        """
        count = block.count
        found: dict[str, SignalArray] = {"tick": block.ticks[:count].copy()}
        for name, columns in self._columns.items():
            layout = self.layouts[name]
            values = block.rows[:count, columns].astype(layout.dtype)
            if not is_missing(values):
                found[name] = values.reshape(count, *layout.shape)
        return found


def is_missing(values: SignalArray) -> bool:
    """Return whether an array of a signal holds only missing values."""
    missing = np.isnan(values) if values.dtype.kind == "f" else values < 0
    return bool(missing.all())


class TickSink(Protocol):
    """Receives the blocks of a recorder.

    The block that is being filled belongs to the sink all the time. So a run can end
    without a word from the recorder.

    Attributes:
        lost_ticks: ticks that it could not keep, or that what it copies lacks.
        is_cut_off: whether what it copies has no end; then it gets none either.
    """

    lost_ticks: int
    is_cut_off: bool

    def open(self, form: BlockFormat) -> Block:
        """Begin; called once, before the first tick.

        Returns:
            A block to fill.
        """

    def put(self, block: Block) -> Block:
        """Take a full block.

        Returns:
            An empty block to fill next.
        """


class TickRecorder:
    """Fills blocks row by row, one row per tick; in the loop it only copies."""

    def __init__(self, layouts: Sequence[SignalLayout], sink: TickSink) -> None:
        """Begin."""
        self._sink = sink
        self._block = sink.open(BlockFormat(layouts))

    def add(self, tick: int, parts: Sequence[Array]) -> None:
        """Add a tick.

        Args:
            tick: the robot's tick counter.
            parts: flat arrays; put together they are the signals after ``tick``.

        Raises:
            ValueError: they hold more or fewer numbers than that.
        """
        block = self._block
        row = block.count
        block.ticks[row] = tick
        np.concatenate(parts, out=block.rows[row])
        block.count = row + 1
        if block.count == BLOCK_TICKS:
            self._block = self._sink.put(block)


class TickTable(ABC):
    """The ticks that one recorder took.

    Attributes:
        layouts: layouts of the recorded signals, by name.
        lost_ticks: number of ticks that were lost.
        is_cut_off: whether the end is missing.
        gaps: what else than lost ticks is missing, in words.
    """

    layouts: dict[str, SignalLayout]
    lost_ticks: int = 0
    is_cut_off: bool = False
    gaps: Sequence[str] = ()

    @property
    @abstractmethod
    def counts(self) -> Sequence[int]:
        """Number of ticks in each block."""

    @abstractmethod
    def load(self, name: str, block: int) -> SignalArray | None:
        """Return a signal in a block, (count, *shape); None if it is missing there."""

    def __len__(self) -> int:
        """Return the number of ticks."""
        return sum(self.counts)

    def read(self, name: str, start: int = 0, stop: int | None = None) -> SignalArray:
        """Read some rows of a signal, loading only their blocks.

        Args:
            name: one of ``layouts``.
            start: first row.
            stop: row after the last; None for all.

        Returns:
            (stop - start, *shape), with missing values where nothing was recorded.
        """
        layout = self.layouts[name]
        stop = len(self) if stop is None else min(stop, len(self))
        rows = missing_rows(layout, max(stop - start, 0))
        first = 0
        for index, count in enumerate(self.counts):
            begin, end = max(start - first, 0), min(stop - first, count)
            if begin < end and (block := self.load(name, index)) is not None:
                at = first + begin - start
                rows[at : at + end - begin] = block[begin:end]
            first += count
        return rows


def missing_rows(layout: SignalLayout, count: int) -> SignalArray:
    """Return the missing values of a signal, (count, *shape)."""
    return np.full((count, *layout.shape), layout.missing, dtype=layout.dtype)


class MemoryTicks(TickTable):
    """Keeps all blocks in memory, which grows with the run; readable at any time."""

    def __init__(self) -> None:
        """Begin without blocks."""
        self._form = BlockFormat([])
        self._kept: list[dict[str, SignalArray]] = []
        self._filling = Block(0)

    def open(self, form: BlockFormat) -> Block:
        """Begin; see :class:`TickSink`."""
        self._form, self._filling = form, Block(form.width)
        return self._filling

    def put(self, block: Block) -> Block:
        """Keep a block; see :class:`TickSink`."""
        self._kept.append(self._form.signals(block))
        block.count = 0
        return block

    @property
    def layouts(self) -> dict[str, SignalLayout]:  # type: ignore[override]
        """Layouts of the recorded signals, by name."""
        told = {name for block in self._blocks for name in block}
        return {n: layout for n, layout in self._form.layouts.items() if n in told}

    @property
    def counts(self) -> Sequence[int]:
        """Number of ticks in each block."""
        return [len(block["tick"]) for block in self._blocks]

    def load(self, name: str, block: int) -> SignalArray | None:
        """Return a signal in a block; None if it is missing there."""
        return self._blocks[block].get(name)

    @property
    def _blocks(self) -> list[dict[str, SignalArray]]:
        """All blocks, including the one that is being filled."""
        if not self._filling.count:
            return self._kept
        return [*self._kept, self._form.signals(self._filling)]
