"""The wrench law: sole twists for measured wrenches."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.schemas.arrays import Array
from surefoot.stabilizer.control.force_feedback import ForceFeedback
from surefoot.stabilizer.dynamics import SOLE_ROWS
from surefoot.stabilizer.model import GRAVITY, RobotModel
from tests.stabilizer.laws import (
    NO_GAIN,
    NOTHING,
    PAPER,
    answer,
    make_law,
    settings_with,
)
from tests.stabilizer.rig import CONTACT_NAMES, CONTACT_SETS, LEFT, RIGHT, Rig
from tests.stabilizer.states import nominal_state, states_near_stance

STATES = 20
SPREAD, SPEED = 0.1, 0.3
ERROR = np.array([10.0, 10.0, 20.0, 2.0, 2.0, 1.0] * 2)
"""Spread of the wrench error [N, N m], at which soles stay below their limits."""
TOLERANCE = 1e-12
NORMAL_ROWS = (2, 8)
FEET = pytest.mark.parametrize("in_contact", CONTACT_SETS, ids=CONTACT_NAMES)
LIFTED = pytest.mark.parametrize("side", [0, 1], ids=["left", "right"])


def paper_law(rig: Rig, e_F: Array) -> Array:
    """Return (12,) -Lambda_c^-1 K^-1 e_F, every part written out."""
    J_contact = rig.dynamics.J_contact
    H = rig.dynamics.inertia_matrix()
    Lambda_c_inv = J_contact @ np.linalg.solve(H, J_contact.T)
    K = np.diag(rig.settings.dik.k_force * 2)
    r: Array = -Lambda_c_inv @ np.linalg.solve(K, e_F)
    return r


def test_without_extras_it_is_the_papers_law(model: RobotModel) -> None:
    rig, law = Rig(model, PAPER), make_law(PAPER)
    rng = np.random.default_rng(19)
    for state in states_near_stance(
        model, count=STATES, seed=20, spread=SPREAD, speed=SPEED
    ):
        rig.go(state)
        F_id, e_F = 100.0 * rng.normal(size=12), ERROR * rng.normal(size=12)
        r = answer(law, rig, F_id + e_F, F_id=F_id)
        np.testing.assert_allclose(r, paper_law(rig, e_F), rtol=1e-9, atol=TOLERANCE)


def test_each_axis_has_its_own_gain(model: RobotModel) -> None:
    k_force = (-10.0, -20.0, -30.0, -40.0, -50.0, -60.0)
    settings = settings_with(
        ground={"gain": NO_GAIN}, dik={"stance_leak": 0.0, "k_force": k_force}
    )
    rig, law = Rig(model, settings), make_law(settings)
    rig.go(nominal_state(model))
    for axis in range(12):
        e_F = np.zeros(12)
        e_F[axis] = ERROR[axis]
        r = answer(law, rig, e_F)
        expected = (
            -rig.dynamics.Lambda_c_inv[:, axis] * ERROR[axis] / (k_force * 2)[axis]
        )
        np.testing.assert_allclose(r, expected, atol=TOLERANCE)


def test_yielding_is_no_faster_than_its_limits(model: RobotModel) -> None:
    rig, law = Rig(model, PAPER), make_law(PAPER)
    rng = np.random.default_rng(21)
    dik = PAPER.dik
    limit = np.array(([dik.yield_limit_m_s] * 3 + [dik.yield_limit_rad_s] * 3) * 2)
    rig.go(nominal_state(model))
    for _ in range(STATES):
        e_F = 1e5 * rng.normal(size=12)
        r = answer(law, rig, e_F)
        assert (np.abs(r) <= limit + TOLERANCE).all()
        np.testing.assert_array_equal(np.sign(r), np.sign(paper_law(rig, e_F)))


@FEET
def test_leak_pulls_every_foot_back_to_its_stance(
    model: RobotModel, in_contact: list[bool]
) -> None:
    """Along the sole and about the vertical, whether the foot stands or not."""
    settings = settings_with(ground={"gain": NO_GAIN})
    rig, law, without = Rig(model, settings), make_law(settings), make_law(PAPER)
    for state in states_near_stance(
        model, count=STATES, seed=22, spread=SPREAD, speed=0.0
    ):
        dynamics = rig.go(state)
        pull, own = (
            answer(each, rig, NOTHING, in_contact=in_contact).copy()
            for each in (law, without)
        )
        pull -= own
        for side, rows in enumerate(SOLE_ROWS):
            R = dynamics.R_world_sole[side]
            yaw = np.arctan2(R[1, 0], R[0, 0])
            offset = rig.stance.p_sole[side] - dynamics.p_sole[side]
            offset[2] = 0.0
            leak = settings.dik.stance_leak
            expected = np.zeros(6)
            expected[:2] = leak * (R.T @ offset)[:2]
            expected[5] = -leak * (yaw - rig.stance.yaw_sole[side])
            np.testing.assert_allclose(pull[rows], expected, atol=TOLERANCE)


@LIFTED
def test_lifted_foot_comes_down_along_the_vertical_of_the_world(
    model: RobotModel, side: int
) -> None:
    rig, law = Rig(model, PAPER), make_law(PAPER)
    rows = SOLE_ROWS[side]
    in_contact = [RIGHT, LEFT][side]
    rng = np.random.default_rng(23)
    for state in states_near_stance(
        model, count=STATES, seed=24, spread=SPREAD, speed=SPEED
    ):
        dynamics = rig.go(state)
        r = answer(law, rig, ERROR * rng.normal(size=12), in_contact=in_contact)
        down = dynamics.R_world_sole[side] @ r[rows][:3]
        np.testing.assert_allclose(down[:2], 0.0, atol=TOLERANCE)
        assert -PAPER.contact.descent_limit_m_s - TOLERANCE <= down[2] < 0.0
        np.testing.assert_array_equal(r[rows][3:], 0.0)


@LIFTED
def test_descent_slows_as_the_ground_is_felt(model: RobotModel, side: int) -> None:
    rig, law = Rig(model, PAPER), make_law(PAPER)
    rig.go(nominal_state(model))
    wanted = PAPER.contact.search_force_n
    speeds = []
    for force in np.linspace(0.0, 1.5 * wanted, 16):
        F_meas = np.zeros(12)
        F_meas[NORMAL_ROWS[side]] = force
        r = answer(law, rig, F_meas, in_contact=[RIGHT, LEFT][side])
        speeds.append(-r[NORMAL_ROWS[side]])
        assert (speeds[-1] > 0.0) == (force < wanted)
    assert (np.diff(speeds) <= 0.0).all()


@LIFTED
def test_descent_is_no_faster_than_its_limit(model: RobotModel, side: int) -> None:
    """However hard the foot is to press in the end."""
    settings = settings_with(
        ground={"gain": NO_GAIN},
        dik={"stance_leak": 0.0},
        contact={"search_force_n": 1e5},
    )
    rig, law = Rig(model, settings), make_law(settings)
    rig.go(nominal_state(model))
    r = answer(law, rig, NOTHING, in_contact=[RIGHT, LEFT][side])
    assert -r[NORMAL_ROWS[side]] == pytest.approx(settings.contact.descent_limit_m_s)


@LIFTED
def test_what_a_lifted_foot_feels_does_not_move_the_other(
    model: RobotModel, side: int
) -> None:
    rig, law = Rig(model, PAPER), make_law(PAPER)
    rig.go(nominal_state(model))
    lifted, standing = SOLE_ROWS[side], SOLE_ROWS[1 - side]
    rng = np.random.default_rng(25)
    F_meas, answers = ERROR * rng.normal(size=12), []
    for _ in range(2):
        F_meas[lifted] = ERROR[lifted] * rng.normal(size=6)
        r = answer(law, rig, F_meas, in_contact=[RIGHT, LEFT][side])
        answers.append(r[standing].copy())
    np.testing.assert_array_equal(answers[0], answers[1])


def test_drives_with_lag_yield_less_while_a_foot_does_not_stand_firmly(
    model: RobotModel,
) -> None:
    """Without their inverse the loop must be slower than the lag."""
    rig = Rig(model, PAPER)
    rig.go(nominal_state(model))
    brisk, slow = (
        answer(make_law(PAPER, lag_s=lag_s), rig, ERROR).copy()
        for lag_s in (0.0, 2.0 * PAPER.dik.k_lag_s)
    )
    np.testing.assert_allclose(3.0 * slow, brisk, atol=TOLERANCE)


def standing(model: RobotModel) -> tuple[Rig, Array]:
    """Return a robot at rest on both feet, and the wrenches it stands with."""
    rig = Rig(model, PAPER)
    rig.go(nominal_state(model))
    load = np.zeros(12)
    load[[2, 8]] = 0.5 * model.mass * GRAVITY
    return rig, load


def test_drives_with_lag_yield_as_prompt_ones_once_the_feet_stand_firmly(
    model: RobotModel,
) -> None:
    rig, load = standing(model)
    prompt, slow = (make_law(PAPER, lag_s=lag_s) for lag_s in (0.0, 0.02))

    def told(law: ForceFeedback, F_meas: Array) -> Array:
        return answer(law, rig, F_meas, F_id=load).copy()

    pushed = load + ERROR
    wanted = told(prompt, pushed)
    np.testing.assert_allclose(told(slow, pushed), wanted, atol=TOLERANCE)
    told(slow, NOTHING)
    assert slow.firmness == 0.0
    np.testing.assert_allclose(
        3.0 * told(slow, pushed), wanted, rtol=0.01, atol=TOLERANCE
    )
    for _ in range(round(PAPER.dik.firm_again_s / 0.001)):
        told(slow, pushed)
    np.testing.assert_allclose(told(slow, pushed), wanted, atol=TOLERANCE)


@pytest.mark.parametrize("part", [0.0, 0.6, 1.0])
def test_slow_drives_keep_part_of_their_inverse_whatever_the_feet_do(
    model: RobotModel, part: float
) -> None:
    """All of it while both stand firmly; a foot on the way never does."""
    rig, load = standing(model)
    lag_s = 0.02
    law = make_law(settings_with(dik={"least_inverse": part}), lag_s=lag_s)

    def go_on(F_meas: Array, *, walks: bool) -> float:
        law.walks = walks
        answer(law, rig, F_meas, F_id=load)
        return law.inverse

    assert go_on(load, walks=False) == 1.0
    firm_lead = law.lead
    for walks, F_meas in ((False, 0.0 * load), (True, load), (True, 0.0 * load)):
        assert go_on(F_meas, walks=walks) == part
        assert law.lead - firm_lead == pytest.approx((1.0 - part) * lag_s / 0.001)
    go_on(load, walks=False)
    assert law.firmness < 1.0
    assert law.inverse == max(part, law.firmness)


@LIFTED
def test_old_forces_do_not_slow_the_search_for_the_ground(
    model: RobotModel, side: int
) -> None:
    """K grows with their age, too, and the robot tips over meanwhile."""
    rig = Rig(model, PAPER)
    rig.go(nominal_state(model))
    law = make_law(PAPER, speed=450.0)
    speeds = []
    for forces_s in (0.0, 0.01):
        law.expect_age(forces_s=forces_s, motion_s=0.0)
        r = answer(law, rig, NOTHING, in_contact=[RIGHT, LEFT][side])
        speeds.append(r[NORMAL_ROWS[side]])
    assert law.stiffness > 5.0
    assert speeds[0] == speeds[1] < 0.0


def test_a_light_robot_on_both_feet_stands_firmly(model: RobotModel) -> None:
    """Half its weight is less than a foot of the Walker carries when it stands."""
    rig, load = standing(model)
    law = make_law(PAPER, lag_s=0.02, weight=0.1 * model.weight)
    answer(law, rig, 0.1 * load, F_id=0.1 * load)
    assert law.firmness == 1.0
    assert law.share == [1.0, 1.0]


@LIFTED
def test_a_heavy_robot_reaches_for_more(model: RobotModel, side: int) -> None:
    rig = Rig(model, PAPER)
    rig.go(nominal_state(model))
    speeds = [
        answer(
            make_law(PAPER, weight=weights * model.weight),
            rig,
            NOTHING,
            in_contact=[RIGHT, LEFT][side],
        )[NORMAL_ROWS[side]]
        for weights in (0.3, 1.0, 2.0)
    ]
    assert speeds[0] == speeds[1]
    assert speeds[2] < 1.9 * speeds[1] < 0.0


@LIFTED
def test_slow_drives_look_for_the_ground_as_fast_as_others(
    model: RobotModel, side: int
) -> None:
    """K grows with their lag for feet on the ground; there is none around this one."""
    rig = Rig(model, PAPER)
    rig.go(nominal_state(model))
    speeds = []
    for lag_s in (0.0, 0.05):
        r = answer(
            make_law(PAPER, lag_s=lag_s), rig, NOTHING, in_contact=[RIGHT, LEFT][side]
        )
        speeds.append(-r[NORMAL_ROWS[side]])
    assert speeds[1] == pytest.approx(speeds[0])
