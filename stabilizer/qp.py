"""Small dense QPs, solved every tick.

    minimise   1/2 x^T P x + q_lin^T x
    subject to G x <= h_u,  x_l <= x <= x_u

P is positive definite in both of our problems. So the unconstrained minimum, one
Cholesky factorisation away, is the answer whenever it keeps all constraints, as it
does on most ticks; only otherwise PIQP runs. Both ways meet the same optimality
conditions, and tests hold them together.
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import piqp
from scipy.linalg import lapack

from surefoot.schemas.arrays import Array, Mat

FEASIBILITY_TOLERANCE = 1e-9
"""Violation that the unconstrained minimum may have to be taken as feasible."""
SOLVED = "ok"


@dataclass(frozen=True, slots=True)
class QpSolution:
    """Outcome of one solve; ``x`` and ``z`` are reused by the next.

    Attributes:
        x: (n,) minimiser; meaningless unless ``ok``.
        status: ``ok``, or the solver's word for what went wrong.
        constrained: whether the interior-point solver was needed.
        z: (m,) multipliers of G x <= h_u.
        z_box: (n,) multipliers of the box, positive at the upper bound.
    """

    x: Array
    status: str
    constrained: bool
    z: Array
    z_box: Array

    @property
    def ok(self) -> bool:
        """Whether the problem was solved."""
        return self.status == SOLVED


@dataclass(frozen=True)
class QpData:
    """A problem kept for replay after a failure; symbols as above."""

    name: str
    status: str
    P: Mat
    q_lin: Array
    G: Mat
    h_u: Array
    x_l: Array
    x_u: Array


class DenseQp:
    """Workspace for problems of one size.

    Fill ``P``, ``q_lin``, ``G``, ``h_u``, ``x_l``, ``x_u`` in place, then solve.
    """

    def __init__(self, name: str, *, n: int, m: int) -> None:
        """Allocate n variables and m general inequalities."""
        self.name = name
        self.P: Mat = np.eye(n)
        self.q_lin: Array = np.zeros(n)
        self.G: Mat = np.zeros((m, n))
        self.h_u: Array = np.ones(m)
        self.x_l: Array = np.full(n, -np.inf)
        self.x_u: Array = np.full(n, np.inf)
        self._no_z = np.zeros(m)
        self._no_z_box = np.zeros(n)
        self._slack = np.zeros(m)
        self._solver = piqp.DenseSolver()
        self._solver.settings.eps_abs = 1e-9
        self._solver.settings.eps_rel = 0.0
        self._solver.settings.eps_duality_gap_abs = 1e-10
        self._solver.settings.eps_duality_gap_rel = 1e-12
        self._solver.settings.max_iter = 60
        self._is_set_up = False

    def solve(self) -> QpSolution:
        """Solve what the arrays hold now."""
        # P is symmetric: its transpose is the column-major array LAPACK wants.
        _, x, info = lapack.dposv(self.P.T, self.q_lin, lower=1)
        if info == 0:
            np.negative(x, out=x)
            if self._is_feasible(x):
                return QpSolution(x, SOLVED, False, self._no_z, self._no_z_box)
        return self._solve_constrained()

    def _is_feasible(self, x: Array) -> bool:
        tolerance = FEASIBILITY_TOLERANCE
        above = np.minimum.reduce(x - self.x_l)
        below = np.minimum.reduce(self.x_u - x)
        if not (above >= -tolerance and below >= -tolerance):
            return False
        if self.h_u.size == 0:
            return True
        self.G.dot(x, out=self._slack)
        np.subtract(self._slack, self.h_u, out=self._slack)
        return float(self._slack.max()) <= tolerance

    def _solve_constrained(self) -> QpSolution:
        arrays = (self.P, self.q_lin, self.G, self.h_u, self.x_l, self.x_u)
        if (
            not all(np.isfinite(a).all() for a in arrays[:4])
            or np.isnan(self.x_l).any()
            or np.isnan(self.x_u).any()
        ):
            return self._failed("not finite")
        self._update_solver()
        status = self._solver.solve()
        if status != piqp.Status.PIQP_SOLVED:
            return self._failed(str(status).rsplit("PIQP_", 1)[-1].lower())
        result = self._solver.result
        return QpSolution(
            x=result.x,
            status=SOLVED,
            constrained=True,
            z=result.z_u if self.h_u.size else self._no_z,
            z_box=result.z_bu - result.z_bl,
        )

    def _update_solver(self) -> None:
        has_rows = self.h_u.size > 0
        rows = {"G": self.G, "h_u": self.h_u} if has_rows else {}
        bounds = {"x_l": self.x_l, "x_u": self.x_u}
        if self._is_set_up:
            self._solver.update(P=self.P, c=self.q_lin, **rows, **bounds)
            return
        self._solver.setup(P=self.P, c=self.q_lin, **rows, **bounds)
        self._is_set_up = True

    def _failed(self, status: str) -> QpSolution:
        return QpSolution(self._no_z_box, status, True, self._no_z, self._no_z_box)

    def data(self, status: str) -> QpData:
        """Copy the present problem, to be saved and replayed."""
        return QpData(
            name=self.name,
            status=status,
            P=self.P.copy(),
            q_lin=self.q_lin.copy(),
            G=self.G.copy(),
            h_u=self.h_u.copy(),
            x_l=self.x_l.copy(),
            x_u=self.x_u.copy(),
        )


def save_failure(data: QpData, path: Path) -> None:
    """Write a problem as .npz, whole or not at all.

    Args:
        data: the problem; ``np.load(path)`` gives its matrices by the same names.
        path: file to write; an older one is replaced.

    Raises:
        OSError: it cannot be written there.
    """
    unfinished = path.with_name(path.name + ".part")
    with unfinished.open("wb") as file:
        np.savez(file, **asdict(data))
    os.replace(unfinished, path)
