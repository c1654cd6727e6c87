"""Reports about real runs."""

from __future__ import annotations

import errno
import json
import re
import shutil
from fnmatch import fnmatch
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import msgspec
import numpy as np
import pytest

pytest.importorskip("viser", reason="reports need viser: pip install -e .[view]")
pytest.importorskip("plotly", reason="reports need plotly: pip install -e .[view]")

from surefoot.errors import UsageError
from surefoot.recording.read import read_record
from surefoot.report.curves import ESTIMATED, TRUE, com_error, curves, steps_of
from surefoot.report.page import REPORT_FILES, Media, write_page, write_report
from surefoot.report.panels import frame_rows, panel_groups, state_at
from surefoot.report.run_data import RunData, load_run, load_runs
from surefoot.report.tables import figure_rows, setting_rows
from surefoot.robot_io.client_side.observer import LatestMessages
from surefoot.robot_io.ticks.recorder import BLOCK_TICKS
from surefoot.run_folder import folder_of_run
from surefoot.runs import load_run as run_of
from surefoot.runs import simulate
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.messages import ImuState, JointState, StabilizerStatus, Truth
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.settings import ControllerSettings
from surefoot.schemas.walk_plan import WalkStatus
from surefoot.signals import read_signals, signals_info
from surefoot.sim_robot.metrics import COM_FROM_S
from surefoot.view.robot_shape import RobotShape
from surefoot.view.scene_state import state_of
from tests.command import Surefoot
from tests.files.damage import damage_first_block
from tests.surefoot.report.runs import make_report, shared_page, shared_runs

MM = 1e3
SAME_MM = 1e-6
CALIBRATED_S = ControllerSettings().estimator.calibration_s
"""Until this time the estimate uses only a few readings [s]."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return shared_runs(tmp_path_factory)


@pytest.fixture(scope="module")
def bus(folder: Path) -> RunData:
    return load_run(folder / "bus", label="bus")


@pytest.fixture
def broken(folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(folder / "inline", tmp_path / "broken"))


def test_the_plotted_error_is_the_one_of_the_result(bus: RunData) -> None:
    counted = com_error(bus)[bus.signals.time_s >= COM_FROM_S]
    rms = MM * np.sqrt((counted**2).mean(axis=0))
    np.testing.assert_allclose(rms, bus.result.com_error_rms_mm, atol=SAME_MM)


def test_drawing_does_not_change_what_is_drawn(bus: RunData) -> None:
    first, second = com_error(bus), com_error(bus)
    np.testing.assert_array_equal(first, second)


def test_every_curve_is_in_time_and_finite(bus: RunData) -> None:
    drawn = list(curves(bus))
    assert len({(curve.panel, curve.kind) for curve in drawn}) == len(drawn)
    for curve in drawn:
        assert len(curve.times) == len(curve.values) > 0, curve.panel
        assert np.all(np.diff(curve.times) >= 0), curve.panel
        assert np.isfinite(curve.values).all(), curve.panel
        assert curve.times[-1] < bus.result.duration_s


def test_the_estimated_base_agrees_with_the_true_one(bus: RunData) -> None:
    found = {(curve.panel, curve.kind): curve for curve in curves(bus)}
    for turn in ("roll", "pitch"):
        true = found[f"base_{turn}", "true"]
        estimated = found[f"base_{turn}", "estimated"]
        expected = np.interp(estimated.times, true.times, true.values)
        np.testing.assert_allclose(estimated.values, expected, atol=0.2)


def test_no_estimate_from_before_the_calibration_spoils_the_scale(
    bus: RunData,
) -> None:
    estimates = [curve for curve in curves(bus) if curve.kind == "estimated"]
    told = [curve for curve in estimates if curve.panel.startswith(("com_", "base_"))]
    assert len(told) == 5
    assert min(curve.times[0] for curve in told) == pytest.approx(CALIBRATED_S)


def test_a_run_without_record_lacks_what_only_the_bus_tells(
    folder: Path, bus: RunData
) -> None:
    inline = load_run(folder / "inline", label="inline")
    with_bus = {curve.panel for curve in curves(bus)}
    without = {curve.panel for curve in curves(inline)}
    assert without < with_bus
    assert with_bus - without == {"answer", "mode", "state"}


def test_runs_of_a_page_have_colours_of_their_own(folder: Path, bus: RunData) -> None:
    zmp = load_run(folder / "zmp", label="zmp")
    both = [(run.label, list(curves(run))) for run in (bus, zmp)]
    for curve in _curves(panel_groups(both)):
        assert curve["name"].startswith(("bus, ", "zmp, "))
    colours = {(c["run"], c["colour"]) for c in _curves(panel_groups(both))}
    assert len(colours) == len({colour for _, colour in colours}) == 2
    kinds = {(c["kind"], c["dash"]) for c in _curves(panel_groups(both))}
    assert len(kinds) == len({kind for kind, _ in kinds})


def test_changed_settings_are_marked_and_no_others(bus: RunData) -> None:
    changed = [row.name for row in setting_rows([bus]) if row.is_changed[0]]
    assert changed == ["tsid.base_kp"]


def test_differences_are_against_the_first_run(bus: RunData, folder: Path) -> None:
    zmp = load_run(folder / "zmp", label="zmp").result
    rows = {row.name: row for row in figure_rows([bus.result, zmp])}
    first, second = rows["CoM error rms x"].cells
    assert first.change == ""
    change = zmp.com_error_rms_mm[0] - bus.result.com_error_rms_mm[0]
    assert float(second.change) == pytest.approx(change, abs=0.051)


def test_every_figure_of_a_result_has_a_row(bus: RunData) -> None:
    shown = len(figure_rows([bus.result]))
    told = msgspec.structs.asdict(bus.result)
    numbers = [
        name for name, value in told.items() if "_" in name and value is not None
    ]
    assert shown > len(numbers)


def test_the_scene_shows_the_controllers_forces(bus: RunData) -> None:
    rows = frame_rows(bus)
    assert rows[0] == 0
    assert rows[-1] == bus.signals.count - 1
    state = state_at(bus, 700)
    np.testing.assert_array_equal(state.F_meas, bus.signals["F_meas"][700])
    np.testing.assert_array_equal(state.F_id, bus.signals["F_id"][700])
    np.testing.assert_array_equal(state.q, bus.signals["q"][700])


def test_the_page_says_where_the_scenes_forces_are_the_true_ones(
    folder: Path, bus: RunData, broken: Path
) -> None:
    inline = load_run(folder / "inline", label="inline")
    (broken / "controller-ticks.mcap").unlink()
    silent = load_run(broken, label="silent")
    np.testing.assert_array_equal(
        state_at(silent, 700).F_meas, silent.signals["true_F"][700]
    )
    np.testing.assert_array_equal(
        state_at(inline, 700).F_meas, inline.signals["F_meas"][700]
    )
    for run, is_told in ((bus, False), (inline, False), (silent, True)):
        write_page(broken, [run], [Media("scene-1.html")])
        page = (broken / "index.html").read_text()
        assert ("arrows are the true forces" in page) is is_told


WALK = """
name = "a walk to the left"
duration_s = 3.5
[start]
yaw_deg = 90.0
position_m = [0.5, -0.3]
[walk]
velocity_m_s = 0.3
start_s = 0.5
stop_s = 3.0
"""
NEAR_M, AMONG_FEET_M = 0.02, 0.2
"""Bounds of the CoM in a walk, from its reference and from the feet [m]."""


def test_where_a_walks_com_should_be_is_shown_where_the_robot_is(
    tmp_path: Path, surefoot_here: Surefoot
) -> None:
    (tmp_path / "walk.toml").write_text(WALK)
    done = surefoot_here("run", tmp_path / "walk.toml", "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    run = load_run(tmp_path / "run", label="run")
    true_com, footholds = run.signals["true_com"], run.signals["footholds"]
    assert np.ptp(true_com[:, 1]) > 10.0 * NEAR_M
    named = [row.name for row in figure_rows([run.result])]
    for name in ("CoM error", "half weight", "contact"):
        assert not any(name in told for told in named)
    assert "DCM error rms x" in named
    drawn = {(curve.panel, curve.kind) for curve in curves(run)}
    assert ("com_x", TRUE) not in drawn
    assert {("com_x", ESTIMATED), ("dcm_x", ESTIMATED)} < drawn
    steps = steps_of(run)
    for row in range(0, run.signals.count, 50):
        state = state_at(run, row, steps)
        assert (state.walk is None) is not footholds[row].any()
        assert state.com_reference is not None
        assert np.linalg.norm(state.com_reference - true_com[row]) < NEAR_M

    # As a live page sees it, with and without a simulator that tells the truth.
    shape, record = RobotShape(run.robot), read_record(tmp_path / "run" / "run.mcap")
    heard = {
        channel: {message["tick"]: message for message in record.each(channel)}
        for channel in ("joints", "imu", "stabilizer", "walk_status", "truth")
    }
    truths = sorted(heard["truth"])
    for tick, told in heard["walk_status"].items():
        seen = LatestMessages(
            joints=msgspec.convert(heard["joints"][tick], JointState),
            imu=msgspec.convert(heard["imu"][tick], ImuState),
            stabilizer=msgspec.convert(heard["stabilizer"][tick], StabilizerStatus),
            walk_status=msgspec.convert(told, WalkStatus),
        )
        at = min(truths, key=lambda other: abs(other - tick))
        known = seen._replace(truth=msgspec.convert(heard["truth"][at], Truth))
        for sight in (seen, known):
            live = state_of(sight, run.robot, shape)
            assert live is not None
            assert (live.walk is None) is not any(told["foothold_left"])
            feet = [
                live.base @ shape.poses(live.q)[f.sole_frame]
                for f in run.robot.file.foot
            ]
            middle = 0.5 * (feet[0] + feet[1])[:2, 3]
            for place in (live.com, live.com_reference):
                assert place is not None
                assert np.linalg.norm(place[:2] - middle) < AMONG_FEET_M
        assert np.linalg.norm(live.com_reference - live.com) < NEAR_M


def test_the_page_names_the_program_that_made_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["/home/me/mine.py", "--fast"])
    scenario = Scenario(name="short", duration_s=0.01)
    simulate("walker", scenario, controller="hold").save(tmp_path / "run")
    run = load_run(tmp_path / "run", label="run")
    write_page(tmp_path, [run], [Media("scene-1.html")])
    assert "<code>mine.py --fast</code>" in (tmp_path / "index.html").read_text()


def test_a_report_that_fails_leaves_the_former_one(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, out = folder / "inline", tmp_path / "page"

    def fail() -> None:
        disk_full = Mock(side_effect=OSError(errno.ENOSPC, "No space left on device"))
        with monkeypatch.context() as patch:
            patch.setattr("surefoot.report.page._render", disk_full)
            write_report([run], out, overwrite=True)

    with pytest.raises(OSError, match="No space"):
        fail()
    assert not out.exists()
    write_report([run], out)
    names = {path.name for path in out.iterdir()}
    assert all(any(fnmatch(name, each) for each in REPORT_FILES) for name in names)
    page = (out / "index.html").read_bytes()
    with pytest.raises(OSError, match="No space"):
        fail()
    assert {path.name for path in out.iterdir()} == names
    assert (out / "index.html").read_bytes() == page


def test_one_page_about_two_runs(tmp_path_factory: pytest.TempPathFactory) -> None:
    out = shared_page(tmp_path_factory)
    files = {path.name for path in out.iterdir()}
    assert files == {
        *("index.html", "data.js", "report.js", "plotly.min.js", "report.json"),
        *("scene-1.html", "scene-2.html"),
    }
    page = (out / "index.html").read_text()
    assert "http://" not in page
    assert "https://" not in page
    for text in ("tsid.base_kp", "stabilizer", "heaving ground", "mujoco"):
        assert text in page
    about = json.loads((out / "report.json").read_text())
    assert [result["controller"] for result in about["results"]] == [
        "whole-body",
        "zmp",
    ]
    assert [path.name for path in out.parent.iterdir()] == ["page"]


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("ticks.mcap", "before it kept a tick"),
        ("result.json", "was cut off"),
        ("run.json", "not the folder of a run"),
    ],
)
def test_what_is_missing_is_named(broken: Path, file: str, words: str) -> None:
    for path in broken.glob(f"*{file}"):
        path.unlink()
    _refused([broken], words)


def test_a_file_of_a_run_stands_for_its_folder(broken: Path) -> None:
    result = broken / "result.json"
    assert folder_of_run(result) == folder_of_run(broken) == broken
    assert run_of(result).result == run_of(broken).result
    stray = broken.parent / "stray.mcap"
    stray.touch()
    _refused([stray], "a file, and not in the folder of a run")


def test_what_is_damaged_in_its_notes_is_named(broken: Path) -> None:
    path = broken / "run.json"
    whole = json.loads(path.read_text())
    for name in whole:
        if whole[name] is None:
            continue  # without a relay
        path.write_text(json.dumps(whole | {name: None}))
        _refused([broken], rf"run\.json is damaged.*{name}")
        path.write_text(json.dumps({n: x for n, x in whole.items() if n != name}))
        if name in ("command", "started", "python", "platform", "packages"):
            write_page(broken, load_runs([broken]), [Media("scene-1.html")])
        else:
            _refused([broken], rf"run\.json is damaged.*{name}")
    path.write_text(json.dumps(whole))
    (broken / "settings.toml").write_text("tsid = 1\n")
    with pytest.raises(FileFormatError, match="tsid: got 1, expected a table"):
        load_runs([broken])


def test_a_record_that_was_never_begun_leaves_the_rest_of_the_page(
    broken: Path,
) -> None:
    (broken / "run.mcap.partial").touch()
    (run,) = load_runs([broken])
    assert {curve.panel for curve in curves(run)} >= {"com_x", "force_left"}
    write_page(broken, [run], [Media("scene-1.html")])
    page = (broken / "index.html").read_text()
    assert "its record of the bus is missing" in page
    assert "the file is empty" in page


def test_a_refusal_is_a_usage_error_and_leaves_nothing(
    broken: Path, surefoot_here: Surefoot
) -> None:
    (broken / "ticks.mcap").unlink()
    done = surefoot_here("report", broken)
    assert done.returncode == 2
    assert "kept no ticks" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (broken / "report").exists()


@pytest.mark.parametrize("how", ["cut off", "damaged"])
def test_ticks_that_are_cut_off_are_drawn_as_far_as_they_go(
    broken: Path, how: str
) -> None:
    whole = (broken / "ticks.mcap").read_bytes()
    half = len(whole) // 2
    rest = bytes([255]) * (half - 20) + whole[-20:]
    (broken / "ticks.mcap").write_bytes(
        whole[:half] + (rest if how == "damaged" else b"")
    )
    run = load_run(broken, label="cut")
    assert run.signals.is_cut_off
    write_page(broken, [run], [Media("scene-1.html")])
    told = rf"ticks\.mcap: {how} after tick \d+; what follows counts as missing"
    assert re.search(told, (broken / "index.html").read_text())
    drawn = {(curve.panel, curve.kind): curve for curve in curves(run)}
    true, estimated = drawn["com_x", "true"], drawn["com_x", "estimated"]
    assert 0.0 < true.times[-1] < estimated.times[-1]
    assert np.isfinite(true.values).all()


@pytest.mark.parametrize("signal", ["true_base_pose", "true_platform_pose", "tick"])
def test_a_damaged_beginning_costs_the_page_its_beginning(
    broken: Path, signal: str
) -> None:
    whole = {(curve.panel, curve.kind) for curve in curves(load_run(broken, label="a"))}
    damage_first_block(broken / "ticks.mcap", signal)
    run = load_run(broken, label="broken")
    assert {(curve.panel, curve.kind) for curve in curves(run)} == whole
    assert frame_rows(run)[0] == BLOCK_TICKS
    (told,) = signals_info(read_signals(broken)).gaps
    assert "damaged" in told
    for row in frame_rows(run):
        state_at(run, int(row))


def test_ticks_of_which_nothing_can_be_read_are_told(broken: Path) -> None:
    whole = (broken / "ticks.mcap").read_bytes()
    (broken / "ticks.mcap").write_bytes(whole[:1000])
    _refused([broken], "holds no whole block of ticks")
    (broken / "ticks.mcap").write_bytes(bytes(1000))
    _refused([broken], "not a ticks file")


def test_another_robots_run_is_refused(folder: Path, broken: Path) -> None:
    result = broken / "result.json"
    result.write_text(result.read_text().replace('"walker"', '"runner"'))
    _refused([folder / "inline", broken], "a run of runner")


def test_other_mistakes_are_told(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = folder / "inline"
    _refused([tmp_path / "nowhere"], "no such folder")
    _refused([run, run], "named twice")
    _refused([run] * 7, "at most 6")
    taken = tmp_path / "taken"
    taken.mkdir()
    (taken / "mine.txt").write_text("mine")
    # Before the runs are read: that takes minutes for long ones.
    monkeypatch.setattr("surefoot.report.page.load_runs", Mock(side_effect=KeyError))
    with pytest.raises(UsageError, match="other files than a report"):
        write_report([run], taken)
    assert [path.name for path in taken.iterdir()] == ["mine.txt"]


@pytest.mark.usual("--video")
@pytest.mark.parametrize("option", ["--video", "--animation"])
def test_without_opengl_nothing_is_written(
    folder: Path, tmp_path: Path, option: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disabled")
    out = tmp_path / "page"
    done = make_report(folder / "inline", option, "--out", out)
    assert done.returncode == 3
    assert "libegl1" in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def _curves(groups: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [c for group in groups for panel in group["panels"] for c in panel["curves"]]


def _refused(folders: list[Path], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        load_runs(folders)
