"""Signals of every tick, kept in memory."""

from __future__ import annotations

from collections.abc import Sequence

from surefoot.robot_io.ticks.recorder import Block, BlockFormat, SignalArray
from surefoot.robot_io.ticks.table import TickTable
from surefoot.schemas.signals import SignalLayout


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
