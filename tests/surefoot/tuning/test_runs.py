"""Figures that only a search asks for equal those of the benchmarks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import surefoot as sf
from surefoot.bench.bench_runs import Under
from surefoot.bench.sway_cells import Stimulus, sway_cell
from surefoot.bench.sway_results import sway_result
from surefoot.errors import UsageError
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.scenario import Scenario, scenario_from_table
from surefoot.schemas.toml_file import struct_table, toml_text
from surefoot.studies.cell import Group
from surefoot.studies.store import Task
from surefoot.tuning.objectives import (
    BEYOND,
    SCORE,
    SENSITIVITY,
    UNWALKED,
    TuneCell,
    _sensitivity,
    find_objectives,
    is_beaten,
    mean_figures,
    stimulus_of,
    succeeded,
)
from tests.surefoot.tuning.searches import HOLDS, spec_of, still

TILT = Stimulus("prts", "pitch", 4.0)
SWAY = sway_cell(TILT, Under("whole-body", "ideal"), height_m=0.8)


def changed(**keys: object) -> Scenario:
    table = struct_table(SWAY.scenario)
    table["platform"][0]["motion"][0].update(keys)
    return scenario_from_table(table, source="test")


def test_tilt_of_comtest_is_known_again_and_nothing_else_is() -> None:
    assert stimulus_of(SWAY.scenario) == TILT
    assert stimulus_of(changed(speed=2.0)) is None
    assert stimulus_of(changed(start_s=0.5)) is None
    assert stimulus_of(changed(cycles=4)) is None, "it does not come to its end"
    assert stimulus_of(sf.load_scenario("moving-platform-fast")) is None


def test_objectives_that_nothing_has_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="none of the scenarios is a tilt"):
        spec_of(still(tmp_path), "score", controller="whole-body")
    with pytest.raises(UsageError, match="none of the scenarios has a table"):
        spec_of(still(tmp_path), "dcm", controller="whole-body")
    with pytest.raises(UsageError, match="whole-body controller's loop"):
        spec_of(still(tmp_path), "margin")


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"params": {"tsid.comkp": (1, 2)}}, "did you mean 'tsid.com_kp'"),
        ({"params": {}}, "expected at least one"),
        ({"params": ["dik.com_gain", "dik.com_gain.x=1:4"]}, "searched twice"),
        ({"objectives": ["com", "fall"]}, "expected one of com"),
        ({"params": ["tsid.com_kp"], "controller": "zmp"}, "whole-body would"),
        ({"held_out_seeds": [0]}, "the search sees some of them"),
        ({"held_out_seeds": [1, 1]}, "--held-out-seeds: 1 is named twice"),
        ({"seeds": [0, 2, 0]}, "--seeds: 0 is named twice"),
        ({"objectives": []}, "--objectives: expected at least one"),
        ({"scheduler": "head"}, "expected the address of a Dask scheduler"),
        ({"sampler_seed": -1}, "--sampler-seed -1: expected 0 to 4294967295"),
        ({"trials": 0}, "got 0 trials and 0 workers, expected 1 or more"),
        (
            {"params": ["walk.preview_steps=1:1e9"]},
            "1e[+]09 whole numbers, expected at",
        ),
        ({"out": "."}, "holds something else"),
    ],
)
def test_what_cannot_be_searched_is_refused_before_anything_runs(
    tmp_path: Path, more: dict[str, Any], words: str
) -> None:
    asked = {"params": ["dik.com_gain"], "out": "out", "controller": HOLDS, **more}
    out = tmp_path / asked.pop("out")
    with pytest.raises((UsageError, FileFormatError), match=words):
        sf.tune(still(tmp_path), out=out, **asked)
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == [
        "still.toml"
    ]


def test_margin_is_that_of_the_command_and_worse_for_a_fast_loop(
    tmp_path: Path,
) -> None:
    robot = load_robot("walker")
    margins = sf.compute_margins(robot)
    profile = robot.file.servo.profile
    spec = spec_of(still(tmp_path), "margin", controller="whole-body")
    (cell,) = spec.cells(spec.scenarios, [0])
    row = spec.task(cell, dict(spec.start)).run()
    assert row[SENSITIVITY] == pytest.approx(2.0 / margins.disk)
    fast = sf.ControllerSettings(dik=type(spec.settings.dik)(k_force=(-25.0,) * 6))
    assert _sensitivity(str(robot.path), profile, fast) > row[SENSITIVITY]


def test_walk_that_is_refused_is_no_better_than_a_fall(tmp_path: Path) -> None:
    path = tmp_path / "walk.toml"
    path.write_text(
        'name = "walk"\nduration_s = 0.05\n[walk]\nstart_s = 0.01\n'
        '[[walk.step]]\nside = "left"\nposition_m = [0.2, 0.1]\n'
    )
    spec = spec_of(path, "dcm", controller="whole-body")
    (cell,) = spec.cells(spec.scenarios, [0])
    row = Task(cell, "walker", ("walk.longest_m=0.05",)).run()
    assert row["outcome"] == "stood"
    assert "at most 0.05 m" in row[UNWALKED]
    assert not succeeded(row)


def test_mean_is_over_the_runs_that_have_the_figure() -> None:
    objectives = find_objectives(["score", "tilt"])
    rows = [{SCORE: 2.0, "base_tilt_max_deg": 1.0}, {"base_tilt_max_deg": 3.0}]
    assert mean_figures(rows, objectives) == [2.0, 2.0]
    assert mean_figures(rows[1:], objectives) == [BEYOND, 3.0]
    better = [{SCORE: 1.0, "base_tilt_max_deg": 0.5}, {"base_tilt_max_deg": 2.0}]
    assert is_beaten(rows, better, objectives)
    assert not is_beaten(better, rows, objectives)
    assert not is_beaten(rows[1:], [{"base_tilt_max_deg": 4.0}], objectives)


@pytest.mark.slow
def test_score_is_that_of_the_benchmark(tmp_path: Path) -> None:
    path = tmp_path / "people.toml"
    path.write_text(toml_text(struct_table(SWAY.scenario)))
    cell = TuneCell(Group(str(path), (), "whole-body", "ideal"), 0, (SCORE,))
    row = Task(cell, "walker").run()
    benchmark = Task(SWAY, "walker").run()
    assert row["log_sha256"] == benchmark["log_sha256"]
    assert row[SCORE] == sway_result(SWAY, benchmark).score
