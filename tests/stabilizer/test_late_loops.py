"""Robots with low rates, old readings or slow drives stand without hopping."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgspec
import pytest

import surefoot as sf
from surefoot.robot_io.robot import Robot
from surefoot.schemas.reasons import Outcome
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.scenario_robot import Delay, SensorDelays, Sensors

pytestmark = pytest.mark.closed_loop

HALF_WEIGHT_N = 345.0
CALM = 1.15
"""Largest force over half the weight of a robot that does not sway [1]."""
NOISE: dict[str, Any] = {"force_noise_n": 2.0, "moment_noise_nm": 0.1}


def at_rate(rate_hz: float) -> Robot:
    robot = sf.load_robot("walker", servo_profile="ideal")
    gate = msgspec.structs.replace(
        robot.file.gate, max_loop_delay_s=None, max_command_age_s=None
    )
    file = msgspec.structs.replace(robot.file, rate_hz=rate_hz, gate=gate)
    return replace(robot, file=file)


def peak(robot: Robot, scenario: Scenario, **settings: float) -> float:
    run = sf.simulate(robot, scenario, settings=settings)
    assert run.outcome is Outcome.STOOD, run.result.outcome_detail
    assert run.result.force_peak_n is not None
    return max(run.result.force_peak_n)


def standing(**what: Any) -> Scenario:
    return Scenario(
        **{"duration_s": 1.5, "sensors": Sensors(**NOISE), **what, "name": "late"}
    )


def test_a_robot_of_200_hz_stands() -> None:
    assert peak(at_rate(200.0), standing()) < CALM * HALF_WEIGHT_N


def test_ankle_sensors_of_100_hz_are_no_matter() -> None:
    scenario = standing(sensors=Sensors(**NOISE, force_torque_rate_hz=100.0))
    assert peak(at_rate(1000.0), scenario) < CALM * HALF_WEIGHT_N


def test_late_ankle_sensors_are_seen_by_their_stamps() -> None:
    scenario = standing(delay=Delay(sensor_ms=SensorDelays(force_torque=6.0)))
    assert peak(at_rate(1000.0), scenario) < CALM * HALF_WEIGHT_N


def test_what_all_sensors_are_late_by_has_to_be_told() -> None:
    scenario = standing(delay=Delay(sensor_ms=6.0))
    told = peak(at_rate(1000.0), scenario, **{"dik.loop_delay_s": 0.007})
    assert told < CALM * HALF_WEIGHT_N
    assert peak(at_rate(1000.0), scenario) > 2.0 * HALF_WEIGHT_N


def test_slow_drives_follow_swaying_ground_as_ideal_ones_do() -> None:
    robot = sf.load_robot("walker", servo_profile="harmonic")
    scenario = msgspec.structs.replace(
        sf.load_scenario("tilt-sine-pitch"), duration_s=2.2
    )
    assert peak(robot, scenario) < 1.3 * HALF_WEIGHT_N
