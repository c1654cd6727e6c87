"""MuJoCo's and Pinocchio's models of the same robot files are the same robot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.schemas.arrays import Array, Mat
from surefoot.schemas.scenario import scenario_from_table
from surefoot.sim_robot.world import World, build_world
from tests.awkward_robot import AWKWARD, make_awkward

STATES = 100
RELATIVE = 1e-9
"""Relative to the largest entry; the rounding of inverting a 34 x 34 matrix."""
BASE_SPREAD_M = 0.5
VELOCITY_SPREAD = 1.0


@dataclass
class Pair:
    """Both models in the same state.

    ``T_mj_pin`` (nv, nv) maps Pinocchio's velocity (base twist in base, joints in URDF
    order) to MuJoCo's (world-linear, body-angular, joints in its own order). ``drift``
    (nv,) is its rate of change times the velocity.
    """

    robot: Robot
    world: World
    mj: mujoco.MjData
    pin_model: pin.Model
    pin_data: pin.Data
    q: Array
    v: Array
    T_mj_pin: Mat
    drift: Array

    @property
    def mj_inertia(self) -> Mat:
        inertia = np.zeros((self.world.model.nv,) * 2)
        mujoco.mj_fullM(self.world.model, self.mj, inertia)
        return inertia


@pytest.fixture(scope="module", params=["walker", "awkward"])
def models(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Robot, World, pin.Model]:
    if request.param == "walker":
        robot = load_robot("walker")
    else:
        robot = make_awkward(tmp_path_factory.mktemp("awkward"), AWKWARD).robot
    scenario = scenario_from_table({"name": "still", "duration_s": 1.0}, source="test")
    pin_model = pin.buildModelFromUrdf(str(robot.urdf_path), pin.JointModelFreeFlyer())
    armature = np.zeros(pin_model.nv)
    for name, value in zip(robot.joint_names, robot.armature, strict=True):
        armature[pin_model.joints[pin_model.getJointId(name)].idx_v] = value
    pin_model.armature = armature
    return robot, build_world(robot, scenario), pin_model


@pytest.fixture
def pairs(models: tuple[Robot, World, pin.Model]) -> Iterator[Pair]:
    """Return the same random states for every test."""
    robot, world, pin_model = models
    rng = np.random.default_rng(20261122)
    return (_random_pair(robot, world, pin_model, rng) for _ in range(STATES))


def _random_pair(
    robot: Robot, world: World, pin_model: pin.Model, rng: np.random.Generator
) -> Pair:
    data, pin_data = mujoco.MjData(world.model), pin_model.createData()
    quat = rng.normal(size=4)
    quat /= np.linalg.norm(quat)
    joints = rng.uniform(robot.lower, robot.upper)
    q, v = np.zeros(pin_model.nq), VELOCITY_SPREAD * rng.normal(size=pin_model.nv)
    q[:3] = BASE_SPREAD_M * rng.normal(size=3)
    q[3:7] = quat
    R_world_base = pin.Quaternion(quat).toRotationMatrix()

    T_mj_pin = np.zeros((world.model.nv, pin_model.nv))
    T_mj_pin[:3, :3] = R_world_base
    T_mj_pin[3:6, 3:6] = np.eye(3)
    for index, name in enumerate(robot.joint_names):
        joint = pin_model.joints[pin_model.getJointId(name)]
        q[joint.idx_q] = joints[index]
        T_mj_pin[world.joint_dof[index], joint.idx_v] = 1.0

    data.qpos[:3] = q[:3]
    data.qpos[3:7] = quat[[3, 0, 1, 2]]
    data.qpos[world.joint_qpos] = joints
    data.qvel[:] = T_mj_pin @ v
    mujoco.mj_forward(world.model, data)
    # d/dt (R v_base) at constant v_base is R (w x v_base).
    drift = np.zeros(world.model.nv)
    drift[:3] = R_world_base @ np.cross(v[3:6], v[:3])
    return Pair(robot, world, data, pin_model, pin_data, q, v, T_mj_pin, drift)


def assert_close(actual: Array, expected: Array) -> None:
    """Check that entries agree within RELATIVE of the largest one."""
    scale = float(np.abs(expected).max())
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=RELATIVE * scale)


def test_velocity_maps_cover_every_joint_once(pairs: Iterator[Pair]) -> None:
    T_mj_pin = next(pairs).T_mj_pin
    np.testing.assert_allclose(T_mj_pin @ T_mj_pin.T, np.eye(len(T_mj_pin)), atol=1e-12)


def test_mass_matrix_with_armature(pairs: Iterator[Pair]) -> None:
    for pair in pairs:
        inertia = pin.crba(pair.pin_model, pair.pin_data, pair.q)
        inertia = np.triu(inertia) + np.triu(inertia, 1).T
        assert_close(pair.T_mj_pin.T @ pair.mj_inertia @ pair.T_mj_pin, inertia)


def test_centre_of_mass_and_its_velocity(pairs: Iterator[Pair]) -> None:
    for pair in pairs:
        pin.centerOfMass(pair.pin_model, pair.pin_data, pair.q, pair.v)
        mujoco.mj_subtreeVel(pair.world.model, pair.mj)
        base = pair.world.base_body
        assert_close(pair.mj.subtree_com[base], pair.pin_data.com[0])
        assert_close(pair.mj.subtree_linvel[base], pair.pin_data.vcom[0])


def test_gravity_and_velocity_forces(pairs: Iterator[Pair]) -> None:
    for pair in pairs:
        forces = pin.nonLinearEffects(pair.pin_model, pair.pin_data, pair.q, pair.v)
        mj_forces = pair.mj.qfrc_bias + pair.mj_inertia @ pair.drift
        assert_close(pair.T_mj_pin.T @ mj_forces, forces)


@pytest.mark.parametrize("which", ["sole_frame", "ft_link"])
def test_foot_frames_and_jacobians(pairs: Iterator[Pair], which: str) -> None:
    for pair in pairs:
        model, nv = pair.world.model, pair.world.model.nv
        pin.computeJointJacobians(pair.pin_model, pair.pin_data, pair.q)
        pin.updateFramePlacements(pair.pin_model, pair.pin_data)
        for foot in (pair.robot.left, pair.robot.right):
            name = getattr(foot, which)
            frame = pair.pin_model.getFrameId(name)
            body = pair.mj.body(name)
            placement = pair.pin_data.oMf[frame]
            assert_close(body.xpos, placement.translation)
            assert_close(body.xmat.reshape(3, 3), placement.rotation)
            linear, angular = np.zeros((3, nv)), np.zeros((3, nv))
            mujoco.mj_jac(model, pair.mj, linear, angular, body.xpos, body.id)
            J_in_lwa = pin.getFrameJacobian(
                pair.pin_model, pair.pin_data, frame, pin.LOCAL_WORLD_ALIGNED
            )
            assert_close(np.vstack([linear, angular]) @ pair.T_mj_pin, J_in_lwa)


def test_imu_frame(pairs: Iterator[Pair]) -> None:
    for pair in pairs:
        pin.framesForwardKinematics(pair.pin_model, pair.pin_data, pair.q)
        frame = pair.pin_model.getFrameId(pair.robot.file.imu.frame)
        site = pair.mj.site(pair.world.sensor_sites["imu"])
        assert_close(site.xpos, pair.pin_data.oMf[frame].translation)
        assert_close(site.xmat.reshape(3, 3), pair.pin_data.oMf[frame].rotation)


def test_weight(models: tuple[Robot, World, pin.Model]) -> None:
    _, world, pin_model = models
    weight = pin.computeTotalMass(pin_model) * 9.81
    assert world.weight == pytest.approx(weight, rel=RELATIVE)
    assert pin_model.gravity.linear[2] == world.model.opt.gravity[2]
