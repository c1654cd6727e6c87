"""The first QP asks only for wrenches that the ground can give."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from surefoot.schemas.arrays import Array, Vec3
from surefoot.stabilizer.model import GRAVITY, RobotModel
from surefoot.stabilizer.qp import QpStatus
from tests.stabilizer.rig import BOTH, CONTACT_NAMES, CONTACT_SETS, Rig
from tests.stabilizer.states import nominal_state, states_near_stance

STATES = 40
SPREAD, SPEED = 0.15, 0.5
"""So far from the stance that limits are active nearly everywhere."""
WITHIN = 1e-6
"""Violation that the interior point method may leave [N, N m]."""
WEIGHT_RELATIVE = 1e-3
NEWTON_N = 1e-6
FEET = pytest.mark.parametrize("in_contact", CONTACT_SETS, ids=CONTACT_NAMES)


def wrenches(rig: Rig, in_contact: list[bool]) -> Iterator[Array]:
    """Yield F_id (12,) at random states; the rig stays at each."""
    for state in states_near_stance(
        rig.model, count=STATES, seed=10, spread=SPREAD, speed=SPEED
    ):
        rig.go(state)
        assert rig.solve_tsid(in_contact).ok
        yield rig.tsid.F_id


def world_force(rig: Rig, F: Array) -> Vec3:
    """Return (3,) the sum of both feet's forces in world axes [N]."""
    left, right = rig.dynamics.R_world_sole
    total: Vec3 = left @ F[:3] + right @ F[6:9]
    return total


@FEET
def test_wrenches_are_such_as_soles_and_drives_can_give(
    rig: Rig, in_contact: list[bool]
) -> None:
    settings = rig.settings.tsid
    for F in wrenches(rig, in_contact):
        for side, foot in enumerate(rig.model.robot.file.foot):
            f_x, f_y, f_z, m_x, m_y, m_z = F[6 * side : 6 * side + 6]
            if not in_contact[side]:
                np.testing.assert_array_equal(F[6 * side : 6 * side + 6], 0.0)
                continue
            assert np.hypot(f_x, f_y) <= settings.friction * f_z + WITHIN
            # The centre of pressure is inside the sole.
            inside = settings.sole_scale * f_z
            assert abs(m_y) <= inside * foot.half_length_m + WITHIN
            assert abs(m_x) <= inside * foot.half_width_m + WITHIN
            assert abs(m_z) <= settings.yaw_friction * f_z + WITHIN
            assert f_z >= settings.normal_force_min_n - WITHIN
            assert f_z <= rig.largest_force + WITHIN
        assert (np.abs(rig.tsid.tau) <= rig.model.torque_limit + WITHIN).all()


@FEET
def test_forces_move_the_centre_of_mass_as_newton_says(
    rig: Rig, in_contact: list[bool]
) -> None:
    mass, gravity = rig.model.mass, np.array([0.0, 0.0, GRAVITY])
    for F in wrenches(rig, in_contact):
        qdd = rig.tsid.A @ rig.tsid.tau + rig.tsid.b
        com_acceleration = rig.dynamics.J_com @ qdd + rig.dynamics.Jdot_v_com
        np.testing.assert_allclose(
            world_force(rig, F), mass * (com_acceleration + gravity), atol=NEWTON_N
        )


def test_standing_still_carries_the_weight_evenly(model: RobotModel, rig: Rig) -> None:
    rig.go(nominal_state(model))
    assert rig.solve_tsid().ok
    normals = rig.tsid.F_id[[2, 8]]
    assert normals.sum() == pytest.approx(rig.weight, rel=WEIGHT_RELATIVE)
    np.testing.assert_allclose(normals, 0.5 * rig.weight, rtol=WEIGHT_RELATIVE)


def test_no_foot_on_the_ground_is_a_status(model: RobotModel, rig: Rig) -> None:
    rig.go(nominal_state(model))
    assert rig.solve_tsid(BOTH).ok
    solution = rig.solve_tsid([False, False])
    assert solution.status is QpStatus.NO_CONTACT
    np.testing.assert_array_equal(rig.tsid.F_id, 0.0)


def test_com_behind_its_reference_is_pushed_forward(
    model: RobotModel, rig: Rig
) -> None:
    rig.go(nominal_state(model))
    for axis in (0, 1):
        rig.solve_tsid()
        before = world_force(rig, rig.tsid.F_id)[axis]
        rig.stance.com[axis] += 0.01
        rig.solve_tsid()
        assert world_force(rig, rig.tsid.F_id)[axis] > before
        rig.stance.com[axis] -= 0.01


@pytest.mark.parametrize("side", [0, 1])
def test_foot_may_be_asked_for_less_than_its_share(
    model: RobotModel, rig: Rig, side: int
) -> None:
    """As just after touch-down: the other foot carries the rest."""
    rig.go(nominal_state(model))
    allowed = np.full(2, rig.largest_force)
    allowed[side] = 0.1 * rig.weight
    solution = rig.tsid.solve(
        rig.dynamics, rig.stance, in_contact=BOTH, allowed=allowed
    )
    assert solution.ok
    assert rig.tsid.F_id[6 * side + 2] <= allowed[side] + WITHIN
