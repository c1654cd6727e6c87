"""Fills a QP anew, and compares two solutions with a tolerance of its own."""

from __future__ import annotations

import numpy as np

from surefoot.schemas.arrays import Array, Mat
from surefoot.stabilizer.qp import DenseQp, QpData, QpSolver

SOLVER_RESIDUAL, DUALITY_GAP = 1e-9, 1e-10
"""Tolerances that PIQP is given."""


def filled(problem: QpData | DenseQp, solver: QpSolver | None = None) -> DenseQp:
    """Return the same problem for a solver that has solved nothing yet."""
    m, n = problem.G.shape
    other = DenseQp(problem.name, n=n, m=m, solver=solver)
    for name in ("P", "q_lin", "G", "h_u", "x_l", "x_u"):
        getattr(other, name)[:] = getattr(problem, name)
    return other


def assert_same_answer(P: Mat, one: Array, other: Array) -> None:
    """Check that two solutions of a QP are as near as its conditioning allows.

    Each solution has a stationarity residual of at most r and a duality gap of at most
    g. Their difference d then obeys d^T P d <= 2 r |d| + 2 g. So its length in the
    metric of P is at most 2 r / sqrt(least eigenvalue) + sqrt(2 g): tight where the
    cost is steep, wide where it is flat. Rounding adds a residual eps |P| |x|, since
    each BLAS rounds in its own order.

    Args:
        P: (n, n) quadratic cost.
        one: (n,) solution.
        other: (n,) solution.
    """
    eigenvalues = np.linalg.eigvalsh(P)
    rounding = np.finfo(float).eps * eigenvalues[-1] * float(np.linalg.norm(one))
    residual = SOLVER_RESIDUAL + rounding
    apart = 2.0 * residual / np.sqrt(eigenvalues[0]) + np.sqrt(2.0 * DUALITY_GAP)
    d = one - other
    assert np.sqrt(d @ P @ d) <= apart
