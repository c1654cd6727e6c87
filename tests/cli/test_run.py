"""Whole runs through the command line, with robot and stabilizer."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

from surefoot.run_folder import MARKER
from surefoot.schemas.result import RunResult
from surefoot.schemas.scenario import load_scenario
from surefoot.signals import read_signals
from tests.command import Surefoot
from tests.once import short_run

TICKS = 300
FILES = {
    MARKER,
    "result.json",
    "settings.toml",
    "scenario.toml",
    "ticks.mcap",
    "controller-ticks.mcap",
}
LOGS = {"robot.log", "stabilizer.log", "recorder.log"}
BY_RECORDER = {"run.mcap"}


@pytest.fixture(scope="module", params=["inline", "lockstep", "realtime"])
def run(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Return the folder of a run in each mode, which tests must not change."""
    return short_run(tmp_path_factory, request.param)


def test_json_is_one_whole_result_and_nothing_else(run: Path) -> None:
    told = (run.parent / "told.json").read_text()
    assert told.count("\n") == 1
    result = msgspec.json.decode(told, type=RunResult)
    assert set(json.loads(told)) == set(RunResult.__struct_fields__)
    assert json.loads((run / "result.json").read_text()) == json.loads(told)
    assert (result.scenario, result.controller, result.robot) == (
        *("short", "hold", "walker"),
    )
    assert not result.fell
    assert result.out == str(run)
    assert result.duration_s == pytest.approx(TICKS * 1e-3, abs=0.05)


def test_out_keeps_the_whole_run(run: Path) -> None:
    about = json.loads((run / MARKER).read_text())
    assert (about["seed"], about["controller"]) == (5, "hold")
    logs = set() if about["mode"] == "inline" else LOGS | BY_RECORDER
    assert {path.name for path in run.iterdir()} == FILES | logs
    assert (
        msgspec.json.decode((run / "result.json").read_bytes())["mode"] == about["mode"]
    )
    scenario = (run.parent / "short.toml").read_text()
    assert (run / "scenario.toml").read_text() == scenario
    assert "leave_s = 0.06" in (run / "settings.toml").read_text()
    signals = read_signals(run)
    assert signals["q_command"].shape == (TICKS, 28)
    assert signals.time_s[-1] == pytest.approx((TICKS - 1) * 1e-3)
    assert not signals.is_cut_off


@pytest.mark.parametrize(
    ("name", "priority"), [("robot", 20), ("stabilizer", 20), ("recorder", 19)]
)
def test_a_run_hands_its_priority_to_both_sides_and_the_next_to_its_recorder(
    tmp_path_factory: pytest.TempPathFactory, name: str, priority: int
) -> None:
    log = (short_run(tmp_path_factory, "realtime") / f"{name}.log").read_text()
    assert (
        f"SCHED_FIFO at priority {priority}" in log
        or f"--realtime-priority {priority}: not done" in log
    )


def test_a_run_can_be_done_again_from_its_folder(
    tmp_path_factory: pytest.TempPathFactory, surefoot_here: Surefoot
) -> None:
    out = short_run(tmp_path_factory)
    words = ["--inline", "--seed", 5, "--settings", out / "settings.toml", "--json"]
    words += ["--controller", "hold"]
    again = json.loads(surefoot_here("run", out / "scenario.toml", *words).stdout)
    before = json.loads((out / "result.json").read_text())
    assert again["log_sha256"] == before["log_sha256"]


def test_the_summary_is_for_people(surefoot: Surefoot, short_scenario: Path) -> None:
    done = surefoot("run", short_scenario, "--controller", "hold", "--inline")
    assert done.returncode == 0, done.stderr
    for words in ("short, hold, walker, seed 0, inline", "stood 0.3 s", "CoM error"):
        assert words in done.stdout
    # No progress bar, no colours when it is not a terminal.
    assert done.stderr == ""
    assert "\x1b" not in done.stdout


def test_duration_and_pushes_are_the_command_lines(
    surefoot_here: Surefoot, short_scenario: Path, tmp_path: Path
) -> None:
    """What was run is kept; the scenario's own file stays as it is."""
    before, out = short_scenario.read_text(), tmp_path / "out"
    done = surefoot_here(
        *("run", short_scenario, "--inline", "--controller", "hold", "--json"),
        *("--duration", 0.2, "--push", "10,90,0.05", "--push", "4,0,0.1", "--out", out),
    )
    result = json.loads(done.stdout)
    assert result["duration_s"] == pytest.approx(0.2)
    assert short_scenario.read_text() == before
    kept = load_scenario(out / "scenario.toml")
    assert [push.start_s for push in kept.push] == [0.05, 0.1]
    impulses = [np.multiply(push.force_n, push.duration_s) for push in kept.push]
    assert np.allclose(impulses, [(0.0, 10.0, 0.0), (4.0, 0.0, 0.0)])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--push", "10,90"), "expected impulse, direction and time"),
        (("--push", "0,90,0.1"), "expected impulse, direction and time"),
        (("--push", "nan,90,0.1"), "expected impulse, direction and time"),
        (("--push", "10,90,0.3"), "the run ends at 0.3 s"),
        (("--duration", 0), "expected a number > 0.0"),
        (("--video",), "needs --out"),
    ],
)
def test_what_cannot_be_run_is_refused_before_it_begins(
    surefoot_here: Surefoot, short_scenario: Path, words: tuple[object, ...], said: str
) -> None:
    done = surefoot_here("run", short_scenario, "--inline", *words)
    assert done.returncode == 2
    assert said in done.stderr
