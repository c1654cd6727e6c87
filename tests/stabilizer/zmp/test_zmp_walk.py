"""The ZMP baseline walks by the same plans as the whole-body controller."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.schemas.reasons import Outcome
from surefoot.schemas.scenario import scenario_from_table
from surefoot.schemas.settings import ControllerSettings
from surefoot.simulation import Simulation
from surefoot.stabilizer.controller import Walks
from surefoot.stabilizer.zmp.controller import ZmpController
from tests.stabilizer.closed_loop import NOISE

pytestmark = pytest.mark.closed_loop
DCM_RMS_MM, PLACEMENT_MM, LEVEL_RAD = 15.0, 30.0, 0.03


def walk(robot: Robot, **table: Any) -> tuple[Simulation, ZmpController]:
    """Walk ahead by two steps of 0.1 m, then stand."""
    scenario = scenario_from_table(
        {
            "name": "walk",
            "duration_s": 5.0,
            "sensors": NOISE,
            "walk": {
                "velocity_m_s": 0.2,
                "start_s": 0.5,
                "step_s": 0.5,
                "double_s": 0.2,
            },
            **table,
        },
        source="test",
    )
    sim = Simulation(robot, scenario)
    controller = ZmpController(robot, ControllerSettings())
    sim.run(controller)
    return sim, controller


def test_it_takes_plans(walker: Robot) -> None:
    assert isinstance(ZmpController(walker, ControllerSettings()), Walks)


def test_it_walks_ahead_and_stands(walker: Robot) -> None:
    sim, controller = walk(walker)
    result = sim.result()
    assert result.outcome is Outcome.WALKED, result.outcome_detail
    assert result.steps_done == result.steps_planned
    assert result.steps_done
    assert max(result.dcm_error_rms_mm or [np.inf]) < DCM_RMS_MM
    assert (result.placement_error_max_mm or np.inf) < PLACEMENT_MM
    assert result.distance_m is not None
    assert result.distance_m > 0.1
    assert not controller.walk.is_walking
    assert controller.observer.contacts.in_contact == [True, True]
    # The soles lie flat again, on the ground and in the commanded posture.
    for R in controller.commanded.kinematics.R_world_sole:
        assert abs(R[2, 0]) < LEVEL_RAD
        assert abs(R[2, 1]) < LEVEL_RAD


def test_a_robot_asked_for_no_step_is_left_alone(walker: Robot) -> None:
    sim = Simulation(walker, "standing")
    controller = ZmpController(walker, ControllerSettings())
    sim.step(controller)
    assert controller.walk.state is None
    assert not controller.walk.is_walking
    assert controller.commanded.swings == [False, False]
