"""COMTEST on bodies with a known sway, and on the robot."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from surefoot.bench import comtest
from surefoot.bench.bench_runs import Under
from surefoot.bench.sway_cells import (
    START_S,
    Stimulus,
    SwayAxis,
    SwayProbe,
    sway_cell,
)
from surefoot.bench.sway_response import human_sway
from surefoot.bench.sway_results import beside_people, sway_result, sway_since
from surefoot.errors import UsageError
from surefoot.sim_robot.motion import motion_law
from surefoot.sim_robot.state_view import PlantTruth, PlatformPose
from surefoot.simulation import Simulation
from surefoot.stabilizer.factory import make_controller
from tests.command import Surefoot

HEIGHT_M = 0.8
ME = Under("hold", "ideal")
SPEED = 10.0
"""Speed of the ternary sequence, at which a cycle takes two seconds [1]."""
PERSON_DEG = 2.0
"""So small that three times this lean stays well inside the soles."""


def truth(*, lean: float, axis: SwayAxis, ground: float) -> PlantTruth:
    """Return the truth of a stick on a platform that carries its feet along."""
    turn = np.array([0.0, 0.0, 0.0])
    feet = np.array([0.3, 0.1, 0.0])
    if axis in ("x", "y"):
        feet["xy".index(axis)] += ground
    else:
        turn[("roll", "pitch").index(axis)] = ground
    over = {
        "pitch": (math.sin(lean), 0.0, math.cos(lean)),
        "x": (math.sin(lean), 0.0, math.cos(lean)),
        "roll": (0.0, -math.sin(lean), math.cos(lean)),
        "y": (0.0, math.sin(lean), math.cos(lean)),
    }[axis]
    zero3, zero6, aside = np.zeros(3), np.zeros(6), np.array([0.0, 0.1, 0.0])
    return PlantTruth(
        tick=0,
        base_position=zero3,
        base_quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
        upright=1.0,
        com=feet + HEIGHT_M * np.array(over),
        com_velocity=zero3,
        sole_left=feet + aside,
        sole_right=feet - aside,
        F_left=zero6,
        F_right=zero6,
        vertical_forces=(0.0, 0.0),
        platforms=(PlatformPose(feet, Rotation.from_rotvec(turn).as_quat()),),
    )


def response_of(axis: SwayAxis, share: float) -> np.ndarray:
    """Return the response of a stick whose lean is a share of the ground's angle."""
    stimulus = Stimulus("prts", axis, 8.0, speed=SPEED)
    cell = sway_cell(stimulus, ME, height_m=HEIGHT_M)
    law = motion_law(cell.scenario.platform[0].motion[0])
    probe = SwayProbe(stimulus, HEIGHT_M)
    per_m = HEIGHT_M if axis in ("x", "y") else 1.0
    for time_s in np.arange(0.0, cell.scenario.duration_s + 0.005, 0.01):
        ground, _ = law(time_s)
        there = truth(lean=share * ground / per_m, axis=axis, ground=ground)
        probe.take(float(time_s), there)
    row = {"seen": probe.figures(), "outcome": "stood"}
    response = sway_result(cell, row).response
    assert response is not None
    return response.response


@pytest.mark.parametrize("axis", ["pitch", "roll", "x", "y"])
@pytest.mark.parametrize("share", [1.0, -0.3])
def test_a_lean_that_is_a_share_of_the_ground_has_it_as_response(
    axis: SwayAxis, share: float
) -> None:
    assert np.abs(response_of(axis, share) - share).max() < 1e-6


def test_a_person_on_sines_is_drawn_on_people() -> None:
    human = human_sway()
    whole_turns = (human.phase_deg + 180.0) % 360.0 - 180.0
    drawn = beside_people(human.frequencies_hz.tolist(), whole_turns.tolist())
    assert drawn == pytest.approx(human.phase_deg)


def test_a_step_is_drawn_from_where_the_robot_was_when_it_began() -> None:
    stimulus, share, lean_deg = Stimulus("transient", "pitch", 2.0), 0.5, -0.7
    cell = sway_cell(stimulus, ME, height_m=HEIGHT_M)
    law = motion_law(cell.scenario.platform[0].motion[0])
    probe = SwayProbe(stimulus, HEIGHT_M)
    for time_s in np.arange(0.0, cell.scenario.duration_s + 0.005, 0.01):
        ground, _ = law(time_s)
        lean = share * ground + math.radians(lean_deg)
        probe.take(float(time_s), truth(lean=lean, axis="pitch", ground=ground))
    result = sway_result(cell, {"seen": probe.figures(), "outcome": "stood"})
    time_s, sway_deg = sway_since(result)
    assert time_s[0] == 0.0
    assert sway_deg[0] == pytest.approx(0.0, abs=1e-3)
    assert sway_deg[-1] == pytest.approx(share * stimulus.size_deg, abs=1e-3)
    peak_deg = result.seen["sway_peak"] * stimulus.size_deg
    assert sway_deg.max() == pytest.approx(peak_deg, abs=1e-3)


def test_a_translation_is_as_large_as_the_tilt_it_is_named_by() -> None:
    cell = sway_cell(Stimulus("transient", "y", 8.0), ME, height_m=HEIGHT_M)
    law = motion_law(cell.scenario.platform[0].motion[0])
    assert law(START_S)[0] == 0.0
    assert law(cell.scenario.duration_s)[0] == pytest.approx(
        HEIGHT_M * math.radians(8.0)
    )


def test_a_fast_sine_is_measured_as_fast_as_it_is() -> None:
    fast = Stimulus("sinus", "pitch", 0.5, frequency_hz=60.0)
    cell = sway_cell(fast, ME, height_m=HEIGHT_M)
    plan = cell.plan(robot="walker", overrides=())
    sim, probe = Simulation.of_plan(plan), cell.probe()
    rows = []

    def look(_: object) -> None:
        probe.look(sim)
        com = sim.truth.com - 0.5 * (sim.truth.sole_left + sim.truth.sole_right)
        tilt = 2.0 * math.asin(sim.truth.platforms[0].quat_xyzw[1])
        rows.append((sim.time_s, tilt, math.atan2(com[0], com[2])))

    sim.run(make_controller(plan.controller, plan.robot, plan.settings), on_tick=look)
    time_s, tilt, lean = np.array(rows).T
    counts = time_s > START_S + 2.0 / fast.frequency_hz - 1e-9
    turn = math.tau * fast.frequency_hz * time_s[counts]
    columns = [np.cos(turn), np.sin(turn), np.ones_like(turn), turn]
    fits = [
        np.linalg.lstsq(np.column_stack(columns), values[counts], rcond=None)[0]
        for values in (tilt, lean)
    ]
    own = math.hypot(*fits[1][:2]) / math.hypot(*fits[0][:2])
    assert probe.figures()["gain"] == pytest.approx(own, rel=0.05)


@pytest.mark.parametrize(
    "wrong",
    [
        {"axes": ["yaw"]},
        {"axes": ["pitch", "pitch"]},
        {"protocols": ["jump"]},
        {"cycles": 2},
        {"cycles": 1_000_000},
        {"speed": 13.0},
        {"sizes_deg": [4.0, 2.0]},
        {"sizes_deg": [2.0, 2.0]},
        {"sizes_deg": [99.0]},
        {"sizes_deg": [-1.0]},
        {"sizes_deg": [math.inf]},
        {"sizes_deg": [math.nan]},
        {"protocols": ["sinus"], "speed": 5.0},
        {"protocols": ["transient"], "cycles": 5},
        {"protocols": ["prts"], "frequencies_hz": [1.0]},
    ],
)
def test_what_cannot_be_measured_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(
        UsageError, match=r"^--\w+: (got|.* twice)|^--speed 13: |^frequencies_hz: got"
    ):
        comtest(**wrong)  # type: ignore[arg-type]


@pytest.mark.closed_loop
def test_a_stiff_robot_goes_with_the_ground_and_files_say_so(
    tmp_path: Path, surefoot_here: Surefoot
) -> None:
    """Its servos hold the posture; its weight makes it lean somewhat further."""
    out = tmp_path / "comtest"
    arguments = ["--controllers", "hold", "--servo-profile", "ideal", "--json"]
    done = surefoot_here(
        *("bench", "comtest", *arguments, "--protocols", "prts", "--axes", "pitch"),
        *("--sizes", "0.5", "--speed", f"{SPEED:g}", "--jobs", "1", "--out", str(out)),
    )
    assert done.returncode == 0, done.stderr
    (result,) = json.loads(done.stdout)["results"]
    response = result["frequency_response"]
    assert 1.0 < response["gain"][0] < 1.2
    assert response["coherence"][0] > 0.95
    assert result["below_human_5_percent"] < 11
    (gain,) = out.glob("eurobench/hold_ideal/*/gain.yaml")
    assert yaml.safe_load(gain.read_text())["value"] == response["gain"]
    page = (out / "index.html").read_text()
    addresses = re.findall(r'(?:src|href)\s*=\s*"([^"]*)"', page)
    assert addresses
    assert all(address.startswith("data:") for address in addresses)
    assert "hold" in page
    assert f"{human_sway().score_percentiles[50]:.2f}" in page


@pytest.mark.slow
@pytest.mark.closed_loop
@pytest.mark.parametrize("servo_profile", ["ideal", "harmonic"])
def test_settings_of_a_person_are_nearer_to_people_than_half_of_them(
    servo_profile: str,
) -> None:
    found = comtest(
        controllers=["person"],
        servo_profiles=[servo_profile],
        protocols=["prts"],
        axes=["pitch"],
        sizes_deg=[PERSON_DEG],
        jobs=1,
    )
    (result,) = found.results
    assert result.is_up
    assert result.score is not None
    assert result.score < human_sway().score_percentiles[50]
