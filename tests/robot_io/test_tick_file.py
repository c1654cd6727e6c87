"""Ticks files: written during a run, and read whole or cut off."""

from __future__ import annotations

import errno
import struct
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader

from surefoot.robot_io.errors import TickFileError
from surefoot.robot_io.ticks import write
from surefoot.robot_io.ticks.read import TickFileTable, is_tick_file
from surefoot.robot_io.ticks.recorder import (
    BLOCK_TICKS,
    Block,
    BlockFormat,
    MemoryTicks,
    TickRecorder,
    TickSink,
)
from surefoot.robot_io.ticks.write import BLOCKS_UNDERWAY, FIRST_TICK, TickFile
from surefoot.schemas.signals import SignalLayout, lay_out, layout_from_metadata
from tests.support import wait_until

JOINTS = ("hip", "knee", "ankle")
NAMES = ("tick", "time_s", "q", "in_contact", "wrench_qp", "true_platform_pose")
LAYOUTS = [lay_out(name, joints=JOINTS, platforms=2) for name in NAMES]
TICKS = 2 * BLOCK_TICKS + 100
PERIOD_S = 1e-3


def numbers(tick: int) -> list[np.ndarray]:
    """Return values of a tick that differ from all others; contacts begin at 700."""
    rng = np.random.default_rng(tick)
    contacts = [1, 0] if tick >= 700 else [-1, -1]
    parts = [[tick * PERIOD_S], rng.normal(size=3), contacts, [tick % 3]]
    return [np.asarray(part, dtype=float) for part in (*parts, rng.normal(size=14))]


def fill(sink: TickSink, ticks: range = range(TICKS)) -> None:
    recorder = TickRecorder(LAYOUTS, sink)
    for tick in ticks:
        recorder.add(tick, numbers(tick))


def write_file(path: Path, ticks: range = range(TICKS)) -> None:
    with TickFile(path, may_wait=True) as file:
        fill(file, ticks)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ticks") / "ticks.mcap"
    write_file(path)
    return path


@pytest.fixture(scope="module")
def kept() -> MemoryTicks:
    memory = MemoryTicks()
    fill(memory)
    return memory


def record_ends(data: bytes) -> Iterator[int]:
    """Yield where each record of an MCAP file ends [bytes]."""
    at = 8
    while at + 9 <= len(data):
        (length,) = struct.unpack_from("<Q", data, at + 1)
        at += 9 + length
        yield at


def test_file_and_memory_give_the_same_numbers_and_layouts(
    whole: Path, kept: MemoryTicks
) -> None:
    table = TickFileTable(whole)
    assert (table.is_cut_off, table.lost_ticks, len(table)) == (False, 0, TICKS)
    assert table.layouts == kept.layouts
    assert set(table.layouts) == set(NAMES)
    for name in NAMES:
        read, expected = table.read(name), kept.read(name)
        assert read.dtype == expected.dtype == np.dtype(table.layouts[name].dtype)
        assert read.tobytes() == expected.tobytes(), name
    q = [numbers(tick)[1] for tick in range(TICKS)]
    np.testing.assert_array_equal(kept.read("q"), q)
    assert kept.read("true_platform_pose").shape == (TICKS, 2, 7)


def test_any_rows_can_be_read_alone(whole: Path, kept: MemoryTicks) -> None:
    table = TickFileTable(whole)
    for start, stop in ((0, 1), (500, 530), (510, TICKS), (TICKS, TICKS + 5), (7, 7)):
        for name in NAMES:
            rows = kept.read(name)[start:stop]
            np.testing.assert_array_equal(table.read(name, start, stop), rows)


def test_what_nobody_told_is_missing_and_takes_no_room(whole: Path) -> None:
    table = TickFileTable(whole)
    told = table.read("in_contact")
    assert set(told[:700].ravel()) == {-1}
    np.testing.assert_array_equal(told[700:], [[1, 0]] * (TICKS - 700))
    assert table.load("in_contact", 0) is None


def test_the_mcap_projects_own_reader_reads_it(whole: Path, kept: MemoryTicks) -> None:
    parts: dict[str, list[bytes]] = {}
    with whole.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert {c.topic for c in summary.channels.values()} == set(NAMES)
        for _, channel, message in reader.iter_messages():
            (first_tick,) = FIRST_TICK.unpack_from(message.data)
            assert message.log_time == round(1e9 * first_tick * PERIOD_S)
            parts.setdefault(channel.topic, []).append(message.data[FIRST_TICK.size :])
            assert channel.metadata["unit"] == kept.layouts[channel.topic].unit
    for name in ("tick", "time_s", "q", "wrench_qp"):
        little = np.dtype(kept.layouts[name].dtype).newbyteorder("<")
        values = np.frombuffer(b"".join(parts[name]), dtype=little)
        np.testing.assert_array_equal(values, kept.read(name).ravel())
    count = summary.statistics
    assert count is not None
    assert count.message_count == sum(map(len, parts.values()))


def test_every_prefix_is_read_as_far_as_its_blocks_are_whole(
    whole: Path, kept: MemoryTicks, tmp_path: Path
) -> None:
    data = whole.read_bytes()
    ends = list(record_ends(data))
    inside = [end - back for end in ends for back in (1, 5, 9, 200)]
    cuts = sorted({*ends, *inside, *range(0, 40)} & set(range(len(data))))
    read = []
    for cut in cuts:
        path = tmp_path / "cut.mcap"
        path.write_bytes(data[:cut])
        try:
            table = TickFileTable(path)
        except TickFileError:
            read.append(0)
            continue
        read.append(len(table))
        for name in table.layouts:
            rows = kept.read(name, 0, len(table))
            np.testing.assert_array_equal(
                table.read(name), rows, err_msg=f"{cut} {name}"
            )
    assert read == sorted(read)
    assert set(read) == {0, BLOCK_TICKS, 2 * BLOCK_TICKS, TICKS}


@pytest.mark.parametrize("copies", [100, pytest.param(300, marks=pytest.mark.slow)])
def test_damage_costs_what_it_hits_and_is_never_read_as_numbers(
    whole: Path, kept: MemoryTicks, tmp_path: Path, copies: int
) -> None:
    data = whole.read_bytes()
    rng = np.random.default_rng(0)
    path = tmp_path / "damaged.mcap"
    refused = 0
    for _ in range(copies):
        damaged = bytearray(data)
        at = int(rng.integers(len(data)))
        length = int(rng.choice([1, 4, 64]))
        damaged[at : at + length] = rng.bytes(len(damaged[at : at + length]))
        path.write_bytes(damaged)
        try:
            table = TickFileTable(path)
        except TickFileError:
            refused += 1
            continue
        ticks = table.read("tick")
        assert set(ticks) <= set(range(TICKS))
        for name, layout in table.layouts.items():
            if name not in NAMES:
                continue
            values, true = table.read(name), kept.read(name)[ticks]
            missing = np.isnan(values) if layout.dtype == "float64" else values < 0
            assert (missing | (values == true)).all(), name
    assert refused < 0.1 * copies


@pytest.mark.parametrize("part", ["head", "content", "index"])
@pytest.mark.parametrize("is_cut", [False, True], ids=["whole", "cut off"])
def test_damage_to_a_signal_costs_it_one_block_wherever_it_is(
    whole: Path, kept: MemoryTicks, tmp_path: Path, part: str, is_cut: bool
) -> None:
    """Also in the first block; a damaged index costs the next signal as well."""
    data = whole.read_bytes()
    begins = [8, *record_ends(data)]
    chunks = [at for at in begins[:-1] if data[at] == Opcode.CHUNK]
    if is_cut:
        data = data[: begins[begins.index(chunks[-1]) + 2]]
    with whole.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    ends = [begins[begins.index(at) + 1] for at in chunks]
    ids = [struct.unpack_from("<H", data, end + 9)[0] for end in ends]
    names = [summary.channels[number].topic for number in ids]
    for number, (at, end) in enumerate(zip(chunks, ends, strict=True)):
        damaged = bytearray(data)
        byte = {"head": at + 1, "content": (at + end) // 2, "index": end}[part]
        damaged[byte] ^= 0xFF
        path = tmp_path / "damaged.mcap"
        path.write_bytes(damaged)
        table = TickFileTable(path)
        hit: dict[str, set[int]] = {}
        for place in (number, number + 1)[: 2 if part == "index" else 1]:
            first = BLOCK_TICKS * names[:place].count("tick")
            lost = {*range(first, min(first + BLOCK_TICKS, TICKS))}
            hit[[*names, ""][place]] = lost
        ticks = table.read("tick")
        assert set(ticks) == {*range(TICKS)} - hit.get("tick", set())
        assert set(table.layouts) == set(NAMES)
        for name in NAMES:
            same = np.isclose(
                table.read(name), kept.read(name)[ticks], rtol=0, atol=0, equal_nan=True
            )
            differs = ticks[~same.reshape(len(ticks), -1).all(axis=1)]
            assert set(differs) <= hit.get(name, set())
        assert table.gaps


@pytest.mark.parametrize("content", [b"", b"something else", bytes(5000)])
def test_other_files_are_refused_by_name(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "other.mcap"
    path.write_bytes(content)
    assert not is_tick_file(path)
    with pytest.raises(TickFileError, match=r"other\.mcap: not a ticks file"):
        TickFileTable(path)


def test_a_file_can_be_read_while_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "ticks.mcap"
    with TickFile(path, may_wait=True) as file:
        fill(file, range(BLOCK_TICKS + 5))

        def has_block() -> TickFileTable | None:
            try:
                return TickFileTable(path)
            except TickFileError:
                return None

        table = wait_until(has_block, what="the first block")
        assert table.is_cut_off
        assert len(table) == BLOCK_TICKS
    assert len(TickFileTable(path)) == BLOCK_TICKS + 5


def test_what_ends_a_run_early_does_not_cost_its_last_ticks(tmp_path: Path) -> None:
    path = tmp_path / "ticks.mcap"

    def interrupted() -> None:
        with TickFile(path, may_wait=True) as file:
            fill(file, range(7))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    table = TickFileTable(path)
    assert (len(table), table.is_cut_off) == (7, False)


@pytest.fixture
def slow_disk(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Block all writing until the event is set."""
    is_free = threading.Event()
    add = write._Mcap.add

    def slowly(self: Any, form: BlockFormat, block: Block) -> None:
        is_free.wait()
        add(self, form, block)

    monkeypatch.setattr(write._Mcap, "add", slowly)
    return is_free


def test_a_slow_disk_loses_ticks_counted_where_nobody_may_wait(
    slow_disk: threading.Event, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "ticks.mcap"
    ticks = (BLOCKS_UNDERWAY + 3) * BLOCK_TICKS
    with TickFile(path, may_wait=False) as file:
        fill(file, range(ticks))
        slow_disk.set()
    lost = 3 * BLOCK_TICKS
    assert file.lost_ticks == lost
    assert f"lacks {lost} ticks: the disk was too slow" in caplog.text
    table = TickFileTable(path)
    assert (len(table), table.lost_ticks) == (ticks - lost, lost)
    np.testing.assert_array_equal(table.read("tick"), np.arange(ticks - lost))


def test_a_slow_disk_is_waited_for_where_it_may_be(
    slow_disk: threading.Event, tmp_path: Path
) -> None:
    path = tmp_path / "ticks.mcap"
    ticks = (BLOCKS_UNDERWAY + 3) * BLOCK_TICKS
    timer = threading.Timer(0.2, slow_disk.set)
    timer.start()
    with TickFile(path, may_wait=True) as file:
        fill(file, range(ticks))
    assert file.lost_ticks == 0
    assert len(TickFileTable(path)) == ticks


def test_a_disk_that_fails_is_told_at_the_end_and_keeps_what_there_was(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    add = write._Mcap.add
    done = []

    def fail(self: Any, form: BlockFormat, block: Block) -> None:
        if done:
            raise OSError(errno.ENOSPC, "No space left on device")
        done.append(block)
        add(self, form, block)

    monkeypatch.setattr(write._Mcap, "add", fail)
    path = tmp_path / "ticks.mcap"
    file = TickFile(path, may_wait=True)
    with pytest.raises(OSError, match="No space left") as told, file:
        fill(file, range(40 * BLOCK_TICKS))
    assert told.value.filename == str(path)
    assert file.lost_ticks == 39 * BLOCK_TICKS
    table = TickFileTable(path)
    assert (len(table), table.is_cut_off) == (BLOCK_TICKS, True)


def test_any_failure_to_write_is_told_and_nobody_waits_for_ever(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def fail(self: Any, form: BlockFormat, block: Block) -> None:
        raise KeyError("time_s")

    monkeypatch.setattr(write._Mcap, "add", fail)
    file = TickFile(tmp_path / "ticks.mcap", may_wait=True)
    with pytest.raises(KeyError, match="time_s"), file:
        fill(file, range((BLOCKS_UNDERWAY + 2) * BLOCK_TICKS))
    assert file.lost_ticks == (BLOCKS_UNDERWAY + 2) * BLOCK_TICKS


def test_a_place_that_cannot_be_written_is_told_at_the_start(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"cannot record to .*nowhere"):
        TickFile(tmp_path / "nowhere" / "ticks.mcap", may_wait=True)


def test_a_wrong_number_of_values_is_refused() -> None:
    recorder = TickRecorder(LAYOUTS, MemoryTicks())
    with pytest.raises(ValueError, match="shape"):
        recorder.add(0, numbers(0)[:-1])


def test_a_layout_survives_its_texts() -> None:
    for layout in LAYOUTS:
        again: SignalLayout = layout_from_metadata(layout.name, layout.metadata())
        assert again == layout
