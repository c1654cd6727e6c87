"""The first QP's solution solves the problem of the paper."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from surefoot.schemas.arrays import Array
from surefoot.schemas.law_settings import TsidSettings
from surefoot.stabilizer.model import N_BASE_V
from surefoot.stabilizer.qp import QpSolution
from tests.stabilizer.rig import CONTACT_NAMES, CONTACT_SETS, Rig
from tests.stabilizer.same_answer import DUALITY_GAP, assert_same_answer
from tests.stabilizer.states import states_near_stance
from tests.stabilizer.uncondensed_tsid import solve_uncondensed

STATES = 25
KKT_TOLERANCE = 1e-6
SAME_FORCE_N = float(np.sqrt(2.0 * DUALITY_GAP / TsidSettings().force_weight))
"""Change of a wrench that a duality gap allows if only its own weight acts."""
BALANCE = 1e-7
"""Residual of the equations of motion [N, N m] and of feet at rest [m/s^2]."""


@dataclass(frozen=True)
class Spread:
    """Spread of random states around the stance [m, rad], and of speeds."""

    position: float
    speed: float


CALM = Spread(position=0.005, speed=0.01)
"""No limit is active, so the unconstrained path is taken."""
LIVELY = Spread(position=0.05, speed=0.2)
WILD = Spread(position=0.15, speed=0.5)
"""Cones and torque limits are active nearly everywhere."""
SPREADS = pytest.mark.parametrize(
    "spread", [CALM, LIVELY, WILD], ids=["calm", "lively", "wild"]
)
FEET = pytest.mark.parametrize("in_contact", CONTACT_SETS, ids=CONTACT_NAMES)


def solutions(rig: Rig, spread: Spread, in_contact: list[bool]) -> Iterator[QpSolution]:
    """Solve at random states with random references; the rig stays at each."""
    rng = np.random.default_rng(10)
    for state in states_near_stance(
        rig.model, count=STATES, seed=9, spread=spread.position, speed=spread.speed
    ):
        rig.ask(rng, position=spread.position, speed=spread.speed)
        rig.go(state)
        solution = rig.solve_tsid(in_contact)
        assert solution.ok, solution.status
        yield solution


def standing_rows(in_contact: list[bool]) -> list[int]:
    """Return the rows of the standing feet in stacked contact quantities."""
    return [row for row in range(12) if in_contact[row // 6]]


def acceleration(rig: Rig, solution: QpSolution) -> Array:
    qdd: Array = rig.tsid.A @ solution.x + rig.tsid.b
    return qdd


@FEET
@SPREADS
def test_it_is_the_papers_problem_solved(
    rig: Rig, spread: Spread, in_contact: list[bool]
) -> None:
    """That is (qdd, tau, F), with the dynamics and the feet at rest as equalities."""
    rows, dynamics = standing_rows(in_contact), rig.dynamics
    S = np.eye(rig.model.n_v)[N_BASE_V:]
    found = []
    for solution in solutions(rig, spread, in_contact):
        found.append(solution)
        residuals = solution.residuals()
        assert residuals.worst < KKT_TOLERANCE, residuals
        tau, F_id, paper = solution.x, rig.tsid.F_id, solve_uncondensed(rig, in_contact)
        np.testing.assert_allclose(F_id[rows], paper.F, rtol=0.0, atol=SAME_FORCE_N)
        assert_same_answer(rig.tsid.problem(in_contact).P, tau, paper.tau)
        np.testing.assert_array_equal(rig.tsid.tau, tau)
        qdd = acceleration(rig, solution)
        moved = dynamics.inertia_matrix() @ qdd + dynamics.c
        pushed = S.T @ tau + dynamics.J_contact.T @ F_id
        np.testing.assert_allclose(moved, pushed, atol=BALANCE)
        at_soles = dynamics.J_contact @ qdd + dynamics.Jdot_v_contact
        np.testing.assert_allclose(at_soles[rows], 0.0, atol=BALANCE)
    # Both ways to solve it are among them, and both kinds of multipliers.
    constrained = sum(solution.constrained for solution in found)
    if spread is CALM:  # on one foot, its sole's edge is near in most states
        assert constrained == 0 if all(in_contact) else 0 < constrained < STATES
    if spread is WILD:
        assert constrained > STATES // 2
        assert max(np.abs(s.z_box).max() for s in found) > KKT_TOLERANCE
        assert max(s.z.max() for s in found) > KKT_TOLERANCE
