"""The robot walks without falling, follows its DCM, and knows its distance."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.runs import simulate
from surefoot.schemas.arrays import Array
from surefoot.schemas.reasons import Outcome
from surefoot.schemas.result import RunResult
from surefoot.schemas.scenario import scenario_from_table
from surefoot.schemas.settings import ControllerSettings
from surefoot.sim_robot.catalogue import load_scenario
from surefoot.simulation import Simulation
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from tests.stabilizer.closed_loop import NOISE
from tests.support import with_knees, with_late_commands, with_rate, with_speeds

pytestmark = pytest.mark.closed_loop
DCM_RMS_MM, PLACEMENT_MM, ODOMETRY_M = 10.0, 10.0, 0.01
QUICK = {"step_s": 0.5, "double_s": 0.15, "start_s": 0.5}


def walk(
    robot: Robot, duration_s: float, **walk: Any
) -> tuple[RunResult, WholeBodyController, Array]:
    """Return result, controller, and the soles at the end relative to the start."""
    scenario = scenario_from_table(
        {
            "name": "walk",
            "duration_s": duration_s,
            "sensors": NOISE,
            "walk": walk,
        },
        source="test",
    )
    sim = Simulation(robot, scenario)
    begin = soles(sim)
    controller = WholeBodyController(robot, ControllerSettings())
    sim.run(controller)
    return sim.result(), controller, soles(sim) - begin.mean(axis=0)


def soles(sim: Simulation) -> Array:
    """Return (2, 2) true x and y of left and right sole [m]."""
    return np.array((sim.truth.sole_left[:2], sim.truth.sole_right[:2]))


def test_knees_that_just_carry_the_robot_climb_a_stair(walker: Robot) -> None:
    """Bent to keep the lower stair in reach, one of them would give way."""
    scenario = msgspec.structs.replace(load_scenario("walk-stairs"), duration_s=6.0)
    result = simulate(with_knees(walker, 0.44), scenario, record=False).result
    assert not result.fell, result.outcome_detail
    assert result.steps_done >= 1


def test_knows_its_height_on_tiles_of_any_height(walker: Robot) -> None:
    """Taken for the motion of level ground, they spoilt the height by 22 mm."""
    sim = Simulation(walker, load_scenario("walk-tiles"))
    controller = WholeBodyController(walker, ControllerSettings())
    error = 0.0
    while not sim.finished and sim.time_s < 11.0:
        sim.step(controller)
        height = controller.dynamics.p_com.item(2)
        error = max(error, abs(height - sim.truth.com.item(2)))
    assert not sim.result().fell
    assert error < 0.015


def test_a_slow_loop_shifts_the_weight_in_time(walker: Robot) -> None:
    """The stiff K that it needs lags: the DCM was off by 14 mm."""
    slow = with_late_commands(with_rate(walker, 200.0))
    result, _, _ = walk(slow, 7.0, velocity_m_s=0.25, start_s=0.5)
    assert result.outcome is Outcome.WALKED, result.outcome_detail
    assert max(result.dcm_error_max_mm or [np.inf]) < 10.0


def test_walks_ahead_and_stands(walker: Robot) -> None:
    result, controller, feet = walk(walker, 4.6, velocity_m_s=0.4, **QUICK)
    assert result.outcome is Outcome.WALKED, result.outcome_detail
    assert result.steps_done == result.steps_planned == 1
    assert max(result.dcm_error_rms_mm or [np.inf]) < DCM_RMS_MM
    assert (result.placement_error_max_mm or np.inf) < PLACEMENT_MM
    assert result.distance_m == pytest.approx(0.26, abs=0.01)
    odometry = np.mean(controller.observer.anchors.p, axis=0)
    np.testing.assert_allclose(odometry[:2], feet.mean(axis=0), atol=ODOMETRY_M)
    assert result.qp_failures == 0


def test_written_steps_are_set_where_they_are_written(walker: Robot) -> None:
    step = {"side": "right", "position_m": [0.0, -0.16], "yaw_deg": -15.0}
    result, _, feet = walk(walker, 4.3, step=[step], **QUICK)
    assert result.outcome is Outcome.WALKED, result.outcome_detail
    np.testing.assert_allclose(feet[1], [0.0, -0.16], atol=0.01)
    # The other foot came beside it.
    apart = np.linalg.norm(feet[0] - feet[1])
    assert apart == pytest.approx(0.22, abs=0.01)


def test_standing_is_a_walk_without_steps(walker: Robot) -> None:
    """Bit for bit: not even the rounding of the walk's own numbers shows."""
    hashes = []
    for table in ({}, {"walk": {"start_s": 0.3}}):
        scenario = scenario_from_table(
            {"name": "stand", "duration_s": 0.6, "sensors": NOISE, **table},
            source="test",
        )
        sim = Simulation(walker, scenario)
        sim.run(WholeBodyController(walker, ControllerSettings()))
        hashes.append(sim.result().log_sha256)
    assert hashes[0] == hashes[1]


@pytest.mark.slow
def test_turns_with_a_slow_hip(walker: Robot) -> None:
    """It fell: the hip was behind, and the foot landed turned."""
    slow = with_speeds(walker, 0.32, only="hip_yaw")
    result, _, _ = walk(slow, 12.0, velocity_m_s=0.12, yaw_rate_deg_s=17.2)
    assert result.outcome is Outcome.WALKED, result.outcome_detail
    assert max(result.dcm_error_rms_mm or [np.inf]) < DCM_RMS_MM


SHIPPED = (
    *("walk-flat-slow", "walk-flat-quick", "walk-turn", "walk-sideways"),
    *("walk-platform-slow", "walk-platform-fast", "walk-push", "walk-tiles"),
    *("walk-stairs", "walk-soft", "walk-seesaw"),
)


@pytest.mark.slow
@pytest.mark.parametrize("profile", ["ideal", "harmonic"])
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_walks_are_walked_to_their_end(name: str, profile: str) -> None:
    import surefoot as sf

    run = sf.simulate("walker", name, servo_profile=profile, record=False)
    assert run.outcome is Outcome.WALKED, run.result.outcome_detail


HOPS = {
    "name": "early onto a tile",
    "duration_s": 3.8,
    "friction": 0.4,
    "sensors": {
        **NOISE,
        "force_torque_rate_hz": 250.0,
        "accel_bias_m_s2": [-0.2, -0.2, 0.1],
        "force_bias_n": {"left": [3.5, 9.7, 20.0], "right": [0.0, 0.0, 10.0]},
        "encoder_offset_rad": {
            "left_ankle_roll": 0.006,
            "right_ankle_pitch": -0.003,
            "left_knee": -0.006,
            "right_hip_roll": -0.007,
        },
    },
    "delay": {"sensor_ms": {"force_torque": 2.0, "imu": 2.0}},
    "payload": [{"link": "left_hand", "mass_kg": 3.0}],
    "walk": {
        "velocity_m_s": 0.1,
        "yaw_rate_deg_s": -7.4,
        "start_s": 1.0,
        "stop_s": 8.0,
        "step_s": 1.5,
    },
    "tile": [
        {
            "center_m": [0.29, 0.0],
            "size_m": [0.25, 2.2],
            "height_m": 0.029,
            "roll_deg": -2.5,
            "pitch_deg": 5.7,
        }
    ],
}


@pytest.mark.slow
def test_a_foot_that_lands_early_does_not_hop_on_old_forces() -> None:
    """It did, eleven times: each time down at 0.3 m/s, and up as fast."""
    run = simulate(
        load_robot("walker", servo_profile="harmonic"),
        scenario_from_table(HOPS, source="test"),
        seed=8,
    )
    relands = run.signals["foot_state"][:, 1] == 4
    assert np.count_nonzero(np.diff(relands.astype(int)) > 0) <= 6
    assert max(run.result.dcm_error_max_mm or [np.inf]) < 70.0


@pytest.mark.usual("3.45--1.0")
@pytest.mark.parametrize(("at_s", "direction"), [(3.45, -1.0), (2.55, 1.0)])
def test_pushed_over_the_standing_foot_it_crosses_its_feet(
    walker: Robot, at_s: float, direction: float
) -> None:
    """30 N s outward: while a foot swings, and just before it leaves the ground."""
    push = {
        "body": "torso",
        "force_n": [0.0, direction * 300.0, 0.0],
        "start_s": at_s,
        "duration_s": 0.1,
    }
    scenario = load_scenario("walk-push")
    table = msgspec.to_builtins(scenario) | {"push": [push], "duration_s": at_s + 3.5}
    run = simulate(walker, scenario_from_table(table, source="test"), seed=0)
    assert not run.result.fell, run.result.outcome_detail
    left, right = (run.signals[f"true_sole_{side}"] for side in ("left", "right"))
    assert np.min(left[:, 1] - right[:, 1]) < -0.1
