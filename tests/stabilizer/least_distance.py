"""A second QP solver, independent of PIQP: Lawson and Hanson's active-set method.

With P = L L^T and y = L^T x + L^-1 q_lin, the QP becomes a least-distance problem: the
shortest y with G L^-T y <= h_u + G P^-1 q_lin. Its dual is a non-negative least-squares
problem.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import nnls

from surefoot.stabilizer.qp import DenseQp, QpStatus, SolverAnswer

CONTRADICTION = 1e-9
"""A smaller residual means that the limits exclude all points."""


class LeastDistanceSolver:
    """A slow solver that is exact to rounding and keeps no state between problems.

    Attributes:
        solved: number of problems solved.
    """

    def __init__(self) -> None:
        self.solved = 0

    def solve(self, qp: DenseQp) -> SolverAnswer:
        self.solved += 1
        n, m = qp.q_lin.size, qp.h_u.size
        has_u, has_l = np.isfinite(qp.x_u), np.isfinite(qp.x_l)
        rows = np.vstack((qp.G, np.eye(n)[has_u], -np.eye(n)[has_l]))
        bounds = np.concatenate((qp.h_u, qp.x_u[has_u], -qp.x_l[has_l]))
        L = np.linalg.cholesky(qp.P)
        middle = solve_triangular(L, qp.q_lin, lower=True)
        # Rows of the problem of least distance: E y <= f.
        E = solve_triangular(L, rows.T, lower=True).T
        f = bounds + E @ middle
        dual, residual = nnls(np.vstack((-E.T, -f)), np.eye(n + 1)[-1])
        if residual < CONTRADICTION:
            return SolverAnswer(QpStatus.PRIMAL_INFEASIBLE)
        multipliers = dual / (1.0 + f @ dual)
        y = -E.T @ multipliers
        z_u, z_l = np.zeros(n), np.zeros(n)
        z_u[has_u] = multipliers[m : m + has_u.sum()]
        z_l[has_l] = multipliers[m + has_u.sum() :]
        x = solve_triangular(L.T, y - middle, lower=False)
        return SolverAnswer(QpStatus.OK, x=x, z=multipliers[:m], z_box=z_u - z_l)
