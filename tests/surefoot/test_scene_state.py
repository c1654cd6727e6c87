"""What a scene shows before the robot has said anything."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.view.robot_shape import RobotShape
from surefoot.view.scene_state import nominal_state
from tests.awkward_robot import AWKWARD, make_awkward

ON_THE_GROUND_M = 1e-4


@pytest.fixture(params=["walker", "awkward"])
def robot(request: pytest.FixtureRequest, tmp_path: Path) -> Robot:
    if request.param == "walker":
        return load_robot("walker")
    return make_awkward(tmp_path, AWKWARD).robot


def test_the_robot_stands_on_the_ground_until_data_come(robot: Robot) -> None:
    shape = RobotShape(robot)
    state = nominal_state(robot, shape)
    for foot in robot.file.foot:
        sole = state.base @ shape.poses(state.q)[foot.sole_frame]
        assert abs(sole[2, 3]) < ON_THE_GROUND_M
        np.testing.assert_allclose(sole[:3, 2], (0, 0, 1), atol=1e-3)
