"""Whole runs through the command line, with robot and stabilizer."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from surefoot.run_folder import MARKER
from surefoot.schemas.result import RunResult
from surefoot.schemas.scenario import load_scenario
from surefoot.signals import read_signals
from tests.command import Surefoot

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


def run_hold(surefoot: Surefoot, scenario: Path, *extra: object) -> dict[str, Any]:
    """Return the JSON of a run with the holding controller, which must stand."""
    done = surefoot("run", scenario, "--controller", "hold", "--json", *extra)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.usual("inline", "realtime")
@pytest.mark.parametrize("mode", ["inline", "lockstep", "realtime"])
def test_json_is_one_whole_result_and_nothing_else(
    surefoot: Surefoot, short_scenario: Path, patient_walker: Path, mode: str
) -> None:
    done = surefoot(
        *("run", short_scenario, "--robot", patient_walker),
        *("--controller", "hold", "--json", f"--{mode}"),
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") == 1
    result = msgspec.json.decode(done.stdout, type=RunResult)
    assert set(json.loads(done.stdout)) == set(RunResult.__struct_fields__)
    assert result.mode == mode
    assert result.scenario == "short"
    assert result.controller == "hold"
    assert result.robot == "walker"
    assert not result.fell
    assert result.out is None
    assert result.duration_s == pytest.approx(TICKS * 1e-3, abs=0.05)


@pytest.mark.parametrize("mode", ["inline", "lockstep"])
def test_out_keeps_the_whole_run(
    surefoot: Surefoot, short_scenario: Path, tmp_path: Path, mode: str
) -> None:
    out = tmp_path / "run"
    words = [f"--{mode}", "--seed", 5, "--set", "safety.leave_s=0.06", "--out", out]
    result = run_hold(surefoot, short_scenario, *words)
    logs = set() if mode == "inline" else LOGS | BY_RECORDER
    assert {path.name for path in out.iterdir()} == FILES | logs
    assert json.loads((out / "result.json").read_text()) == result
    assert result["out"] == str(out)
    assert (out / "scenario.toml").read_text() == short_scenario.read_text()
    assert "leave_s = 0.06" in (out / "settings.toml").read_text()
    about = json.loads((out / MARKER).read_text())
    assert (about["seed"], about["mode"], about["controller"]) == (5, mode, "hold")
    signals = read_signals(out)
    assert signals["q_command"].shape == (TICKS, 28)
    assert signals.time_s[-1] == pytest.approx((TICKS - 1) * 1e-3)
    assert not signals.is_cut_off


def test_a_run_can_be_done_again_from_its_folder(
    surefoot: Surefoot, short_scenario: Path, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    first = run_hold(surefoot, short_scenario, "--inline", "--seed", 5, "--out", out)
    words = ["--inline", "--seed", 5, "--settings", out / "settings.toml"]
    again = run_hold(surefoot, out / "scenario.toml", *words)
    assert again["log_sha256"] == first["log_sha256"]


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
