"""Signals have the same names in memory, files, exports and documentation."""

from __future__ import annotations

import csv
import dataclasses
import os
import shutil
from pathlib import Path

import msgspec
import numpy as np
import piqp
import pyarrow.parquet
import pytest

import surefoot as sf
from docs.site_build.signals_page import signals_page
from surefoot.recording.export import export_signals
from surefoot.robot_io.ticks.recorder import MemoryTicks, TickRecorder
from surefoot.run_folder import CONTROLLER_TICKS, MARKER, RECORD, TICKS
from surefoot.run_plan import make_plan
from surefoot.runs import execute
from surefoot.schemas.signals import QP_WORDS, SIGNALS, WALK_SIGNALS, lay_out
from surefoot.signals import file_sinks
from surefoot.stabilizer.controller import ControllerOutput
from surefoot.stabilizer.telemetry import ControllerRecorder
from tests.support import ROLLING

TICK_COUNT = 500
SEED = 3
TIMING = "controller_ms"
ALL = [signal.name for signal in SIGNALS if signal.name not in WALK_SIGNALS]
"""Signals of a robot that only stands."""


@pytest.fixture(scope="module")
def memory() -> sf.Signals:
    return sf.simulate("walker", ROLLING, seed=SEED).signals


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return folders of the same run, inline and over the bus."""
    made = {}
    for mode in ("inline", "lockstep"):
        made[mode] = tmp_path_factory.mktemp(mode) / "run"
        plan = make_plan(ROLLING, robot="walker", seed=SEED, mode=mode)
        execute(plan, out=made[mode])
    return made


def equal_but_timing(first: sf.Signals, second: sf.Signals) -> None:
    assert list(first) == list(second)
    for name in first:
        assert first.layout(name) == second.layout(name)
        assert first[name].dtype == second[name].dtype
        if name != TIMING:
            assert first[name].tobytes() == second[name].tobytes(), name


def test_a_run_has_all_signals_there_are(memory: sf.Signals) -> None:
    assert list(memory) == ALL
    for name in memory:
        assert memory[name].shape == (TICK_COUNT, *memory.layout(name).shape)
        assert not np.isnan(memory[name].astype(float)).any(), name
    np.testing.assert_array_equal(memory.ticks, np.arange(TICK_COUNT))
    np.testing.assert_array_equal(memory.time_s, 1e-3 * np.arange(TICK_COUNT))


@pytest.mark.parametrize("mode", ["inline", "lockstep"])
def test_files_of_one_process_or_two_hold_what_memory_holds(
    memory: sf.Signals, folders: dict[str, Path], mode: str
) -> None:
    equal_but_timing(memory, sf.load_run(folders[mode]).signals)
    equal_but_timing(memory, sf.read_signals(folders[mode]))


@pytest.mark.parametrize("missing_bytes", [0, 2000])
def test_a_copy_of_a_kept_run_holds_as_much(
    folders: dict[str, Path], tmp_path: Path, missing_bytes: int
) -> None:
    """Of a whole one and of one whose end is missing, which stays so."""
    shutil.copytree(folders["inline"], tmp_path / "run")
    path = tmp_path / "run" / TICKS
    os.truncate(path, path.stat().st_size - missing_bytes)
    run = sf.load_run(tmp_path / "run")
    copy = run.save(tmp_path / "copy").signals
    assert list(copy) == list(run.signals)
    for name in copy:
        assert copy[name].tobytes() == run.signals[name].tobytes(), name
    assert copy.is_cut_off == run.signals.is_cut_off == bool(missing_bytes)


def test_a_copy_of_a_kept_run_has_its_other_files(
    folders: dict[str, Path], tmp_path: Path
) -> None:
    """Its record and its logs, and what says when it was made, and with what."""
    kept = tmp_path / "run"
    shutil.copytree(folders["lockstep"], kept)
    about = msgspec.json.decode((kept / MARKER).read_bytes())
    about |= {"started": "2020-01-01T00:00:00+00:00", "packages": {"mujoco": "3.0"}}
    (kept / MARKER).write_bytes(msgspec.json.encode(about))
    copy = tmp_path / "copy"
    sf.load_run(kept).save(copy)
    assert {file.name for file in copy.iterdir()} == {f.name for f in kept.iterdir()}
    for name in (MARKER, RECORD, "robot.log"):
        assert (copy / name).read_bytes() == (kept / name).read_bytes(), name


def test_of_a_tick_that_came_again_the_last_row_counts(tmp_path: Path) -> None:
    """As for the stabilizer of a robot that began anew."""
    kept = MemoryTicks()
    layouts = [lay_out(n, joints=["a"]) for n in ("tick", "time_s", "q")]
    recorder = TickRecorder(layouts, kept)
    for row, tick in enumerate((*range(10), *range(4))):
        recorder.add(tick, [np.array([float(tick)]), np.array([float(row)])])
    signals = sf.Signals([kept])
    assert signals.time_s.tolist() == signals.ticks.tolist() == [*range(10)]
    assert signals["q"].ravel().tolist() == [10, 11, 12, 13, *range(4, 10)]


def test_a_copy_tells_what_its_original_lost(tmp_path: Path) -> None:
    kept = MemoryTicks()
    recorder = TickRecorder([lay_out(n, joints=[]) for n in ("tick", "time_s")], kept)
    recorder.add(0, [np.zeros(1)])
    kept.lost_ticks = 7
    with file_sinks(tmp_path) as sinks:
        sf.Signals([kept]).copy_to(sinks)
    assert sf.read_signals(tmp_path / TICKS).lost_ticks == 7


def test_one_file_alone_has_its_own_sides_signals(folders: dict[str, Path]) -> None:
    robot = sf.read_signals(folders["inline"] / TICKS)
    controller = sf.read_signals(folders["inline"] / CONTROLLER_TICKS)
    assert set(robot) & set(controller) == {"tick", "time_s"}
    assert set(robot) | set(controller) == set(ALL)


def test_signals_are_what_controller_and_robot_said(memory: sf.Signals) -> None:
    """Step by step, against the answers themselves."""
    sim = sf.Simulation("walker", ROLLING, seed=SEED, record=True)
    controller = sf.make_controller("whole-body", sim.robot)
    for tick in range(50):
        snapshot = sim.snapshot
        output = sim.step(controller)
        assert output is not None
        np.testing.assert_array_equal(memory["q"][tick], snapshot.q)
        for name in ("F_id", "F_meas", "com", "com_reference", "base_pose", "r"):
            np.testing.assert_array_equal(memory[name][tick], getattr(output, name))
        np.testing.assert_array_equal(memory["v_joint"][tick], output.v_joint)
        np.testing.assert_array_equal(memory["base_twist"][tick], output.base_twist)
        assert memory["in_contact"][tick].tolist() == list(output.in_contact or ())
        assert QP_WORDS[memory["motion_qp"][tick]] == output.motion_qp
    assert sim.signals.count == 50  # also while it goes on


def test_names_and_numbers_are_the_same_in_every_export(
    memory: sf.Signals, folders: dict[str, Path], tmp_path: Path
) -> None:
    signals = sf.read_signals(folders["inline"])
    columns = [column for name in ALL for column in memory.layout(name).columns]
    expected = signals.columns(0, TICK_COUNT)
    assert list(expected) == columns
    (path,) = export_signals(signals, "csv", tmp_path)
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == columns
    (path,) = export_signals(signals, "parquet", tmp_path)
    table = pyarrow.parquet.read_table(path)
    assert table.column_names == columns
    for column, values in expected.items():
        texts = [row[column] for row in rows]
        np.testing.assert_array_equal([float(text) for text in texts], values)
        np.testing.assert_array_equal(table[column].to_numpy(), values)
    assert table.schema.field("F_id.m_x_left").metadata[b"unit"] == b"N m"
    (path,) = export_signals(signals, "npz", tmp_path / "a.npz")
    with np.load(path) as arrays:
        assert arrays.files == ALL
        for name in ALL:
            np.testing.assert_array_equal(arrays[name], signals[name])


def test_the_docs_page_and_describe_tell_every_signal(memory: sf.Signals) -> None:
    told, page = memory.describe(), signals_page()
    assert [line.split()[0] for line in told.splitlines()] == ["name", *ALL]
    for entry in SIGNALS:
        if entry.name in WALK_SIGNALS:
            assert f"| `{entry.name}` |" in page
            continue
        layout = memory.layout(entry.name)
        line = next(x for x in told.splitlines() if x.startswith(f"{entry.name} "))
        for part in (str(memory[entry.name].shape), layout.unit, entry.meaning):
            assert part in line
        row = next(x for x in page.splitlines() if x.startswith(f"| `{entry.name}` |"))
        assert f"| {layout.unit} | {entry.frame} |" in row
        assert entry.meaning in row


def test_an_unknown_name_is_told_with_the_nearest(memory: sf.Signals) -> None:
    with pytest.raises(KeyError) as told:
        memory["F_measured"]
    assert str(told.value) == (
        "signal 'F_measured': there is no such signal; did you mean 'F_meas'?"
    )
    assert "F_measured" not in memory
    assert memory.get("F_measured") is None


def test_what_the_controller_does_not_tell_is_not_there() -> None:
    signals = sf.simulate("walker", ROLLING, controller="hold").signals
    assert {"q", "true_com", TIMING, "wrench_qp"} <= set(signals)
    assert not {"F_id", "com", "r", "v_joint", "in_contact"} & set(signals)
    with pytest.raises(sf.UnknownSignalError, match="its controller told nothing"):
        signals["F_id"]


def test_a_run_without_a_record_says_how_to_get_one() -> None:
    run = sf.simulate("walker", ROLLING, controller="hold", record=False)
    with pytest.raises(sf.UsageError, match="record=True"):
        _ = run.signals


def test_arrays_cannot_be_written_to(memory: sf.Signals) -> None:
    with pytest.raises(ValueError, match="read-only"):
        memory["q"][0] = 0.0


def test_ticks_that_one_side_lacks_are_missing_there_alone() -> None:
    robot, controller = MemoryTicks(), MemoryTicks()
    clock = [lay_out(name, joints=["a", "b"]) for name in ("tick", "time_s", "q")]
    recorder = TickRecorder(clock, robot)
    for tick in (0, 1, 2, 3, 4):
        recorder.add(tick, (np.array([0.1 * tick]), np.array([tick, -tick])))
    other = ControllerRecorder(controller, joints=["a", "b"], period_s=0.1)
    for tick, word in ((1, "ok"), (3, "numerics"), (4, "of another kind"), (6, "ok")):
        output = ControllerOutput(np.zeros(2), com=np.full(3, tick), wrench_qp=word)
        other.add(tick, output, duration_ns=tick * 1_000_000)
    signals = sf.Signals([robot, controller])
    assert signals.ticks.tolist() == [0, 1, 2, 3, 4, 6]
    np.testing.assert_allclose(signals.time_s, [0.0, 0.1, 0.2, 0.3, 0.4, 0.6])
    np.testing.assert_array_equal(signals["q"][:, 0], [0, 1, 2, 3, 4, np.nan])
    np.testing.assert_array_equal(signals["com"][:, 0], [np.nan, 1, np.nan, 3, 4, 6])
    words = [QP_WORDS[n] if n >= 0 else "-" for n in signals["wrench_qp"]]
    assert words == ["-", "ok", "-", "numerics", "other", "ok"]
    assert "F_id" not in signals
    np.testing.assert_array_equal(signals.read("com", 2, 4)[:, 1], [np.nan, 3])


def test_every_status_of_the_solver_has_its_word() -> None:
    names = [name for name in vars(piqp.Status) if name.startswith("PIQP_")]
    assert len(names) > 3
    words = {name.removeprefix("PIQP_").lower() for name in names} - {"solved"}
    assert words <= set(QP_WORDS)


def test_every_part_of_an_answer_is_a_signal() -> None:
    parts = {field.name for field in dataclasses.fields(ControllerOutput)}
    assert parts - {"walk"} <= set(ALL)
