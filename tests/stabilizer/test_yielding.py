"""The sign of the whole law: a foot that is pushed too hard yields."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.schemas.arrays import Array
from surefoot.stabilizer.dynamics import SOLE_ROWS
from surefoot.stabilizer.model import RobotModel
from tests.stabilizer.laws import answer, make_law
from tests.stabilizer.mirror import Mirror
from tests.stabilizer.rig import Rig
from tests.stabilizer.states import nominal_state

EXTRA_N, EXTRA_NM = 50.0, 5.0
NORMAL, ROLL, PITCH = 2, 3, 4
SYMMETRY = 1e-9
SIDES = pytest.mark.parametrize("side", [0, 1], ids=["left", "right"])


@pytest.fixture
def standing(model: RobotModel) -> Rig:
    """Return a rig at rest in the nominal stance, with F_id computed."""
    rig = Rig(model)
    rig.go(nominal_state(model))
    assert rig.solve_tsid().ok
    return rig


def soles_answer(rig: Rig, e_F: Array) -> tuple[Array, Array]:
    """Return (12,) twists that the law asks for, and those that the DIK gives."""
    law = make_law(rig.settings)
    F_id = rig.tsid.F_id
    r = answer(law, rig, F_id + e_F, F_id=F_id)
    solution = rig.solve_dik(r)
    assert solution.ok
    return r.copy(), rig.dynamics.J_contact @ solution.x


def at_point(twist: Array, point: Array) -> Array:
    """Return (3,) the velocity of a point of the sole, sole frame."""
    velocity: Array = twist[:3] + np.cross(twist[3:], point)
    return velocity


@SIDES
def test_foot_that_is_pushed_too_hard_yields_upwards(standing: Rig, side: int) -> None:
    e_F = np.zeros(12)
    e_F[6 * side + NORMAL] = EXTRA_N
    r, twist = soles_answer(standing, e_F)
    assert r[6 * side + NORMAL] > 0.0
    assert twist[6 * side + NORMAL] > 0.0
    # The other foot, pushed as it should be, goes down against it.
    assert twist[6 * side + NORMAL] > twist[6 * (1 - side) + NORMAL]


@SIDES
def test_foot_that_is_pushed_too_little_reaches_for_the_ground(
    standing: Rig, side: int
) -> None:
    e_F = np.zeros(12)
    e_F[6 * side + NORMAL] = -EXTRA_N
    r, twist = soles_answer(standing, e_F)
    assert r[6 * side + NORMAL] < 0.0
    assert twist[6 * side + NORMAL] < 0.0


@SIDES
@pytest.mark.parametrize(
    ("edge", "axis", "sign"),
    [
        # Pressure under the toe, at +x: m_y = -x f_z. Under the left edge, m_x = y f_z.
        pytest.param([0.1, 0.0, 0.0], PITCH, -1.0, id="toe"),
        pytest.param([-0.1, 0.0, 0.0], PITCH, 1.0, id="heel"),
        pytest.param([0.0, 0.05, 0.0], ROLL, 1.0, id="left edge"),
        pytest.param([0.0, -0.05, 0.0], ROLL, -1.0, id="right edge"),
    ],
)
def test_edge_that_is_loaded_too_much_yields_upwards(
    standing: Rig, side: int, edge: list[float], axis: int, sign: float
) -> None:
    rows = SOLE_ROWS[side]
    e_F = np.zeros(12)
    e_F[rows.start + axis] = sign * EXTRA_NM
    for twist in soles_answer(standing, e_F):
        loaded = at_point(twist[rows], np.array(edge))[NORMAL]
        relieved = at_point(twist[rows], -np.array(edge))[NORMAL]
        assert loaded > 0.0
        assert loaded > relieved


def test_nothing_moves_when_the_wrenches_are_right(standing: Rig) -> None:
    r, twist = soles_answer(standing, np.zeros(12))
    np.testing.assert_allclose(r, 0.0, atol=SYMMETRY)
    np.testing.assert_allclose(twist, 0.0, atol=SYMMETRY)


def test_right_foot_answers_as_the_left_ones_mirror_image(
    standing: Rig, model: RobotModel
) -> None:
    mirror = Mirror(model)
    rng = np.random.default_rng(26)
    e_F = np.array([20.0, 20.0, EXTRA_N, 5.0, 5.0, 1.0] * 2) * rng.normal(size=12)
    r, twist = soles_answer(standing, e_F)
    r_mirrored, twist_mirrored = soles_answer(standing, mirror.wrenches(e_F))
    np.testing.assert_allclose(r_mirrored, mirror.twists(r), atol=SYMMETRY)
    np.testing.assert_allclose(twist_mirrored, mirror.twists(twist), atol=SYMMETRY)
