from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.sim_robot.conventions import xyzw
from surefoot.sim_robot.plant import Plant
from surefoot.sim_robot.world import build_world
from tests.sim_robot.conftest import MakeScenario

TURN = np.sqrt(0.5)


def test_free_joint_has_world_linear_and_body_angular_velocity(
    walker: Robot, make_scenario: MakeScenario
) -> None:
    model = build_world(walker, make_scenario()).model
    qpos, qvel = np.zeros(model.nq), np.zeros(model.nv)
    # Turned left by 90 degrees, scalar first; x of the base is y of the world.
    qpos[3:7] = TURN, 0.0, 0.0, TURN
    qvel[0] = 1.0  # [m/s], world x
    qvel[3] = np.pi / 2.0  # [rad/s], base x
    mujoco.mj_integratePos(model, qpos, qvel, 1.0)
    np.testing.assert_allclose(qpos[:3], [1.0, 0.0, 0.0], atol=1e-12)
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, qpos[3:7])
    x_axis, y_axis, _ = matrix.reshape(3, 3).T
    np.testing.assert_allclose(x_axis, [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(y_axis, [0.0, 0.0, 1.0], atol=1e-12)


def test_quaternions_leave_with_the_scalar_last() -> None:
    np.testing.assert_array_equal(
        xyzw(np.array([0.5, 0.1, 0.2, 0.3])), [0.1, 0.2, 0.3, 0.5]
    )


def test_actuators_and_addresses_are_in_bus_order(standing_plant: Plant) -> None:
    model, world = standing_plant.world.model, standing_plant.world
    names = [model.actuator(i).name for i in range(model.nu)]
    addressed = [model.joint(int(model.dof_jntid[dof])).name for dof in world.joint_dof]
    assert names == addressed
    assert [model.joint(n).qposadr[0] for n in names] == list(world.joint_qpos)


def test_only_soles_collide_and_only_with_the_ground(
    walker: Robot, make_scenario: MakeScenario
) -> None:
    model = build_world(
        walker, make_scenario(platform=[{"foot": "left"}, {"foot": "right"}])
    ).model
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()
    pairs = {
        frozenset((model.geom(int(a)).name, model.geom(int(b)).name))
        for a, b in zip(model.pair_geom1, model.pair_geom2, strict=True)
    }
    assert pairs == {
        frozenset((ground, sole))
        for ground in ("ground_left", "ground_right")
        for sole in (walker.left.sole_frame, walker.right.sole_frame)
    }


def test_soles_of_the_robot_file_are_the_collision_boxes_of_the_urdf(
    walker: Robot,
) -> None:
    root = ElementTree.parse(walker.urdf_path).getroot()
    for foot in (walker.left, walker.right):
        box = root.find(f"link[@name='{foot.ft_link}']/collision/geometry/box")
        assert box is not None
        length, width, _ = map(float, box.get("size", "").split())
        assert length == pytest.approx(2.0 * foot.half_length_m)
        assert width == pytest.approx(2.0 * foot.half_width_m)


def test_friction_is_that_of_the_scenario(
    walker: Robot, make_scenario: MakeScenario
) -> None:
    model = build_world(walker, make_scenario(friction=0.35)).model
    np.testing.assert_allclose(model.pair_friction[:, :2], 0.35)


def test_mass_scale_scales_every_link_but_no_rotor(
    walker: Robot, make_scenario: MakeScenario
) -> None:
    scale = 1.07
    nominal = build_world(walker, make_scenario())
    heavy = build_world(walker, make_scenario(model_error={"mass_scale": scale}))
    links = nominal.model.body_rootid == nominal.base_body
    assert heavy.weight == pytest.approx(scale * nominal.weight)
    for array in ("body_mass", "body_inertia"):
        np.testing.assert_allclose(
            getattr(heavy.model, array)[links],
            scale * getattr(nominal.model, array)[links],
        )
    np.testing.assert_array_equal(heavy.model.dof_armature, nominal.model.dof_armature)


def test_soles_start_flat_on_the_ground_with_the_base_above_the_origin(
    walker: Robot, make_scenario: MakeScenario
) -> None:
    world = build_world(walker, make_scenario())
    assert world.nominal.base_height == pytest.approx(
        walker.file.nominal_base_height_m, abs=1e-3
    )


def test_platforms_do_not_loosen_the_solver(
    walker: Robot, make_scenario: MakeScenario
) -> None:
    """MuJoCo's tolerance is relative to the mean inertia of all joints."""
    lift = {"axis": "z", "kind": "sine", "amplitude_m": 0.1, "frequency_hz": 1.0}
    still = build_world(walker, make_scenario()).model
    moving = build_world(
        walker, make_scenario(platform=[{"foot": "both", "motion": [lift]}])
    ).model
    assert moving.stat.meaninertia == pytest.approx(still.stat.meaninertia)
