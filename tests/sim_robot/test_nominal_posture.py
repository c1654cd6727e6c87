"""A robot that does not stand at tick 0 is refused before it runs."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.robot import Robot
from surefoot.schemas.reasons import FallCriterion
from surefoot.schemas.scenario import scenario_from_table
from surefoot.sim_robot.simulated_robot import SimulatedRobot
from tests.sim_robot.conftest import figures

SCENARIO = {"name": "test", "duration_s": 0.1}
OFF_RAD = 0.1
ANKLES = ("left_ankle_pitch", "right_ankle_pitch")


def posed(walker: Robot, offsets: dict[str, float]) -> Robot:
    """Return the Walker with another nominal posture."""
    joints = [
        msgspec.structs.replace(
            joint, nominal_rad=joint.nominal_rad + offsets.get(joint.name, 0.0)
        )
        for joint in walker.file.joint
    ]
    file = msgspec.structs.replace(walker.file, joint=joints)
    return Robot(
        **{
            field: file if field == "file" else getattr(walker, field)
            for field in walker.__dataclass_fields__
        }
    )


def simulated(robot: Robot) -> SimulatedRobot:
    return SimulatedRobot(robot, scenario_from_table(SCENARIO, source="x"), seed=0)


def test_soles_off_level_are_told_in_degrees(walker: Robot) -> None:
    robot = posed(walker, dict.fromkeys(ANKLES, OFF_RAD))
    with pytest.raises(RobotFileError, match=r"soles 5\.7 deg off level"):
        simulated(robot)


def test_a_robot_that_sinks_before_the_run_says_by_what_one_knows(
    walker: Robot,
) -> None:
    weak = {**SCENARIO, "model_error": {"servo_kp_scale": 0.01}}
    scenario = scenario_from_table(weak, source="x")
    with pytest.raises(
        RobotFileError,
        match=r"nominal posture: (the base|\w+ is down).*expected it to stand",
    ):
        SimulatedRobot(walker, scenario, seed=0)


@pytest.mark.parametrize(
    "world",
    [
        {
            "start": {"position_m": [50.0, 0.0]},
            "tile": [{"center_m": [0.0, 0.0], "size_m": [1.0, 1.0]}],
        },
        {"platform": [{"foot": "both", "size_m": [0.001, 0.001]}]},
        {"payload": [{"link": "torso", "mass_kg": 1e6}]},
    ],
    ids=["beside the ground", "a platform of a millimetre", "a payload of 1000 t"],
)
def test_a_robot_that_falls_upright_before_the_run_does_not_stand(
    walker: Robot, world: dict[str, object]
) -> None:
    scenario = scenario_from_table(SCENARIO | world, source="x")
    with pytest.raises(RobotFileError, match=r"sank by \d+\.\d m, nothing carries"):
        SimulatedRobot(walker, scenario, seed=0)


@pytest.mark.parametrize(("ticks", "counts"), [(200, False), (201, True)])
def test_no_force_peak_before_peaks_count(
    walker: Robot, ticks: int, counts: bool
) -> None:
    scenario = scenario_from_table({**SCENARIO, "duration_s": 1.0}, source="x")
    run = SimulatedRobot(walker, scenario, seed=0)
    for _ in range(ticks):
        run.advance(walker.nominal)
    peak = figures(run).force_peak_n
    assert (peak is not None) == counts
    assert peak is None or min(peak) > 0.0


def test_a_state_that_blew_up_is_named(walker: Robot) -> None:
    run = simulated(walker)
    run.plant.data.qpos[2] = math.nan
    run.plant.data.xpos[:] = np.nan
    assert run.plant.fell
    assert run.plant.diagnose_fall().criterion is FallCriterion.NOT_FINITE
