"""The memory of a long run does not grow, recorded or not."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import msgspec
import pytest
from mcap.reader import make_reader

import surefoot as sf
from surefoot.recording.write import McapFile
from surefoot.robot_io.client_side.observer import Sample
from surefoot.robot_io.realtime import quiet_interpreter
from surefoot.robot_io.ticks.recorder import BLOCK_TICKS
from surefoot.robot_io.ticks.write import BLOCKS_UNDERWAY
from surefoot.run_plan import make_plan
from surefoot.signals import TickSinks, file_sinks
from tests.surefoot.recording.mcap_reading import messages

pytestmark = pytest.mark.closed_loop

LONG = sf.Scenario(name="long", duration_s=3600.0)
WARM_TICKS = 1500
TICKS = 3000
BYTES_PER_TICK = 4.0
"""Limit; one object kept of each tick would take at least sixteen bytes."""
RECORDED_BYTES_PER_TICK = 80.0
"""Limit; data on their way to the disk vary by up to a megabyte."""
BLOCKS_PER_TICK = 0.05
CHUNKS, PER_CHUNK = 200, 4
"""Chunks of a record, and messages of 36 kB in each."""

needs_glibc = pytest.mark.skipif(
    sys.platform != "linux", reason="mallinfo2 is glibc's; memory is the same elsewhere"
)


class _MallInfo(ctypes.Structure):
    """Statistics of glibc's heap."""

    _fields_ = tuple(
        (name, ctypes.c_size_t)
        for name in (
            *("arena", "ordblks", "smblks", "hblks", "hblkhd"),
            *("usmblks", "fsmblks", "uordblks", "fordblks", "keepcost"),
        )
    )


def heap_bytes() -> int:
    """Return the bytes that libraries hold on the heap."""
    libc = ctypes.CDLL("libc.so.6")
    libc.mallinfo2.restype = _MallInfo
    info = libc.mallinfo2()
    return int(info.uordblks + info.hblkhd)


@contextmanager
def sinks_to(folder: Path | None) -> Iterator[TickSinks | None]:
    with nullcontext() if folder is None else file_sinks(folder) as sinks:
        yield sinks


@pytest.mark.usual("whole-body")
@needs_glibc
@pytest.mark.parametrize("controller", ["whole-body", "zmp"])
def test_no_tick_leaves_anything_behind(controller: str) -> None:
    grown, blocks = growth(controller, None, warm=WARM_TICKS)
    assert grown < BYTES_PER_TICK
    assert blocks < BLOCKS_PER_TICK


@needs_glibc
def test_recording_takes_the_same_memory_all_the_time(tmp_path: Path) -> None:
    """Once every block has been in use, and whatever is on its way to the disk."""
    underway = BLOCKS_UNDERWAY + 2
    grown, blocks = growth("hold", tmp_path, warm=underway * BLOCK_TICKS, ticks=20000)
    assert grown < RECORDED_BYTES_PER_TICK
    assert blocks < BLOCKS_PER_TICK


def test_a_record_takes_the_same_memory_all_the_time(tmp_path: Path) -> None:
    """What is where in the file is kept on the disk until its end."""
    path = tmp_path / "run.mcap"
    message = {"tick": 0, "stamp_ns": 0, "values": [0.25] * 4000}

    def fill(chunks: int, *, first: int) -> None:
        for tick in range(first, first + chunks * PER_CHUNK):
            data = msgspec.msgpack.encode(message | {"tick": tick})
            file.add([Sample("joints", data, 0)])

    with McapFile(
        path, channels=["joints"], keys={"joints": "j"}, attachments=[], raw=True
    ) as file:
        fill(20, first=0)
        before = sys.getallocatedblocks()
        fill(CHUNKS, first=20 * PER_CHUNK)
        grown = sys.getallocatedblocks() - before
    assert grown < 0.5 * CHUNKS
    with path.open("rb") as whole:
        summary = make_reader(whole).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert len(summary.chunk_indexes) == summary.statistics.chunk_count >= CHUNKS
    assert len(list(messages(path))) == (CHUNKS + 20) * PER_CHUNK


def growth(
    controller: str, folder: Path | None, *, warm: int, ticks: int = TICKS
) -> tuple[float, float]:
    """Return the growth of heap [bytes] and of Python objects per tick."""
    plan = make_plan(LONG, robot="walker", controller=controller)
    with sinks_to(folder) as sinks, quiet_interpreter():
        sim = sf.Simulation.of_plan(plan, sinks=sinks)
        law = sf.make_controller(controller, sim.robot)
        while sim.tick < warm:
            sim.step(law)
        before = heap_bytes(), sys.getallocatedblocks()
        while sim.tick < warm + ticks:
            sim.step(law)
        after = heap_bytes(), sys.getallocatedblocks()
    assert not sim.fell
    return (after[0] - before[0]) / ticks, (after[1] - before[1]) / ticks
