"""Postures on two feet: derivatives, ground and reach."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.robot_io.robot import load_robot
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.stance.legs import (
    ONE_FOOT_SHARE,
    find_leg,
    one_foot_share,
    one_foot_sink,
)
from surefoot.stabilizer.stance.nominal import KNEE_ROOM_RAD, find_nominal
from surefoot.stabilizer.stance.solver import (
    Ground,
    GroundPose,
    ReachSearch,
    StanceSolver,
    Wanted,
)
from tests.support import with_knees

MODEL = RobotModel(load_robot("walker"))
APART_M = 0.22
STEP_RAD = 1e-6


def solver() -> StanceSolver:
    return StanceSolver(
        MODEL.pin_model,
        MODEL.sole_ids,
        R_world_base=np.eye(3),
        lower=MODEL.lower,
        upper=MODEL.upper,
        is_leg=MODEL.is_leg,
    )


def test_the_jacobian_is_the_derivative_of_what_a_posture_must_do() -> None:
    rng = np.random.default_rng(3)
    q = rng.uniform(-0.3, 0.3, MODEL.n_a)
    wanted = Wanted(
        q=np.zeros(MODEL.n_a),
        between=np.array([0.0, APART_M, 0.02]),
        com_height_m=0.7,
        turned=((0.1, 0.05), (-0.1, 0.0)),
    )
    tried = solver()
    steps = STEP_RAD * np.eye(MODEL.n_a)
    differences = np.column_stack(
        [
            (tried._residual(q + e, wanted) - tried._residual(q - e, wanted))
            / (2.0 * STEP_RAD)
            for e in steps
        ]
    )
    tried._residual(q, wanted)
    np.testing.assert_allclose(tried._jacobian(q, wanted), differences, atol=1e-5)


def test_the_walkers_knee_is_found_and_its_leg_is_as_long_as_its_bones() -> None:
    leg = find_leg(
        MODEL.pin_model,
        MODEL.sole_ids[0],
        lower=MODEL.lower,
        upper=MODEL.upper,
        side="left",
    )
    assert MODEL.pin_model.names[leg.knee] == "left_knee"
    assert leg.longest == pytest.approx(0.29 + 0.275, abs=5e-3)
    assert leg.bends == 1.0


@pytest.mark.parametrize(
    ("height_m", "left", "right"),
    [(0.06, (0.0, 0.0), (0.0, 0.0)), (-0.06, (0.1, 0.0), (-0.1, 0.05))],
)
def test_a_posture_on_moved_ground_has_its_soles_on_it(
    height_m: float, left: tuple[float, float], right: tuple[float, float]
) -> None:
    p_left, p_right, com = solver().place(MODEL.nominal)
    height = float(com[2] - 0.5 * (p_left[2] + p_right[2])) - height_m
    between = np.array([0.0, APART_M, 0.01])
    found = solver().solve(
        Wanted(
            q=MODEL.nominal,
            between=between,
            com_height_m=height,
            turned=(left, right),
        )
    )
    assert found.is_good
    p_left, p_right, com = solver().place(found.q)
    np.testing.assert_allclose(p_left - p_right, between, atol=2e-3)
    middle = 0.5 * (p_left + p_right)
    np.testing.assert_allclose(com - middle, [0.0, 0.0, height], atol=2e-3)
    assert np.all(found.q >= MODEL.lower - 1e-6)
    assert np.all(found.q <= MODEL.upper + 1e-6)
    arms = ~MODEL.is_leg
    np.testing.assert_allclose(found.q[arms], MODEL.nominal[arms], atol=0.05)


def test_the_walker_reaches_what_its_scenarios_ask_for() -> None:
    search = ReachSearch(solver(), MODEL.nominal)
    assert search.fits(Ground(GroundPose(z=-0.06, roll=np.radians(8.6))))
    assert not search.fits(Ground(GroundPose(z=-0.3)))
    share = search.largest_share([Ground(GroundPose(z=-0.2))])
    assert share == pytest.approx(0.49, abs=0.1)
    apart = Ground(GroundPose(z=0.05), GroundPose(z=-0.05))
    assert search.fits(apart)
    assert not search.fits(apart.scaled(6.0))


def test_knees_are_bent_for_the_travel_and_never_straight() -> None:
    found = find_nominal(
        MODEL.pin_model, MODEL.sole_ids, R_world_base=np.eye(3), apart_m=APART_M
    )
    assert found.knee_angle(0) == pytest.approx(found.knee_angle(1), abs=1e-3)
    assert 1.1 < found.knee_angle(0) < 1.5
    leg = found.legs[0]
    assert found.lower[leg.knee_index] >= leg.straight + KNEE_ROOM_RAD - 1e-9
    sink, rise = found.com_travel_m
    assert sink < -0.1
    assert rise > 0.05


@pytest.mark.parametrize("share", [0.45, 0.5, 0.6])
def test_a_knee_that_carries_all_bends_until_its_torque_ends(share: float) -> None:
    weak = RobotModel(with_knees(load_robot("walker"), share))
    depth = one_foot_sink(weak)
    bent = {}
    for side, sole_id in zip(("left", "right"), weak.sole_ids, strict=True):
        leg = find_leg(
            weak.pin_model, sole_id, lower=weak.lower, upper=weak.upper, side=side
        )
        now = np.interp(weak.nominal[leg.knee_index], leg.angles, leg.lengths)
        bent[leg.knee_index] = leg.bent((now - depth) / leg.longest)
    found = solver().solve(
        Wanted(q=weak.nominal, between=np.array([0.0, APART_M, 0.0]), joints=bent)
    )
    weak.nominal = found.q
    assert one_foot_share(weak) == pytest.approx(ONE_FOOT_SHARE, abs=0.03)


def test_a_knee_at_its_end_already_may_not_bend_at_all() -> None:
    depths = [
        one_foot_sink(RobotModel(with_knees(load_robot("walker"), share)))
        for share in (0.4, 0.45, 0.6, 1.0)
    ]
    assert depths[0] == 0.0
    assert depths == sorted(depths)
    assert depths[-1] > -MODEL.com_travel[0]  # the Walker's own are never the limit
