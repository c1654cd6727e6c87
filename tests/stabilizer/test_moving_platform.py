"""The controller on a platform that heaves, rolls and pitches fast."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array
from surefoot.schemas.scenario import scenario_from_table
from surefoot.schemas.settings import ControllerSettings
from surefoot.simulation import Simulation
from surefoot.stabilizer.controller import HoldController
from surefoot.stabilizer.factory import make_controller
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from tests.stabilizer.closed_loop import NOISE, Run, run_closed_loop, swing
from tests.stabilizer.mirror import Mirror

pytestmark = pytest.mark.closed_loop

DURATION_S = 2.5
SHORT_S, AGAIN_S = 0.8, 0.5
COUNTED_FROM_S = 1.0
RMS_M, MAX_M = 10e-3, 25e-3
"""Bounds of the horizontal CoM error on the fast platform."""
TRAVEL_M = 0.05
SYMMETRY_RAD = 1e-8
"""Rounding, grown by integration over the run."""
START_S = 0.4
MOTION = [
    swing("z", 0.06, 0.96, start_s=START_S),
    swing("roll", 8.6, 0.7, start_s=START_S),
    swing("pitch", 8.6, 0.508, start_s=START_S),
]
PLATFORM = [{"foot": "both", "motion": MOTION}]


@pytest.fixture(scope="module")
def run(walker: Robot) -> Run:
    return run_closed_loop(walker, duration_s=DURATION_S, platform=PLATFORM)


@pytest.fixture(scope="module", params=["whole-body", "zmp"])
def law(request: pytest.FixtureRequest) -> str:
    return request.param


def moved(walker: Robot, law: str, *, seed: int, duration_s: float) -> Run:
    return run_closed_loop(
        walker,
        seed=seed,
        controller=make_controller(law, walker, ControllerSettings()),
        duration_s=duration_s,
        platform=PLATFORM,
    )


@pytest.fixture(scope="module")
def short_run(walker: Robot, law: str) -> Run:
    return moved(walker, law, seed=5, duration_s=SHORT_S)


def test_robot_stays_up_while_the_ground_moves(run: Run) -> None:
    assert not run.fell
    assert run.statuses == {"ok"}
    assert np.ptp(run.soles_true[:, :, 2]) > TRAVEL_M


def test_centre_of_mass_stays_over_the_feet(run: Run) -> None:
    over = (run.com_true - run.soles_true.mean(axis=1))[:, :2]
    error = (over - over[0])[run.time_s >= COUNTED_FROM_S]
    assert np.sqrt(np.mean(error**2, axis=0)).max() < RMS_M
    assert np.abs(error).max() < MAX_M


def test_same_seed_gives_the_same_commands_and_other_noise_others(
    walker: Robot, law: str, short_run: Run
) -> None:
    again, other = (
        moved(walker, law, seed=seed, duration_s=AGAIN_S) for seed in (5, 6)
    )
    before = short_run.commands[: len(again.commands)]
    np.testing.assert_array_equal(before, again.commands)
    assert not np.array_equal(before, other.commands)


def test_mirrored_sensors_give_mirrored_commands(
    walker: Robot, model: RobotModel, law: str, short_run: Run
) -> None:
    """The robot is symmetric, so nothing may tell left from right."""
    mirror = Mirror(model)
    controller = make_controller(law, walker, ControllerSettings())
    controller.start(mirror.snapshot(short_run.snapshots[0]), walker.nominal)
    commands: list[Array] = []
    for snapshot in short_run.snapshots:
        commands.append(controller.step(mirror.snapshot(snapshot)).q_command.copy())
    expected = np.array([mirror.joints(command) for command in short_run.commands])
    assert np.abs(expected - short_run.commands).max() > 1e3 * SYMMETRY_RAD
    np.testing.assert_allclose(commands, expected, rtol=0.0, atol=SYMMETRY_RAD)


def test_a_start_on_ground_that_moves_already(walker: Robot) -> None:
    """What the sensors feel while they are calibrated is the ground, not a bias."""
    motion = [{**one, "start_s": 0.0, "phase_deg": 60.0} for one in MOTION]
    platform = [{"foot": "both", "motion": motion}]
    run = run_closed_loop(walker, duration_s=DURATION_S, platform=platform)
    assert not run.fell
    over = (run.com_true - run.soles_true.mean(axis=1))[:, :2]
    assert np.abs(over - over[0]).max() < 2.0 * MAX_M


def test_a_restart_after_the_ground_turned_under_a_held_robot(walker: Robot) -> None:
    """It leans with its ground, most of its weight on one foot: no foot may lift."""
    turn = {"kind": "ramp", "start_s": START_S, "rate_deg_s": 12.0}
    motion = [
        {"axis": "roll", "amplitude_deg": 8.0, **turn},
        {"axis": "pitch", "amplitude_deg": -3.0, **turn},
    ]
    table = {
        "name": "restart",
        "duration_s": 3.2,
        "sensors": NOISE,
        "platform": [{"foot": "both", "motion": motion}],
    }
    sim = Simulation(walker, scenario_from_table(table, source="test"))
    over = []
    parts = {
        START_S: WholeBodyController(walker, ControllerSettings()),
        0.9: HoldController(walker.n_a),
        3.2: WholeBodyController(walker, ControllerSettings()),
    }
    for until_s, controller in parts.items():
        while not sim.finished and sim.time_s < until_s:
            sim.step(controller)
            truth = sim.truth
            over.append(truth.com - 0.5 * (truth.sole_left + truth.sole_right))
    assert not sim.fell
    error = np.abs(np.array(over) - over[0])[:, :2]
    assert error.max() > 0.05
    assert error[-300:].max() < MAX_M
