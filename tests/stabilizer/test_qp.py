"""The dense QP: optimality, and failure as a value."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from surefoot.schemas.arrays import Array, Mat
from surefoot.stabilizer.qp import DenseQp, QpSolution, QpStatus, SolverAnswer
from tests.stabilizer.least_distance import LeastDistanceSolver
from tests.stabilizer.same_answer import filled

N, M = 12, 9
ARRAYS = ("P", "q_lin", "G", "h_u", "x_l", "x_u")
PROBLEMS = 40
KKT_TOLERANCE = 1e-6
SAME_ANSWER = 1e-6
SAME_COST = 1e-6
SAME_MULTIPLIER = 1e-5
TOUCH = 1e-7
"""More than an unconstrained minimum may violate, but tiny."""


def random_spd(rng: np.random.Generator, n: int) -> Mat:
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


def fill(qp: DenseQp, rng: np.random.Generator, *, room: float) -> None:
    """Fill a feasible problem; ``room`` is a random point's distance to each limit."""
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
        assert solution.residuals().worst < KKT_TOLERANCE


def test_tight_limits_meet_the_kkt_conditions(
    qp: DenseQp, rng: np.random.Generator
) -> None:
    for _ in range(PROBLEMS):
        fill(qp, rng, room=0.1)
        solution = qp.solve()
        assert solution.ok
        assert solution.constrained
        assert solution.residuals().worst < KKT_TOLERANCE
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
    assert solution.residuals().worst < KKT_TOLERANCE


@pytest.mark.parametrize("array", ARRAYS)
@pytest.mark.parametrize("room", [1e4, 0.1])
def test_nan_is_a_status(
    qp: DenseQp, rng: np.random.Generator, array: str, room: float
) -> None:
    fill(qp, rng, room=room)
    getattr(qp, array).flat[0] = np.nan
    solution = qp.solve()
    assert solution.status is QpStatus.NOT_FINITE


def test_contradiction_is_a_status(qp: DenseQp, rng: np.random.Generator) -> None:
    fill(qp, rng, room=1.0)
    qp.G[1], qp.h_u[1] = -qp.G[0], -qp.h_u[0] - 1.0
    solution = qp.solve()
    assert solution.status is QpStatus.PRIMAL_INFEASIBLE


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
        assert solution.status is QpStatus.OK
        answers.append(solution.x.copy())
    np.testing.assert_allclose(answers[0], answers[1], atol=SAME_ANSWER)


def test_another_solver_gives_the_same_answers(
    qp: DenseQp, rng: np.random.Generator
) -> None:
    """An active-set method and PIQP, in x and in every multiplier."""
    solver = LeastDistanceSolver()
    for _ in range(PROBLEMS):
        fill(qp, rng, room=0.3)
        other = filled(qp, solver).solve()
        mine = qp.solve()
        assert mine.ok
        assert other.ok
        assert other.residuals().worst < KKT_TOLERANCE
        np.testing.assert_allclose(mine.x, other.x, atol=SAME_ANSWER)
        for name in ("z", "z_box"):
            np.testing.assert_allclose(
                getattr(mine, name), getattr(other, name), atol=SAME_MULTIPLIER
            )
    assert solver.solved == PROBLEMS


def test_another_solvers_failure_is_a_status_too(
    qp: DenseQp, rng: np.random.Generator
) -> None:
    fill(qp, rng, room=1.0)
    qp.G[1], qp.h_u[1] = -qp.G[0], -qp.h_u[0] - 1.0
    solution = filled(qp, LeastDistanceSolver()).solve()
    assert solution.status is QpStatus.PRIMAL_INFEASIBLE
    assert solution.problem.data(solution.status).status == "primal infeasible"


def test_a_solver_runs_only_where_limits_press(
    qp: DenseQp, rng: np.random.Generator
) -> None:
    solver = LeastDistanceSolver()
    for room, expected in ((1e4, 0), (0.1, 1)):
        fill(qp, rng, room=room)
        assert filled(qp, solver).solve().ok
        assert solver.solved == expected


class Claim:
    """A solver that returns a given answer, with its status as plain text."""

    def __init__(self, x: list[float], z: float, z_box: list[float]) -> None:
        status: Any = "ok"
        self._answer = SolverAnswer(status, np.array(x), np.array([z]), np.array(z_box))

    def solve(self, qp: DenseQp) -> SolverAnswer:
        return self._answer


def claimed(x: list[float], z: float, z_box: list[float]) -> QpSolution:
    """Claim a solution of: the point nearest to (2, 3) with x_0 <= 1 and x_1 <= 2.

    x_0 <= 1 is a row of G, x_1 <= 2 a bound. x_0 has no bounds, x_1 no lower one.
    """
    qp = DenseQp("point", n=2, m=1, solver=Claim(x, z, z_box))
    qp.q_lin[:] = [-2.0, -3.0]
    qp.G[0, 0] = 1.0
    qp.x_u[1] = 2.0
    return qp.solve()


@pytest.mark.parametrize(
    ("x", "z", "z_box", "residuals"),
    [
        pytest.param([1.0, 2.0], 1.0, [0.0, 1.0], (0.0, 0.0, 0.0), id="optimum"),
        # By hand; gradient x - (2, 3) + (z, 0) + z_box.
        pytest.param([1.5, 2.0], 0.5, [0.0, 1.0], (0.5, 0.0, 0.25), id="beyond G"),
        pytest.param([1.0, 2.5], 1.0, [0.0, 0.5], (0.5, 0.0, 0.25), id="beyond box"),
        pytest.param([0.5, 2.0], 1.5, [0.0, 1.0], (0.0, 0.0, 0.75), id="not pressing"),
        pytest.param([1.0, 1.0], 1.0, [0.0, 2.0], (0.0, 0.0, 2.0), id="not at bound"),
        pytest.param([1.0, 2.0], 1.2, [0.0, 1.0], (0.0, 0.2, 0.0), id="gradient"),
        pytest.param([2.5, 2.0], -0.5, [0.0, 1.0], (1.5, 0.5, 0.75), id="pulling"),
        pytest.param([1.0, 2.0], 0.6, [0.4, 1.0], (0.0, 0.4, 0.0), id="no upper bound"),
        pytest.param([1.0, 2.0], 1.3, [-0.3, 1.0], (0.0, 0.3, 0.0), id="no lower one"),
    ],
)
def test_residuals_tell_what_is_wrong(
    x: list[float], z: float, z_box: list[float], residuals: tuple[float, ...]
) -> None:
    solution = claimed(x, z, z_box)
    assert solution.constrained
    np.testing.assert_allclose(solution.residuals(), residuals, atol=1e-12)


@pytest.mark.parametrize(
    "nonsense",
    [([np.nan, 0.0], 0.0, [0.0, 0.0]), ([1.0, 2.0], np.nan, [0.0, 1.0])],
    ids=["x", "z"],
)
def test_residuals_of_nonsense_are_no_numbers_that_pass(
    nonsense: tuple[list[float], float, list[float]],
) -> None:
    assert not claimed(*nonsense).residuals().worst < KKT_TOLERANCE
