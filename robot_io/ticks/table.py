"""Signals of many ticks, read block by block, whether from memory or from a file."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from surefoot.robot_io.ticks.recorder import Block, BlockFormat, SignalArray
from surefoot.schemas.signals import SignalLayout


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
