"""The inertia matrix, its inverse, and the inertia that the feet see."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.stabilizer.dynamics import SOLE_ROWS, Dynamics
from surefoot.stabilizer.model import RobotModel
from tests.stabilizer.states import State, states_anywhere
from tests.test_models_agree import RELATIVE, assert_close

STATES = 20


@pytest.fixture
def dynamics(model: RobotModel) -> Dynamics:
    return Dynamics(model)


@pytest.fixture
def visited(model: RobotModel, dynamics: Dynamics) -> Iterator[State]:
    """Yield random states, for which ``dynamics`` has been updated."""
    states = states_anywhere(model, count=STATES, seed=2)
    return (enter(dynamics, state) for state in states)


def enter(dynamics: Dynamics, state: State) -> State:
    dynamics.update(state.q, state.v)
    return state


def test_inertia_is_that_of_the_links_plus_that_of_the_drives(
    walker: Robot, dynamics: Dynamics, visited: Iterator[State]
) -> None:
    links = pin.buildModelFromUrdf(str(walker.urdf_path), pin.JointModelFreeFlyer())
    drives = np.zeros(links.nv)
    for name, armature in zip(walker.joint_names, walker.armature, strict=True):
        drives[links.joints[links.getJointId(name)].idx_v] = armature
    assert drives.max() > 0.0
    for state in visited:
        upper = np.triu(pin.crba(links, links.createData(), state.q))
        expected = upper + np.triu(upper, 1).T + np.diag(drives)
        assert_close(dynamics.inertia_matrix(), expected)


def test_inverse_is_symmetric(dynamics: Dynamics, visited: Iterator[State]) -> None:
    for _ in visited:
        np.testing.assert_array_equal(dynamics.H_inv, dynamics.H_inv.T)


def test_inverse_times_inertia_is_identity(
    dynamics: Dynamics, visited: Iterator[State]
) -> None:
    for _ in visited:
        product = dynamics.H_inv @ dynamics.inertia_matrix()
        np.testing.assert_allclose(product, np.eye(len(product)), atol=RELATIVE)


def test_contact_inertia_is_what_the_feet_feel(
    dynamics: Dynamics, visited: Iterator[State]
) -> None:
    for _ in visited:
        J_contact, H = dynamics.J_contact, dynamics.inertia_matrix()
        X = np.linalg.solve(H, J_contact.T)
        assert_close(dynamics.X, X)
        assert_close(dynamics.Lambda_c_inv, J_contact @ X)
        np.testing.assert_allclose(
            dynamics.Lambda_c_inv, dynamics.Lambda_c_inv.T, atol=RELATIVE
        )


def test_bias_forces_keep_the_robot_from_accelerating(
    model: RobotModel, dynamics: Dynamics, visited: Iterator[State]
) -> None:
    data = model.pin_model.createData()
    for state in visited:
        inverse_dynamics = pin.rnea(
            model.pin_model, data, state.q, state.v, np.zeros(model.n_v)
        )
        assert_close(dynamics.c, inverse_dynamics)


def test_wrenches_do_the_same_work_in_the_world_and_at_the_joints(
    model: RobotModel, dynamics: Dynamics, visited: Iterator[State]
) -> None:
    """v.(J^T F) is force times velocity plus moment times rate, in world axes."""
    rng = np.random.default_rng(3)
    data = model.pin_model.createData()
    for state in visited:
        F = rng.normal(size=12)
        pin.forwardKinematics(model.pin_model, data, state.q, state.v)
        in_world = 0.0
        for frame, rows, R in zip(
            model.sole_ids, SOLE_ROWS, dynamics.R_world_sole, strict=True
        ):
            twist = pin.getFrameVelocity(
                model.pin_model, data, frame, pin.LOCAL_WORLD_ALIGNED
            )
            force, moment = F[rows].reshape(2, 3)
            in_world += (R @ force) @ twist.linear + (R @ moment) @ twist.angular
        at_joints = state.v @ (dynamics.J_contact.T @ F)
        assert at_joints == pytest.approx(in_world, rel=RELATIVE, abs=RELATIVE)


def test_armature_makes_the_ankle_several_times_stiffer_to_turn(
    walker: Robot, model: RobotModel
) -> None:
    """Left out, the gain of the wrench law would be several times wrong."""
    light = RobotModel(walker)
    light.pin_model.armature = np.zeros(light.n_v)
    turning = []
    for candidate in (model, light):
        dynamics = Dynamics(candidate)
        dynamics.update(model.nominal_configuration(), np.zeros(model.n_v))
        turning.append(np.diag(dynamics.Lambda_c_inv)[3:5])
    assert (turning[1] > 2.0 * turning[0]).all()
