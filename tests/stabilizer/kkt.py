"""How far a QP's solution is from the conditions every optimum meets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surefoot.schemas.arrays import Array, Mat
from surefoot.stabilizer.qp import DenseQp, QpSolution

SOLVER_RESIDUAL, DUALITY_GAP = 1e-9, 1e-10
"""What PIQP is asked for."""


@dataclass(frozen=True)
class KktResiduals:
    """Largest violation of each condition of Karush, Kuhn and Tucker.

    With z the multipliers of G x <= h_u, and those of the box split by sign into
    z_u (upper bound) and z_l (lower bound), z_box = z_u - z_l:

    Attributes:
        stationarity: ``|P x + q_lin + G^T z + z_box|``.
        primal: how much G x exceeds h_u, or x the box.
        dual: how much a multiplier of G x <= h_u is under zero.
        complementarity: ``|z (h_u - G x)|``, ``|z_u (x_u - x)|``, ``|z_l (x - x_l)|``;
            a multiplier of a bound at infinity counts itself.
    """

    stationarity: float
    primal: float
    dual: float
    complementarity: float

    @property
    def worst(self) -> float:
        """Largest of all."""
        return max(self.stationarity, self.primal, self.dual, self.complementarity)


def kkt_residuals(qp: DenseQp, solution: QpSolution) -> KktResiduals:
    """Residuals of a solution of the problem that ``qp`` still holds."""
    x, z, z_box = solution.x, solution.z, solution.z_box
    slack = qp.h_u - qp.G @ x
    to_upper, to_lower = qp.x_u - x, x - qp.x_l
    gradient = qp.P @ x + qp.q_lin + qp.G.T @ z + z_box
    products = (
        z * slack,
        np.maximum(z_box, 0.0) * _or_one(to_upper),
        np.maximum(-z_box, 0.0) * _or_one(to_lower),
    )
    return KktResiduals(
        stationarity=_largest(np.abs(gradient)),
        primal=_largest(-np.concatenate((slack, to_upper, to_lower))),
        dual=_largest(-z),
        complementarity=_largest(np.abs(np.concatenate(products))),
    )


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


def _or_one(gap: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(gap), gap, 1.0)


def _largest(values: np.ndarray) -> float:
    """Largest value, zero at least; a NaN stays a NaN."""
    return float(np.max(values, initial=0.0))
