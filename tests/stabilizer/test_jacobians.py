"""Jacobians and their drift, compared with central differences."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pinocchio as pin
import pytest

from surefoot.schemas.arrays import Array
from surefoot.stabilizer.dynamics import SOLE_ROWS, Dynamics
from surefoot.stabilizer.model import RobotModel
from tests.stabilizer.states import State, states_anywhere, stepped, unit

STATES = 10
STEP = 1e-5
"""Step of the differences; truncation and rounding are both near 1e-10."""
TOLERANCE = 1e-7


@pytest.fixture
def states(model: RobotModel) -> Iterator[State]:
    return states_anywhere(model, count=STATES, seed=1)


@pytest.fixture
def dynamics(model: RobotModel) -> Dynamics:
    return Dynamics(model)


def placement(model: RobotModel, q: Array, *, side: int) -> pin.SE3:
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, q)
    return data.oMf[model.sole_ids[side]]


def centre_of_mass(model: RobotModel, q: Array) -> Array:
    com: Array = pin.centerOfMass(model.pin_model, model.pin_model.createData(), q)
    return com


def sole_twist(model: RobotModel, state: State, *, side: int) -> Array:
    """Return (6,) [linear; angular] in the sole frame."""
    data = model.pin_model.createData()
    pin.forwardKinematics(model.pin_model, data, state.q, state.v)
    twist: Array = pin.getFrameVelocity(
        model.pin_model, data, model.sole_ids[side], pin.LOCAL
    ).vector
    return twist


def com_velocity(model: RobotModel, state: State) -> Array:
    data = model.pin_model.createData()
    pin.centerOfMass(model.pin_model, data, state.q, state.v)
    velocity: Array = data.vcom[0].copy()
    return velocity


def drift(model: RobotModel, state: State, of: Callable[[State], Array]) -> Array:
    """Return the rate of a velocity while all of v stays constant."""
    ahead = State(stepped(model, state.q, along=STEP * state.v), state.v)
    behind = State(stepped(model, state.q, along=-STEP * state.v), state.v)
    rate: Array = (of(ahead) - of(behind)) / (2.0 * STEP)
    return rate


def jacobian_of(
    model: RobotModel, state: State, way: Callable[[Array, Array], Array]
) -> Array:
    """Return (rows, n_v) central differences of a displacement."""
    columns = []
    for index in range(model.n_v):
        step = STEP * unit(model, index)
        behind, ahead = (stepped(model, state.q, along=s * step) for s in (-1.0, 1.0))
        columns.append(way(behind, ahead) / (2.0 * STEP))
    return np.column_stack(columns)


@pytest.mark.parametrize("side", [0, 1])
def test_sole_jacobian_is_the_derivative_of_the_placement(
    model: RobotModel, dynamics: Dynamics, states: Iterator[State], side: int
) -> None:
    for state in states:
        dynamics.update(state.q, state.v)
        here = placement(model, state.q, side=side)

        def turn(q: Array, here: pin.SE3 = here) -> Array:
            """Return the rotation in the sole's own axes: log of T_here_moved."""
            log: Array = pin.log6(here.actInv(placement(model, q, side=side))).vector
            return log

        J = jacobian_of(model, state, lambda a, b, turn=turn: turn(b) - turn(a))
        rows = dynamics.J_contact[SOLE_ROWS[side]]
        np.testing.assert_allclose(rows, J, atol=TOLERANCE)


def test_com_jacobian_is_the_derivative_of_the_centre_of_mass(
    model: RobotModel, dynamics: Dynamics, states: Iterator[State]
) -> None:
    def way(behind: Array, ahead: Array) -> Array:
        return centre_of_mass(model, ahead) - centre_of_mass(model, behind)

    for state in states:
        dynamics.update(state.q, state.v)
        J = jacobian_of(model, state, way)
        np.testing.assert_allclose(dynamics.J_com, J, atol=TOLERANCE)


@pytest.mark.parametrize("side", [0, 1])
def test_sole_drift_is_the_twists_rate_while_coasting(
    model: RobotModel, dynamics: Dynamics, states: Iterator[State], side: int
) -> None:
    for state in states:
        dynamics.update(state.q, state.v)
        rate = drift(model, state, lambda s: sole_twist(model, s, side=side))
        actual = dynamics.Jdot_v_contact[SOLE_ROWS[side]]
        np.testing.assert_allclose(actual, rate, atol=TOLERANCE)


def test_com_drift_is_the_velocitys_rate_while_coasting(
    model: RobotModel, dynamics: Dynamics, states: Iterator[State]
) -> None:
    for state in states:
        dynamics.update(state.q, state.v)
        rate = drift(model, state, lambda s: com_velocity(model, s))
        np.testing.assert_allclose(dynamics.Jdot_v_com, rate, atol=TOLERANCE)


def test_velocities_are_jacobians_times_v(
    model: RobotModel, dynamics: Dynamics, states: Iterator[State]
) -> None:
    for state in states:
        dynamics.update(state.q, state.v)
        np.testing.assert_allclose(
            dynamics.v_com, dynamics.J_com @ state.v, atol=TOLERANCE
        )
        for side, rows in enumerate(SOLE_ROWS):
            np.testing.assert_allclose(
                dynamics.v_sole[rows],
                sole_twist(model, state, side=side),
                atol=TOLERANCE,
            )


def test_positions_are_those_of_forward_kinematics(
    model: RobotModel, dynamics: Dynamics, states: Iterator[State]
) -> None:
    for state in states:
        dynamics.update(state.q, state.v)
        com = centre_of_mass(model, state.q)
        np.testing.assert_allclose(dynamics.p_com, com, atol=TOLERANCE)
        for side in (0, 1):
            sole = placement(model, state.q, side=side)
            np.testing.assert_allclose(dynamics.p_sole[side], sole.translation)
            np.testing.assert_allclose(dynamics.R_world_sole[side], sole.rotation)


FRAMES = pytest.mark.parametrize("name", ["left_hand", "right_foot", "head"])


def frame_twist(model: RobotModel, state: State, *, name: str) -> Array:
    """Return (6,) [velocity of the origin; angular velocity], world axes."""
    data = model.pin_model.createData()
    pin.forwardKinematics(model.pin_model, data, state.q, state.v)
    frame_id = model.pin_model.getFrameId(name)
    twist: Array = pin.getFrameVelocity(
        model.pin_model, data, frame_id, pin.LOCAL_WORLD_ALIGNED
    ).vector
    return twist


@FRAMES
def test_frame_jacobian_is_the_derivative_of_its_placement(
    model: RobotModel, dynamics: Dynamics, states: Iterator[State], name: str
) -> None:
    frame_id, moved = model.frame_id(name), Dynamics(model)

    def placed(q: Array, R: Array) -> Array:
        """Return place, and rotation about world axes: log of R_moved R^T."""
        moved.update(q, np.zeros(model.n_v))
        R_moved, p_moved = moved.frame_placement(frame_id)
        return np.concatenate((p_moved, pin.log3(R_moved @ R.T)))

    for state in states:
        dynamics.update(state.q, state.v)
        R, _ = dynamics.frame_placement(frame_id)
        J = jacobian_of(model, state, lambda a, b, R=R: placed(b, R) - placed(a, R))
        np.testing.assert_allclose(dynamics.frame_jacobian(frame_id), J, atol=TOLERANCE)


@FRAMES
def test_frame_drift_is_its_twists_rate_while_coasting(
    model: RobotModel, dynamics: Dynamics, states: Iterator[State], name: str
) -> None:
    frame_id = model.frame_id(name)
    for state in states:
        dynamics.update(state.q, state.v)
        twist = frame_twist(model, state, name=name)
        J = dynamics.frame_jacobian(frame_id)
        np.testing.assert_allclose(J @ state.v, twist, atol=TOLERANCE)
        rate = drift(model, state, lambda s: frame_twist(model, s, name=name))
        np.testing.assert_allclose(dynamics.frame_drift(frame_id), rate, atol=TOLERANCE)


def test_frame_that_is_not_there_is_refused_with_its_nearest_names(
    model: RobotModel,
) -> None:
    with pytest.raises(ValueError, match=r"got frame 'left_hnd'.*there is left_hand"):
        model.frame_id("left_hnd")
