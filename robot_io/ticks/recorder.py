"""Ticks of a run on their way to memory or disk."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from surefoot.schemas.arrays import Array
from surefoot.schemas.signals import SignalLayout

BLOCK_TICKS = 512
"""Ticks in a block: what a crash can cost, and what a reader takes at a time."""
SignalArray = NDArray[Any]
"""Any signal: float64, int64 or int8."""


class Block:
    """Numbers of up to ``BLOCK_TICKS`` ticks, a row each.

    Attributes:
        ticks: (BLOCK_TICKS,) the robot's counter.
        rows: (BLOCK_TICKS, width) the signals side by side; whole numbers, too.
        count: rows that are filled.
    """

    def __init__(self, width: int) -> None:
        """Take the memory for a full block."""
        self.ticks = np.zeros(BLOCK_TICKS, dtype=np.int64)
        self.rows: Array = np.zeros((BLOCK_TICKS, width))
        self.count = 0


class BlockFormat:
    """Which columns of a block's rows belong to which signal.

    Attributes:
        layouts: by name, in the order of the columns; ``tick``, wherever it stands
            among them, has none.
        width: how many columns there are.
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
            (count, *shape) in the signal's dtype, by name. A signal that nobody told
            in any of the block's ticks is left out.
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
    """Whether an array of a signal holds nothing but what stands for missing."""
    missing = np.isnan(values) if values.dtype.kind == "f" else values < 0
    return bool(missing.all())


class TickSink(Protocol):
    """Where blocks go.

    The block that is being filled is the sink's all the time, so that a run's end needs
    no word from who fills it.

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
    """Rows of numbers, tick by tick; in the loop it only copies."""

    def __init__(self, layouts: Sequence[SignalLayout], sink: TickSink) -> None:
        """Begin."""
        self._sink = sink
        self._block = sink.open(BlockFormat(layouts))

    def add(self, tick: int, parts: Sequence[Array]) -> None:
        """Take in a tick.

        Args:
            tick: the robot's counter.
            parts: flat; one behind the other they are the signals after ``tick``.

        Raises:
            ValueError: they are more or fewer numbers than that.
        """
        block = self._block
        row = block.count
        block.ticks[row] = tick
        np.concatenate(parts, out=block.rows[row])
        block.count = row + 1
        if block.count == BLOCK_TICKS:
            self._block = self._sink.put(block)


class TickTable(ABC):
    """What one recorder took in.

    Attributes:
        layouts: of the signals that were told, by name.
        lost_ticks: how many ticks it could not keep.
        is_cut_off: whether its end is missing.
    """

    layouts: dict[str, SignalLayout]
    lost_ticks: int = 0
    is_cut_off: bool = False

    @property
    @abstractmethod
    def counts(self) -> Sequence[int]:
        """Ticks in each block."""

    @abstractmethod
    def load(self, name: str, block: int) -> SignalArray | None:
        """A signal in a block, (count, *shape); None where nobody told it."""

    def __len__(self) -> int:
        """How many ticks there are."""
        return sum(self.counts)

    def read(self, name: str, start: int = 0, stop: int | None = None) -> SignalArray:
        """Read some rows of a signal; other blocks than theirs are not touched.

        Args:
            name: one of ``layouts``.
            start: first row.
            stop: row after the last; None for all.

        Returns:
            (stop - start, *shape), missing values where nobody told it.
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
    """(count, *shape) what stands where nobody told a signal."""
    return np.full((count, *layout.shape), layout.missing, dtype=layout.dtype)


class MemoryTicks(TickTable):
    """Keeps all blocks, and grows with the run; can be read at any time."""

    def __init__(self) -> None:
        """Nothing is kept yet."""
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
        """Of the signals that were told, by name."""
        told = {name for block in self._blocks for name in block}
        return {n: layout for n, layout in self._form.layouts.items() if n in told}

    @property
    def counts(self) -> Sequence[int]:
        """Ticks in each block."""
        return [len(block["tick"]) for block in self._blocks]

    def load(self, name: str, block: int) -> SignalArray | None:
        """A signal in a block; None where nobody told it."""
        return self._blocks[block].get(name)

    @property
    def _blocks(self) -> list[dict[str, SignalArray]]:
        """Also the one that is being filled."""
        if not self._filling.count:
            return self._kept
        return [*self._kept, self._form.signals(self._filling)]
