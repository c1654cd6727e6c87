"""The second QP's solution solves the problem of the paper."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from surefoot.schemas.arrays import Array
from surefoot.stabilizer.model import N_BASE_V
from surefoot.stabilizer.qp import QpSolution
from tests.stabilizer.explicit_dik import solve_explicit
from tests.stabilizer.rig import Rig
from tests.stabilizer.states import states_near_stance

STATES = 25
SPREAD, SPEED = 0.1, 0.5
KKT_TOLERANCE = 1e-6
SAME_VELOCITY = 1e-4
"""Tolerance of a velocity [m/s, rad/s]."""
SLOW, FAST = 0.05, 1.0
"""Spread of the wanted sole twists: feasible, and beyond the joints' limits."""
TWISTS = pytest.mark.parametrize("twist", [SLOW, FAST], ids=["slow", "fast"])


def solutions(rig: Rig, twist: float) -> Iterator[tuple[QpSolution, Array, Array]]:
    """Yield solution, wanted twists and command at random states and references.

    Twists are fast, and every third joint's command is at an end of its range.
    """
    rng = np.random.default_rng(13)
    model, settings = rig.model, rig.settings.dik
    ends = np.array([model.lower, model.upper])
    inside = settings.limit_margin_rad * np.array([1.0, -1.0])
    for state in states_near_stance(
        model, count=STATES, seed=14, spread=SPREAD, speed=SPEED
    ):
        rig.ask(rng, position=SPREAD, speed=twist)
        rig.go(state)
        r = twist * rng.normal(size=12)
        q_command = state.q[7:].copy()
        if twist == FAST:
            end = rng.integers(2, size=model.n_a)
            limits = ends[end, np.arange(model.n_a)] + inside[end]
            q_command[::3] = limits[::3]
        solution = rig.solve_dik(r, q_command=q_command)
        assert solution.ok, solution.status
        yield solution, r, q_command


@TWISTS
def test_it_is_the_papers_problem_solved(rig: Rig, twist: float) -> None:
    """Eliminating Delta changes nothing, and the base is never limited."""
    constrained = []
    for solution, r, q_command in solutions(rig, twist):
        constrained.append(solution.constrained)
        residuals = solution.residuals()
        assert residuals.worst < KKT_TOLERANCE, residuals
        np.testing.assert_array_equal(solution.z_box[:N_BASE_V], 0.0)
        v = solve_explicit(rig, r, q_command=q_command)
        np.testing.assert_allclose(solution.x, v, rtol=0.0, atol=SAME_VELOCITY)
    # Both ways to solve it are among them.
    assert all(constrained) if twist == FAST else sum(constrained) < STATES // 2
