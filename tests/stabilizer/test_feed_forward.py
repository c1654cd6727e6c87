"""The ground's motion, fed forward where a foot stands on it."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.schemas.arrays import Array
from surefoot.stabilizer.dynamics import SOLE_ROWS
from surefoot.stabilizer.model import RobotModel
from tests.stabilizer.laws import HALF_SIZES, PERIOD_S, answer, make_law, settings_with
from tests.stabilizer.rig import BOTH, LEFT, RIGHT, Rig
from tests.stabilizer.states import State, nominal_state

GAIN = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
SETTINGS = settings_with(ground={"gain": GAIN}, dik={"stance_leak": 0.0})
LONG = 2000
"""Ticks after which the low-pass has settled."""
SETTLED = 1e-6
FIRM = SETTINGS.ground.firm_force_n


@pytest.fixture
def moving(model: RobotModel) -> Rig:
    """Return sensors in which both soles move steadily and the joints rest."""
    rig = Rig(model, SETTINGS)
    state = nominal_state(model)
    state.v[:6] = 0.1, -0.05, 0.08, 0.2, -0.1, 0.3
    rig.go(State(q=state.q, v=state.v))
    return rig


def settled(rig: Rig, *, normals: tuple[float, float], in_contact: list[bool]) -> Array:
    """Return (12,) wanted twists after the ground's twist has settled.

    There is no wrench error, so the twists are the feed-forward alone.
    """
    law = make_law(SETTINGS)
    F = np.zeros(12)
    F[[2, 8]] = normals
    for _ in range(LONG):
        r = answer(law, rig, F, F_id=F, in_contact=in_contact)
    return r


def test_standing_foot_moves_with_its_ground(moving: Rig) -> None:
    r = settled(moving, normals=(FIRM, 2.0 * FIRM), in_contact=BOTH)
    expected = np.array(GAIN * 2) * moving.dynamics.v_sole
    np.testing.assert_allclose(r, expected, atol=SETTLED)


def test_foot_moves_the_more_with_its_ground_the_firmer_it_stands(
    moving: Rig,
) -> None:
    full = np.array(GAIN) * moving.dynamics.v_sole[:6]
    shares = []
    for load in np.linspace(0.0, 1.5 * FIRM, 7):
        r = settled(moving, normals=(load, FIRM), in_contact=BOTH)
        shares.append(float(r[:6] @ full / (full @ full)))
        np.testing.assert_allclose(r[:6], shares[-1] * full, atol=SETTLED)
    assert shares[0] == 0.0
    assert shares[-1] == pytest.approx(1.0, abs=SETTLED)
    assert (np.diff(shares) >= -SETTLED).all()


@pytest.mark.parametrize("side", [0, 1])
def test_lifted_foot_has_no_ground_to_move_with(moving: Rig, side: int) -> None:
    """It comes down as if nothing moved, however loaded the other is."""
    in_contact = [RIGHT, LEFT][side]
    normals = (0.0, FIRM) if side == 0 else (FIRM, 0.0)
    with_motion = settled(moving, normals=normals, in_contact=in_contact)[
        SOLE_ROWS[side]
    ].copy()
    moving.go(nominal_state(moving.model))
    at_rest = settled(moving, normals=normals, in_contact=in_contact)
    np.testing.assert_array_equal(with_motion, at_rest[SOLE_ROWS[side]])


@pytest.mark.parametrize("side", [0, 1])
def test_feed_forward_returns_slowly_after_a_foot_was_in_the_air(
    moving: Rig, side: int
) -> None:
    law = make_law(SETTINGS)
    firm = np.zeros(12)
    firm[[2, 8]] = FIRM

    def update(F: Array, in_contact: list[bool]) -> float:
        """Return the share of the sole's own twist that is asked of it."""
        r = answer(law, moving, F, F_id=F, in_contact=in_contact)[SOLE_ROWS[side]]
        full = np.array(GAIN) * law.ground_twist[SOLE_ROWS[side]]
        return float(r @ full / (full @ full))

    for _ in range(LONG):
        assert update(firm, BOTH) == pytest.approx(1.0)
    update(np.zeros(12), [RIGHT, LEFT][side])
    ticks = round(SETTINGS.ground.recovery_s / PERIOD_S)
    shares = [update(firm, BOTH) for _ in range(ticks)]
    np.testing.assert_allclose(shares, np.arange(1, ticks + 1) / ticks, atol=SETTLED)


def test_ground_at_rest_adds_nothing(moving: Rig) -> None:
    moving.go(nominal_state(moving.model))
    r = settled(moving, normals=(FIRM, FIRM), in_contact=BOTH)
    np.testing.assert_array_equal(r, 0.0)


def test_lead_answers_a_change_before_the_low_pass_does(moving: Rig) -> None:
    """One tick after the ground sets off, more than the low-passed twist is there."""
    law = make_law(SETTINGS)
    F = np.zeros(12)
    answer(law, moving, F, F_id=F)
    first = law.ground_twist.copy()
    blend = -np.expm1(-2.0 * np.pi * SETTINGS.ground.cutoff_hz * PERIOD_S)
    low_passed = blend * moving.dynamics.v_sole
    assert (np.abs(first) >= np.abs(low_passed)).all()
    assert (np.sign(first) == np.sign(moving.dynamics.v_sole)).all()


X, Y = HALF_SIZES[0]
EDGE_BEGINS = SETTINGS.ground.edge_begins


def pressed_at(x: float, y: float) -> Array:
    """Return (12,) wrenches with the pressure at x, y of each sole [m]; both firm."""
    foot = [0.0, 0.0, FIRM, FIRM * y, -FIRM * x, 0.0]
    return np.array(foot * 2)


def twist_fed_forward(rig: Rig, F: Array, *, turns: float = 1.0) -> Array:
    """Return (12,) twists after settling, without wrench error, at gain one."""
    law = make_law(settings_with(ground={"gain": (1.0,) * 6}, dik={"stance_leak": 0.0}))
    law.turns = turns
    for _ in range(LONG):
        r = answer(law, rig, F, F_id=F)
    return r


@pytest.mark.parametrize("inward", [0.0, 0.5, EDGE_BEGINS - 0.01])
def test_foot_pressed_inside_its_edges_moves_with_all_of_its_twist(
    moving: Rig, inward: float
) -> None:
    r = twist_fed_forward(moving, pressed_at(inward * X, -inward * Y))
    np.testing.assert_allclose(r, moving.dynamics.v_sole, atol=SETTLED)


@pytest.mark.parametrize(
    ("x", "y", "axis"),
    [(0.0, Y, 3), (0.0, -Y, 3), (X, 0.0, 4), (-X, 0.0, 4)],
    ids=["left edge", "right edge", "toe", "heel"],
)
def test_foot_pressed_at_its_edge_may_tip_and_only_that_edge_is_the_ground(
    moving: Rig, x: float, y: float, axis: int
) -> None:
    """No rotation about the edge, and no more speed than the edge itself has."""
    r = twist_fed_forward(moving, pressed_at(x, y))[:6]
    v = moving.dynamics.v_sole[:6]
    assert r[axis] == pytest.approx(0.0, abs=SETTLED)
    edge_speed = v[2] + v[3] * y - v[4] * x
    fed_speed = r[2] + r[3] * y - r[4] * x
    assert fed_speed == pytest.approx(edge_speed, abs=SETTLED)


def test_rotation_fed_forward_fades_towards_the_edge_and_returns_in_time(
    moving: Rig,
) -> None:
    law = make_law(settings_with(ground={"gain": (1.0,) * 6}, dik={"stance_leak": 0.0}))

    def share(y: float) -> float:
        F = pressed_at(0.0, y)
        answer(law, moving, F, F_id=F)
        return float(law.r[3] / law.ground_twist[3])

    for _ in range(LONG):
        share(0.0)
    shares = [share(y) for y in np.linspace(EDGE_BEGINS * Y, Y, 8)]
    np.testing.assert_allclose(shares, np.linspace(1.0, 0.0, 8), atol=SETTLED)
    ticks = round(SETTINGS.ground.edge_recovery_s / PERIOD_S)
    back = [share(0.0) for _ in range(ticks)]
    np.testing.assert_allclose(back, np.arange(1, ticks + 1) / ticks, atol=SETTLED)


def test_of_a_sole_on_an_edge_only_the_pressed_point_is_the_ground(
    moving: Rig,
) -> None:
    """However far inside the sole that edge is; ground in between counts in part."""
    x, y = 0.2 * X, -0.3 * Y
    v = moving.dynamics.v_sole[:6]
    for turns in (0.0, 0.4, 1.0):
        r = twist_fed_forward(moving, pressed_at(x, y), turns=turns)[:6]
        np.testing.assert_allclose(r[3:5], turns * v[3:5], atol=SETTLED)
        pressed = v[2] + v[3] * y - v[4] * x
        assert r[2] + r[3] * y - r[4] * x == pytest.approx(pressed, abs=SETTLED)
