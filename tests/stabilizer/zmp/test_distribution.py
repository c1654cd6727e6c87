"""Distribution QP: optimality, cones, world origin, mirror image."""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin
import pytest

from surefoot.schemas.arrays import Array, Mat
from surefoot.schemas.law_settings import ZmpSettings
from surefoot.stabilizer.model import GRAVITY, RobotModel
from surefoot.stabilizer.zmp.distribution import (
    WrenchDistribution,
    centre_of_pressure,
    contact_plane,
    net_wrench,
    wrench_face_matrix,
    zero_moment_point,
)
from tests.stabilizer.rig import BOTH, CONTACT_NAMES, CONTACT_SETS
from tests.stabilizer.same_answer import assert_same_answer

KKT = 1e-6
IN_CONE = 1e-6
FORCE_N = 0.2
"""Error of the net force; ankles and load share have a small weight, too [N]."""
SHIFT_M = np.array([100.0, -100.0, 100.0])
SAMPLES = 30
MIRROR = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])


class Case:
    """Feet near the stance, and a desired net wrench."""

    def __init__(
        self, model: RobotModel, rng: np.random.Generator, push: float
    ) -> None:
        self.R: list[Mat] = [
            pin.rpy.rpyToMatrix(*rng.uniform(-0.15, 0.15, size=3)) for _ in range(2)
        ]
        self.p = [
            np.array([0.0, 0.1, 0.0]) + rng.uniform(-0.03, 0.03, size=3),
            np.array([0.0, -0.1, 0.0]) + rng.uniform(-0.03, 0.03, size=3),
        ]
        self.com = np.array([0.0, 0.0, 0.8])
        acceleration = push * rng.normal(size=3)
        self.wrench: Array = np.zeros(6)
        acceleration[2] += GRAVITY
        self.wrench[:3] = model.mass * acceleration


def solve(
    distribution: WrenchDistribution, case: Case, in_contact: list[bool] = BOTH
) -> Array:
    solution = distribution.solve(
        case.wrench,
        R_world_sole=case.R,
        p_sole=case.p,
        point=case.com,
        in_contact=in_contact,
    )
    assert solution is not None
    assert solution.ok
    residuals, qp = solution.residuals(), solution.problem
    assert max(residuals.primal, residuals.dual) < KKT
    # The gap is the sum of these products; costs here are millions.
    assert np.abs(solution.z * (qp.h_u - qp.G @ solution.x)).max() < KKT
    return distribution.F.copy()


@pytest.fixture
def distribution(model: RobotModel) -> WrenchDistribution:
    return WrenchDistribution(model, ZmpSettings())


def cases(model: RobotModel, push: float, seed: int) -> list[Case]:
    rng = np.random.default_rng(seed)
    return [Case(model, rng, push) for _ in range(SAMPLES)]


@pytest.mark.parametrize("in_contact", CONTACT_SETS, ids=CONTACT_NAMES)
@pytest.mark.parametrize("push", [0.2, 3.0, 10.0])
def test_solution_is_optimal_and_in_its_cones(
    model: RobotModel,
    distribution: WrenchDistribution,
    in_contact: list[bool],
    push: float,
) -> None:
    settings = ZmpSettings()
    for case in cases(model, push, seed=71):
        F = solve(distribution, case, in_contact)
        for side, foot in enumerate(model.robot.file.foot):
            wrench = F[6 * side : 6 * side + 6]
            if not in_contact[side]:
                np.testing.assert_array_equal(wrench, 0.0)
                continue
            cone = wrench_face_matrix(
                friction=settings.friction,
                half_length=settings.sole_scale * foot.half_length_m,
                half_width=settings.sole_scale * foot.half_width_m,
            )
            assert (cone @ wrench).max() <= IN_CONE * max(1.0, wrench[2])
            assert wrench[2] >= settings.min_ds_pressure_n - IN_CONE


def test_net_wrench_is_reached_where_the_feet_can(
    model: RobotModel, distribution: WrenchDistribution
) -> None:
    for case in cases(model, 0.2, seed=72):
        F = solve(distribution, case)
        net = net_wrench(F, case.R, case.p, case.com)
        np.testing.assert_allclose(net[:3], case.wrench[:3], atol=FORCE_N)
        np.testing.assert_allclose(net[3:], 0.0, atol=FORCE_N)


def test_standing_evenly_is_half_the_weight_each(
    model: RobotModel, distribution: WrenchDistribution
) -> None:
    case = Case(model, np.random.default_rng(0), 0.0)
    case.R = [np.eye(3), np.eye(3)]
    case.p = [np.array([0.0, 0.1, 0.0]), np.array([0.0, -0.1, 0.0])]
    F = solve(distribution, case)
    half = 0.5 * model.mass * GRAVITY
    np.testing.assert_allclose(F[[2, 8]], half, atol=FORCE_N)


def test_a_shifted_world_changes_nothing(
    model: RobotModel, distribution: WrenchDistribution
) -> None:
    for case in cases(model, 3.0, seed=73):
        here = solve(distribution, case)
        case.p = [p + SHIFT_M for p in case.p]
        case.com = case.com + SHIFT_M
        assert_same_answer(distribution.both.P, here, solve(distribution, case))


def test_mirrored_feet_get_mirrored_wrenches(
    model: RobotModel, distribution: WrenchDistribution
) -> None:
    S = np.diag([1.0, -1.0, 1.0])
    for case in cases(model, 3.0, seed=74):
        F = solve(distribution, case)
        case.R = [S @ R @ S for R in reversed(case.R)]
        case.p = [S @ p for p in reversed(case.p)]
        case.com = S @ case.com
        case.wrench = case.wrench * MIRROR
        mirrored = np.concatenate((MIRROR * F[6:], MIRROR * F[:6]))
        assert_same_answer(distribution.both.P, mirrored, solve(distribution, case))


def test_cone_holds_exactly_the_wrenches_of_forces_at_its_corners() -> None:
    """Any push of the four corners, each in its own friction pyramid, is inside."""
    rng = np.random.default_rng(75)
    mu, x, y = 0.7, 0.11, 0.06
    cone = wrench_face_matrix(friction=mu, half_length=x, half_width=y)
    assert cone.shape == (16, 6)
    corners = [np.array([a * x, b * y, 0.0]) for a in (-1, 1) for b in (-1, 1)]
    for _ in range(200):
        wrench = np.zeros(6)
        for corner in corners:
            normal = rng.uniform(0.0, 100.0)
            force = np.append(rng.choice([-1.0, 1.0], size=2) * mu * normal, normal)
            wrench[:3] += force
            wrench[3:] += np.cross(corner, force)
        assert (cone @ wrench).max() <= 1e-9


def test_cone_refuses_each_excess() -> None:
    cone = wrench_face_matrix(friction=0.7, half_length=0.11, half_width=0.06)
    largest = [0.7, 0.7, 0.0, 0.06, 0.11, 0.7 * 0.17]
    for index, sign in itertools.product((0, 1, 3, 4, 5), (-1.0, 1.0)):
        for scale, inside in ((0.99, True), (1.01, False)):
            wrench = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
            wrench[index] = sign * scale * largest[index]
            # Beside full friction no yaw moment is left, and none is asked here.
            assert ((cone @ wrench).max() <= 0.0) == inside


def test_centre_of_pressure_is_where_the_force_acts() -> None:
    point, force = np.array([0.03, -0.02, 0.0]), np.array([0.0, 0.0, 400.0])
    wrench = np.concatenate((force, np.cross(point, force)))
    assert centre_of_pressure(wrench) == pytest.approx((0.03, -0.02))


def test_zero_moment_point_lies_between_the_feets_pressures() -> None:
    """400 N under the left foot's middle, 200 N under the right one's."""
    R, p = [np.eye(3)] * 2, [np.array([0.0, 0.1, 0.0]), np.array([0.0, -0.1, 0.0])]
    F = np.zeros(12)
    F[2], F[8] = 400.0, 200.0
    for shift in (np.zeros(3), SHIFT_M):
        soles = [each + shift for each in p]
        plane = contact_plane(R, soles, BOTH)
        wrench = net_wrench(F, R, soles, plane.origin)
        zmp = zero_moment_point(wrench, plane, otherwise=np.zeros(3))
        np.testing.assert_allclose(zmp - shift, [0.0, 0.1 / 3.0, 0.0], atol=1e-10)


def test_without_force_the_point_is_the_given_one() -> None:
    plane = contact_plane([np.eye(3)] * 2, [np.zeros(3)] * 2, BOTH)
    nowhere = np.array([1.0, 2.0, 3.0])
    point = zero_moment_point(np.zeros(6), plane, otherwise=nowhere)
    np.testing.assert_array_equal(point, nowhere)
