"""The dense QP: optimality, and failure as a value."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.schemas.arrays import Array, Mat
from surefoot.stabilizer.qp import SOLVED, DenseQp
from tests.stabilizer.kkt import kkt_residuals

N, M = 12, 9
PROBLEMS = 40
KKT_TOLERANCE = 1e-6
SAME_ANSWER = 1e-6
SAME_COST = 1e-6
TOUCH = 1e-7
"""More than what an unconstrained minimum may violate, yet next to nothing."""


def random_spd(rng: np.random.Generator, n: int) -> Mat:
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


def fill(qp: DenseQp, rng: np.random.Generator, *, room: float) -> None:
    """A feasible problem: ``room`` from a random point to each of its limits."""
    inside = rng.normal(size=N)
    qp.P[:] = random_spd(rng, N)
    qp.q_lin[:] = 10.0 * rng.normal(size=N)
    qp.G[:] = rng.normal(size=(M, N))
    qp.h_u[:] = qp.G @ inside + room * rng.uniform(0.1, 1.0, size=M)
    qp.x_l[:] = inside - room
    qp.x_u[:] = inside + room


def cost(qp: DenseQp, x: Array) -> float:
    return float(0.5 * x @ qp.P @ x + qp.q_lin @ x)


@pytest.fixture
def qp() -> DenseQp:
    return DenseQp("test", n=N, m=M)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def test_wide_limits_leave_the_unconstrained_minimum(
    qp: DenseQp, rng: np.random.Generator
) -> None:
    for _ in range(PROBLEMS):
        fill(qp, rng, room=1e4)
        solution = qp.solve()
        assert solution.ok
        assert not solution.constrained
        np.testing.assert_allclose(
            solution.x, np.linalg.solve(qp.P, -qp.q_lin), atol=SAME_ANSWER
        )
        assert kkt_residuals(qp, solution).worst < KKT_TOLERANCE


def test_tight_limits_meet_the_kkt_conditions(
    qp: DenseQp, rng: np.random.Generator
) -> None:
    for _ in range(PROBLEMS):
        fill(qp, rng, room=0.1)
        solution = qp.solve()
        assert solution.ok
        assert solution.constrained
        assert kkt_residuals(qp, solution).worst < KKT_TOLERANCE
        assert np.abs(solution.z_box).max() + solution.z.max() > KKT_TOLERANCE


def test_both_ways_agree_where_a_limit_just_touches(
    qp: DenseQp, rng: np.random.Generator
) -> None:
    """A limit through the unconstrained minimum costs nothing.

    Compared by cost: in x an interior point stops the root of its tolerance short
    of a limit that touches without pressing.
    """
    for _ in range(PROBLEMS):
        fill(qp, rng, room=1e4)
        free = qp.solve().x.copy()
        qp.h_u[0] = qp.G[0] @ free - TOUCH
        touching = qp.solve()
        assert touching.ok
        assert touching.constrained
        assert cost(qp, touching.x) == pytest.approx(cost(qp, free), rel=SAME_COST)


def test_only_a_box_is_a_problem_too(rng: np.random.Generator) -> None:
    qp = DenseQp("box", n=N, m=0)
    qp.P[:] = random_spd(rng, N)
    qp.q_lin[:] = 10.0 * rng.normal(size=N)
    qp.x_l[: N // 2], qp.x_u[: N // 2] = -0.1, 0.1
    solution = qp.solve()
    assert solution.constrained
    assert kkt_residuals(qp, solution).worst < KKT_TOLERANCE


@pytest.mark.parametrize("array", ["P", "q_lin", "G", "h_u", "x_l", "x_u"])
@pytest.mark.parametrize("room", [1e4, 0.1])
def test_nan_is_a_status(
    qp: DenseQp, rng: np.random.Generator, array: str, room: float
) -> None:
    fill(qp, rng, room=room)
    getattr(qp, array).flat[0] = np.nan
    solution = qp.solve()
    assert not solution.ok
    assert solution.status


def test_nan_in_a_problem_with_only_a_box_is_a_status() -> None:
    qp = DenseQp("box", n=N, m=0)
    qp.q_lin[0] = np.nan
    assert not qp.solve().ok


def test_contradiction_is_a_status(qp: DenseQp, rng: np.random.Generator) -> None:
    fill(qp, rng, room=1.0)
    qp.G[1], qp.h_u[1] = -qp.G[0], -qp.h_u[0] - 1.0
    solution = qp.solve()
    assert not solution.ok
    assert "infeasible" in solution.status


@pytest.mark.parametrize("how", ["nan", "contradiction"])
def test_next_good_problem_is_solved_as_if_nothing_had_been(how: str) -> None:
    scarred, fresh = DenseQp("test", n=N, m=M), DenseQp("test", n=N, m=M)
    answers: list[Array] = []
    for qp in (scarred, fresh):
        fill(qp, np.random.default_rng(8), room=0.1)
    if how == "nan":
        scarred.q_lin[:] = np.nan
    else:
        scarred.G[1], scarred.h_u[1] = -scarred.G[0], -scarred.h_u[0] - 1.0
    assert not scarred.solve().ok
    for qp in (scarred, fresh):
        fill(qp, np.random.default_rng(8), room=0.1)
        solution = qp.solve()
        assert solution.status == SOLVED
        answers.append(solution.x.copy())
    np.testing.assert_allclose(answers[0], answers[1], atol=SAME_ANSWER)


def test_kept_problem_fails_again_on_replay(
    qp: DenseQp, rng: np.random.Generator
) -> None:
    fill(qp, rng, room=1.0)
    qp.G[1], qp.h_u[1] = -qp.G[0], -qp.h_u[0] - 1.0
    status = qp.solve().status
    kept = qp.data(status)
    fill(qp, rng, room=1.0)
    replay = DenseQp(kept.name, n=N, m=M)
    for name in ("P", "q_lin", "G", "h_u", "x_l", "x_u"):
        getattr(replay, name)[:] = getattr(kept, name)
    assert replay.solve().status == kept.status == status
