"""How far a QP's solution is from the conditions every optimum meets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surefoot.stabilizer.qp import DenseQp, QpSolution


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


def _or_one(gap: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(gap), gap, 1.0)


def _largest(values: np.ndarray) -> float:
    """Largest value, zero at least; a NaN stays a NaN."""
    return float(np.max(values, initial=0.0))
