"""The scene before the first message, and during a walk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.schemas.scenario import scenario_from_table
from surefoot.sim_robot.state_view import ground_blocks
from surefoot.sim_robot.world import build_world
from surefoot.view.page import tilt_deg
from surefoot.view.robot_shape import RobotShape
from surefoot.view.scene_state import (
    WalkSight,
    nominal_state,
    odometry_in_world,
    pose,
)
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


def test_all_ground_of_a_scenario_is_told_in_its_place(robot: Robot) -> None:
    scenario = scenario_from_table(
        {
            "name": "ground",
            "duration_s": 1.0,
            "start": {"yaw_deg": 90.0},
            "platform": [{"foot": "left", "size_m": [0.6, 0.5]}],
            "tile": [{"center_m": [1.0, 0.2], "size_m": [0.3, 0.4], "height_m": 0.05}],
        },
        source="test",
    )
    world = build_world(robot, scenario)
    left, right, tile = ground_blocks(world)
    assert (left.platform, right.platform, tile.platform) == (0, -1, -1)
    assert tile.position == [1.0, 0.2, 0.05]
    assert left.size[:2] == [0.6, 0.5]
    on_platform = pose([*world.platforms[0].top_centre], [0.0, 0.0, 0.0, 1.0])
    middle = on_platform @ pose(left.position, left.quat_xyzw)
    geom = world.model.geom("ground_left")
    body = world.model.body("ground_left")
    np.testing.assert_allclose(middle[:2, 3], (body.pos + geom.pos)[:2], atol=1e-9)
    assert middle[2, 3] == pytest.approx(0.0)
    turned = middle[:3, 0]
    np.testing.assert_allclose(turned, [0.0, 1.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("on_ground", [(True, False), (False, True)])
def test_footsteps_lie_on_the_ground_where_the_standing_foot_shows_them(
    on_ground: tuple[bool, bool],
) -> None:
    footholds = np.array([[1.0, 0.1, 0.02, 0.3], [0.8, -0.1, 0.0, 0.2]])
    ground = Rotation.from_euler("xy", [0.1, -0.05]).as_matrix()
    T = np.eye(4)
    T[:3, :3] = ground @ Rotation.from_euler("z", 0.7).as_matrix()
    T[:3, 3] = (3.0, -2.0, 0.1)
    soles = []
    for (x, y, z, yaw), down in zip(footholds, on_ground, strict=True):
        sole = np.eye(4)
        sole[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
        sole[:3, 3] = (x, y, z if down else z + 0.05)  # the other one is lifted
        soles.append(T @ sole)
    nothing = np.zeros(2)
    walk = WalkSight(
        footholds=footholds,
        on_ground=on_ground,
        planned=np.zeros((0, 4)),
        dcm=nothing,
        dcm_reference=nothing,
        zmp_reference=nothing,
    )
    found = odometry_in_world(walk, (soles[0], soles[1]), ground)
    np.testing.assert_allclose(found, T, atol=1e-12)


def test_a_robot_that_leans_leans_whatever_its_base_links_axes(robot: Robot) -> None:
    leans = Rotation.from_euler("xyz", (3.0, -2.0, 40.0), degrees=True).as_matrix()
    base = np.eye(4)
    base[:3, :3] = leans @ robot.R_upright_base
    np.testing.assert_allclose(tilt_deg(base, robot), (3.0, -2.0), atol=1e-9)
