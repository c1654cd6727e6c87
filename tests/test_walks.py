"""The study of walks: the drawn walks, and the table."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest

from benchmarks import walks
from benchmarks.lines import run_all, study_options
from benchmarks.walks import LINES, WalkRun, table
from surefoot import simulate
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.scenario import Scenario, Tile
from surefoot.sim_robot.plant import Plant


@pytest.mark.parametrize("line", LINES)
def test_a_run_is_drawn_with_its_number(line: str) -> None:
    scenario = LINES[line]
    first, again = scenario(1), scenario(1)
    assert msgspec.json.encode(first) == msgspec.json.encode(again)
    Plant(load_robot("walker"), first, seed=1)
    varies = msgspec.json.encode(first) != msgspec.json.encode(scenario(2))
    is_shipped = scenario.__qualname__.startswith("shipped")
    assert varies is not (is_shipped or line == "stop and go")


def test_borders_run_under_the_footholds() -> None:
    tiles = walks.borders(0).tile
    left = sorted(tile.center_m[0] for tile in tiles if tile.center_m[1] > 0.0)
    shipped = walks.load_scenario("walk-tiles").tile
    middles = sorted(t.center_m[0] for t in shipped if t.center_m[1] > 0.0)
    edges = [x - 0.5 * tiles[0].size_m[0] for x in left]
    assert edges == pytest.approx(middles)


@pytest.mark.closed_loop
def test_the_study_keeps_the_row_of_each_run(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    line, scenario = next(iter(LINES.items()))

    def short(number: int) -> Scenario:
        return msgspec.structs.replace(scenario(number), duration_s=2.5)

    monkeypatch.setitem(LINES, line, short)
    run = WalkRun(line, 3, "whole-body", "ideal")
    words = ["--out", str(tmp_path), "--jobs", "1", "--set", "tsid.com_kp=30"]
    options = study_options(None, count=1).parse_args(words)
    [row] = run_all([run], options, title="walks")
    assert (row["line"], row["seed"]) == (line, 3)
    assert run_all([run], options, title="walks") == [row]
    assert replace(run, number=4).key != run.key


def test_the_table_counts_runs_that_were_walked(tmp_path: Path) -> None:
    common: dict[str, Any] = {
        "line": "flat",
        "variant": "whole-body",
        "servo_profile": "ideal",
        "placement_error_max_mm": 4.0,
        "touchdown_peak_n": [300.0, 512.0],
    }
    rows = [
        {**common, "outcome": "walked", "dcm_error_rms_mm": [1.0, 2.5]},
        {**common, "outcome": "walked", "dcm_error_rms_mm": [2.0, 1.5]},
        {**common, "outcome": "fell", "dcm_error_rms_mm": [90.0, 90.0]},
    ]
    told = table(rows)
    assert re.search(r"2 of 3 \(21 to 94 %\): 2\.0, 2\.5; 4; 512", told)
    figure = tmp_path / "walks.svg"
    walks.draw_shares(rows, str(figure))
    assert "<svg" in figure.read_text()


def test_no_tile_is_under_the_soles_at_first() -> None:
    for number in range(4):
        for tile in walks.tiles(35.0, 8.0)(number).tile:
            assert tile.center_m[0] - 0.5 * tile.size_m[0] >= walks.TOES_M - 1e-9


@pytest.mark.slow
@pytest.mark.closed_loop
@pytest.mark.parametrize("words", ["borders", "fast platform"])
def test_slow_drives_walk_where_a_sole_tips_and_ground_sinks(words: str) -> None:
    """None of these borders, and one of these platforms, were walked without."""
    [line] = [name for name in LINES if words in name]
    runs = [WalkRun(line, number, "whole-body", "harmonic") for number in range(4)]
    rows = [run.run(run.plan(robot="walker", overrides=())) for run in runs]
    assert sum(row["outcome"] in ("walked", "stood") for row in rows) >= 3


@pytest.mark.closed_loop
def test_a_foot_caught_at_an_edge_steps_over_it() -> None:
    """It pushed on: the robot came half as far, feet 0.5 m off, or fell."""
    [line] = [name for name in LINES if "kerb" in name]
    run = WalkRun(line, 2, "whole-body", "harmonic")
    row = run.run(run.plan(robot="walker", overrides=()))
    assert row["outcome"] in ("walked", "stood")
    assert row["placement_error_max_mm"] < 150.0
    assert max(row["dcm_error_rms_mm"]) < 25.0


@pytest.mark.closed_loop
def test_before_a_wall_the_walk_ends() -> None:
    """Feet climbed on and on, and the robot fell."""
    wall = Tile(center_m=[2.25, 0.0], size_m=[3.0, 1.6], height_m=0.3)
    scenario = msgspec.structs.replace(
        walks.load_scenario("walk-flat-slow"), tile=[wall], duration_s=8.0
    )
    result = simulate("walker", scenario, record=False).result
    assert result.outcome == "stood"
    assert "foot met what is in its way" in result.outcome_detail
    assert max(result.dcm_error_rms_mm or [math.inf]) < 15.0


@pytest.mark.slow
@pytest.mark.closed_loop
@pytest.mark.parametrize("words", ["borders", "seesaw"])
def test_a_sole_that_tips_about_an_edge_is_not_followed(words: str) -> None:
    """It was: 28 and 17 mm of the DCM's error, now 11 and 6."""
    [line] = [name for name in LINES if words in name]
    for number in range(2):
        run = WalkRun(line, number, "whole-body", "ideal")
        row = run.run(run.plan(robot="walker", overrides=()))
        assert row["outcome"] in ("walked", "stood")
        assert max(row["dcm_error_rms_mm"]) < 14.0
