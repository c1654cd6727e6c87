from __future__ import annotations

import math

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.schemas.robot_file import ServoProfile
from surefoot.sim_robot.plant import Servos
from tests.sim_robot.conftest import MakePlant

STEP_S = 0.001
IDEAL = ServoProfile(velocity_limit_rad_s=1e6, lag_s=0.0)


def run(servos: Servos, command: np.ndarray, *, steps: int) -> np.ndarray:
    for _ in range(steps):
        servos.step(command)
    return servos.setpoint.copy()


def test_ideal_servo_follows_at_once() -> None:
    servos = Servos(IDEAL, posture=np.zeros(2), step_s=STEP_S)
    command = np.array([0.3, -0.2])
    np.testing.assert_array_equal(servos.step(command), command)


def test_setpoint_moves_no_faster_than_the_limit() -> None:
    profile = ServoProfile(velocity_limit_rad_s=3.0, lag_s=0.0)
    servos = Servos(profile, posture=np.zeros(2), step_s=STEP_S)
    command = np.array([1.0, -0.01])
    np.testing.assert_allclose(run(servos, command, steps=100), [0.3, -0.01])
    np.testing.assert_allclose(run(servos, command, steps=400), command)


def test_lag_is_exact_at_the_time_constant() -> None:
    profile = ServoProfile(velocity_limit_rad_s=1e6, lag_s=0.02)
    servos = Servos(profile, posture=np.zeros(1), step_s=STEP_S)
    reached = run(servos, np.ones(1), steps=20)
    assert reached[0] == pytest.approx(1.0 - math.exp(-1.0), rel=1e-12)


def test_lag_stands_behind_the_limit() -> None:
    rate, lag_s = 2.0, 0.02
    profile = ServoProfile(velocity_limit_rad_s=rate, lag_s=lag_s)
    servos = Servos(profile, posture=np.zeros(1), step_s=STEP_S)
    steps = 300
    reached = run(servos, np.full(1, 10.0), steps=steps)
    # A lag follows a ramp by rate x lag; sampled, half a step more or less.
    behind = rate * steps * STEP_S - reached[0]
    assert behind == pytest.approx(rate * lag_s, abs=rate * STEP_S)


def test_setpoint_does_not_write_into_posture_or_command() -> None:
    posture, command = np.zeros(1), np.ones(1)
    Servos(IDEAL, posture=posture, step_s=STEP_S).step(command)
    assert posture[0] == 0.0
    assert command[0] == 1.0


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_torque_is_the_pd_law_on_the_setpoint(
    make_plant: MakePlant, walker: Robot, scale: float
) -> None:
    plant = make_plant(model_error={"servo_kp_scale": scale})
    command = walker.nominal + 0.003
    before = plant.sense()
    plant.step(command)
    expected = scale * walker.kp * (command - before.q) - walker.kd * before.dq
    np.testing.assert_allclose(plant.sense().effort, expected, atol=1e-9)


def test_torque_stops_at_the_limit(make_plant: MakePlant, walker: Robot) -> None:
    plant = make_plant()
    for _ in range(60):
        plant.step(walker.nominal + 0.5)
    assert np.all(np.abs(plant.sense().effort) <= walker.torque_limit)
    assert np.any(np.abs(plant.sense().effort) == walker.torque_limit)


def test_servos_are_evaluated_every_simulation_step(
    make_plant: MakePlant,
) -> None:
    harmonic = load_robot("walker", servo_profile="harmonic")
    plant = make_plant(robot=harmonic)
    command = harmonic.nominal.copy()
    command[0] += 0.1
    for _ in range(20):
        plant.step(command)
    way = plant.data.ctrl[0] - harmonic.nominal[0]
    assert 0.0 < way < 20 * STEP_S * harmonic.servo_profile.velocity_limit_rad_s
