"""When two answers to one QP are the same: as near as its conditioning lets them be."""

from __future__ import annotations

import numpy as np

from surefoot.schemas.arrays import Array, Mat

SOLVER_RESIDUAL, DUALITY_GAP = 1e-9, 1e-10
"""What PIQP is asked for."""


def assert_same_answer(P: Mat, one: Array, other: Array) -> None:
    """Two answers to one problem are as near as its conditioning lets them be.

    Each solves it up to a stationarity residual r and a duality gap g. Then for their
    difference d: d^T P d <= 2 r |d| + 2 g, so its length in the metric of P is at most
    2 r / sqrt(least eigenvalue) + sqrt(2 g): tight where the cost is steep, wide along
    what it hardly weighs. Rounding is a residual, too, eps |P| |x|; each BLAS rounds in
    an order of its own.

    Args:
        P: (n, n) the quadratic cost.
        one: (n,) answer.
        other: (n,) answer.
    """
    eigenvalues = np.linalg.eigvalsh(P)
    rounding = np.finfo(float).eps * eigenvalues[-1] * float(np.linalg.norm(one))
    residual = SOLVER_RESIDUAL + rounding
    apart = 2.0 * residual / np.sqrt(eigenvalues[0]) + np.sqrt(2.0 * DUALITY_GAP)
    d = one - other
    assert np.sqrt(d @ P @ d) <= apart
