"""A walk ends in order: without more steps, or when an ankle sensor is lost."""

from __future__ import annotations

import pytest

from surefoot.planner import VelocityPlanner
from surefoot.robot_io.robot import Robot
from surefoot.schemas.messages import SCHEMA_VERSION
from surefoot.schemas.scenario import scenario_from_table
from surefoot.schemas.settings import ControllerSettings
from surefoot.schemas.walk_plan import WalkPlan
from surefoot.simulation import Simulation
from surefoot.stabilizer.walking.feet import FootState
from surefoot.stabilizer.walking.footsteps import Pace, half_width_of
from surefoot.stabilizer.walking.gait import Phase
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from tests.stabilizer.closed_loop import NOISE

pytestmark = pytest.mark.closed_loop
WALK = {"velocity_m_s": 0.3, "start_s": 0.5, "step_s": 0.5, "double_s": 0.15}
IN_THE_AIR_S = 1.5
"""A time at which the left foot is in the air [s]."""


def begun(
    robot: Robot, *, until_s: float = IN_THE_AIR_S, **table: object
) -> tuple[Simulation, WholeBodyController]:
    scenario = scenario_from_table(
        {
            "name": "walk",
            "duration_s": 5.0,
            "sensors": NOISE,
            "walk": {**WALK, "stop_s": 4.0},
            **table,
        },
        source="test",
    )
    sim = Simulation(robot, scenario)
    controller = WholeBodyController(robot, ControllerSettings())
    while sim.time_s < until_s:
        sim.step(controller)
    if until_s == IN_THE_AIR_S:
        assert controller.walk.feet.states[0] is FootState.SWING
    return sim, controller


def test_an_empty_plan_brings_the_feet_together(walker: Robot) -> None:
    sim, controller = begun(walker)
    controller.follow_plan(
        WalkPlan(schema=SCHEMA_VERSION, tick=0, stamp_ns=0, begin_tick=0, steps=[])
    )
    while not sim.finished and controller.walk.is_walking:
        sim.step(controller)
    left, right = controller.observer.anchors.p
    assert controller.walk.gait.phase is Phase.STAND
    assert left[0] == pytest.approx(right[0], abs=0.01)
    assert controller.walk.state.done == 1


@pytest.mark.usual("right")
@pytest.mark.parametrize("asked", ["left", "right"])
def test_a_plan_in_the_first_shift_may_not_change_the_foot(
    walker: Robot, asked: str
) -> None:
    sim, controller = begun(walker, until_s=0.8)
    walk = controller.walk
    assert walk.gait.phase is Phase.SHIFT
    status = walk.state.message(tick=0, stamp_ns=0)
    assert status.moved == "right"  # the left foot leaves
    pace = Pace(0.2, 0.1 if asked == "left" else -0.1, 0.0, 0.5, 0.15, 0.05)
    planner = VelocityPlanner(pace, half_width=half_width_of(walker))
    assert planner.plan(status, count=1).steps[0].side == "left"
    controller.follow_plan(planner.plan(None if asked == "right" else status, count=2))
    assert (walk.state.refusal == "") == (asked == "left")
    while not sim.finished and walk.is_walking:
        sim.step(controller)
    assert not sim.fell
    assert walk.gait.phase is Phase.STAND
    assert walk.state.done == (2 if asked == "left" else 0)


@pytest.mark.usual("left")
@pytest.mark.parametrize("side", ["left", "right"])
def test_a_lost_ankle_sensor_ends_the_walk(walker: Robot, side: str) -> None:
    fault = {
        "sensor": f"{side}_ankle_ft",
        "kind": "nan",
        "start_s": IN_THE_AIR_S,
        "duration_s": 10.0,
    }
    sim, controller = begun(walker, fault=[fault])
    while not sim.finished and controller.walk.is_walking:
        sim.step(controller)
    assert not sim.fell
    assert controller.walk.gait.phase is Phase.STAND
    assert "ankle sensor" in controller.walk.state.refusal
    while not sim.finished:
        sim.step(controller)
    assert not sim.fell


@pytest.mark.parametrize(("at_s", "begins_anew"), [(1.6, True), (1.77, False)])
def test_a_caught_foot_takes_its_time_only_while_the_dcm_is_over_the_other_sole(
    walker: Robot, at_s: float, begins_anew: bool
) -> None:
    blow = {"body": "left_foot_plate", "force_n": [-150.0, 0.0, 0.0]}
    sim, controller = begun(
        walker, until_s=at_s, push=[{**blow, "start_s": at_s, "duration_s": 0.01}]
    )
    gait = controller.walk.gait
    planned_s = gait.duration_s
    while sim.time_s < at_s + 0.015:
        sim.step(controller)
    assert gait.phase is Phase.SINGLE
    assert (gait.duration_s > planned_s) is begins_anew
