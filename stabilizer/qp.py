"""Small dense QPs, solved every tick.

    minimise   1/2 x^T P x + q_lin^T x
    subject to G x <= h_u,  x_l <= x <= x_u

P is positive definite in both QPs of the controller. So the unconstrained minimum,
found by one Cholesky factorisation, is the answer whenever it keeps all constraints, as
on most ticks. Otherwise a solver runs: PIQP, or any other :class:`QpSolver`. Both ways
meet the same optimality conditions, which :meth:`QpSolution.residuals` measures.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import piqp
from scipy.linalg import lapack

from surefoot.schemas.arrays import Array, Mat
from surefoot.schemas.toml_file import atomic_file

_NOTHING: Array = np.zeros(0)
FEASIBILITY_TOLERANCE = 1e-9
"""Largest violation with which the unconstrained minimum counts as feasible."""


class QpStatus(StrEnum):
    """Outcome of a QP."""

    OK = "ok"
    """Solved."""
    NOT_TRIED = "not tried"
    """Not tried, since an earlier step failed."""
    SENSORS_NOT_FINITE = "sensors not finite"
    """Not tried, since a sensor reading was not finite."""
    NO_CONTACT = "no contact"
    """No foot stands, so there are no contact wrenches."""
    SINGULAR_CONTACT = "singular contact"
    """The standing feet cannot move independently of each other."""
    NOT_FINITE = "not finite"
    """The problem contains numbers that are not finite."""
    PRIMAL_INFEASIBLE = "primal infeasible"
    """Its limits contradict each other."""
    DUAL_INFEASIBLE = "dual infeasible"
    """Its cost has no lower bound."""
    ITERATION_LIMIT = "iteration limit reached"
    """The solver gave up before it converged."""
    NUMERICS = "numerical trouble"
    """The solver's own factorisation failed."""
    UNSOLVED = "unsolved"
    """The solver did not say why."""


class QpResiduals(NamedTuple):
    """Deviation of a solution from the optimality conditions.

    With z the multipliers of G x <= h_u, and those of the box split by sign into
    z_u (upper bound) and z_l (lower bound), z_box = z_u - z_l:

    Attributes:
        primal: largest excess of G x over h_u, or of x over the box.
        dual: the largest of ``|P x + q_lin + G^T z + z_box|``, of the negative part of
            a multiplier of G x <= h_u, and of multipliers of infinite bounds.
        duality_gap: ``|z|^T |h_u - G x| + z_u^T |x_u - x| + z_l^T |x - x_l|``: the most
            by which the cost exceeds the optimum, if the gradient above is zero. (A sum
            of products, since the difference of both costs drowns in rounding.)
    """

    primal: float
    dual: float
    duality_gap: float

    @property
    def worst(self) -> float:
        """Largest of the three; NaN if any is."""
        return float(np.max(self))


@dataclass(frozen=True, slots=True)
class QpSolution:
    """Outcome of one solve; the next one reuses ``x`` and ``z``.

    Attributes:
        x: (n,) minimiser; meaningless unless ``ok``.
        status: ``ok``, or what went wrong.
        constrained: whether the solver was needed, not only the factorisation.
        z: (m,) multipliers of G x <= h_u.
        z_box: (n,) multipliers of the box, positive at the upper bound.
        problem: the solved problem, until it is filled anew.
    """

    x: Array
    status: QpStatus
    constrained: bool
    z: Array
    z_box: Array
    problem: DenseQp

    @property
    def ok(self) -> bool:
        """Whether the problem was solved."""
        return self.status is QpStatus.OK

    def residuals(self) -> QpResiduals:
        """Measure the deviation from an optimum of the problem as it is now."""
        qp, x, z = self.problem, self.x, self.z
        z_u, z_l = np.maximum(self.z_box, 0.0), np.maximum(-self.z_box, 0.0)
        has_u, has_l = np.isfinite(qp.x_u), np.isfinite(qp.x_l)
        slack, to_u, to_l = qp.h_u - qp.G @ x, qp.x_u - x, x - qp.x_l
        gradient = qp.P @ x + qp.q_lin + qp.G.T @ z + self.z_box
        gap = (
            np.abs(z) @ np.abs(slack)
            + z_u[has_u] @ np.abs(to_u[has_u])
            + z_l[has_l] @ np.abs(to_l[has_l])
        )
        return QpResiduals(
            primal=_largest(-slack, -to_u, -to_l),
            dual=_largest(np.abs(gradient), -z, z_u[~has_u], z_l[~has_l]),
            duality_gap=float(gap),
        )


def _largest(*violations: Array) -> float:
    """Return the largest of all numbers, at least zero; NaN if any is."""
    return float(np.max(np.concatenate(violations), initial=0.0))


@dataclass(frozen=True)
class QpData:
    """A failed problem, kept for replay; symbols as in the module's text."""

    name: str
    status: QpStatus
    P: Mat
    q_lin: Array
    G: Mat
    h_u: Array
    x_l: Array
    x_u: Array


class SolverAnswer(NamedTuple):
    """Answer of a solver; only a status unless it is ``ok``.

    Attributes:
        status: ``ok``, or what went wrong.
        x: (n,) minimiser.
        z: (m,) multipliers of G x <= h_u.
        z_box: (n,) multipliers of the box, positive at the upper bound.
    """

    status: QpStatus
    x: Array = _NOTHING
    z: Array = _NOTHING
    z_box: Array = _NOTHING


class QpSolver(Protocol):
    """Solves the problems of one :class:`DenseQp`, all of one size."""

    def solve(self, qp: DenseQp) -> SolverAnswer:
        """Solve the problem that the arrays of ``qp`` hold now.

        Args:
            qp: the problem, finite except for infinite bounds; must not be written.
        """


_PIQP_STATUS = {
    piqp.Status.PIQP_SOLVED: QpStatus.OK,
    piqp.Status.PIQP_MAX_ITER_REACHED: QpStatus.ITERATION_LIMIT,
    piqp.Status.PIQP_PRIMAL_INFEASIBLE: QpStatus.PRIMAL_INFEASIBLE,
    piqp.Status.PIQP_DUAL_INFEASIBLE: QpStatus.DUAL_INFEASIBLE,
    piqp.Status.PIQP_NUMERICS: QpStatus.NUMERICS,
}


class PiqpSolver:
    """The proximal interior-point solver PIQP."""

    def __init__(self) -> None:
        """Set tolerances; memory is allocated by the first problem."""
        self._solver = piqp.DenseSolver()
        self._solver.settings.eps_abs = 1e-9
        self._solver.settings.eps_rel = 0.0
        self._solver.settings.eps_duality_gap_abs = 1e-10
        self._solver.settings.eps_duality_gap_rel = 1e-12
        self._solver.settings.max_iter = 60
        self._is_set_up = False

    def solve(self, qp: DenseQp) -> SolverAnswer:
        """Solve a problem; see :meth:`QpSolver.solve`."""
        has_rows = qp.h_u.size > 0
        rows = {"G": qp.G, "h_u": qp.h_u} if has_rows else {}
        take = self._solver.update if self._is_set_up else self._solver.setup
        take(P=qp.P, c=qp.q_lin, **rows, x_l=qp.x_l, x_u=qp.x_u)
        self._is_set_up = True
        status = _PIQP_STATUS.get(self._solver.solve(), QpStatus.UNSOLVED)
        if status is not QpStatus.OK:
            return SolverAnswer(status)
        result = self._solver.result
        return SolverAnswer(
            status=status,
            x=result.x,
            z=result.z_u if has_rows else _NOTHING,
            z_box=result.z_bu - result.z_bl,
        )


class DenseQp:
    """Workspace for problems of one size.

    Fill ``P``, ``q_lin``, ``G``, ``h_u``, ``x_l``, ``x_u`` in place, then solve.
    ``diagonal`` is a view of P's.
    """

    def __init__(
        self, name: str, *, n: int, m: int, solver: QpSolver | None = None
    ) -> None:
        """Allocate n variables and m general inequalities.

        Args:
            name: name under which failures are kept.
            n: number of variables.
            m: number of rows of G.
            solver: solver of this problem alone, for active limits; PIQP unless given.
        """
        self.name = name
        self.P: Mat = np.eye(n)
        self.diagonal: Array = self.P.reshape(-1)[:: n + 1]
        self.q_lin: Array = np.zeros(n)
        self.G: Mat = np.zeros((m, n))
        self.h_u: Array = np.ones(m)
        self.x_l: Array = np.full(n, -np.inf)
        self.x_u: Array = np.full(n, np.inf)
        self._no_z = np.zeros(m)
        self._no_z_box = np.zeros(n)
        self._slack = np.zeros(m)
        self._solver = solver or PiqpSolver()

    def solve(self) -> QpSolution:
        """Solve the problem that the arrays hold now."""
        # P is symmetric: its transpose is the column-major array LAPACK wants.
        _, x, info = lapack.dposv(self.P.T, self.q_lin, lower=1)
        if info == 0:
            np.negative(x, out=x)
            if self._is_feasible(x):
                return QpSolution(
                    x, QpStatus.OK, False, self._no_z, self._no_z_box, self
                )
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
        return float(np.maximum.reduce(self._slack)) <= tolerance

    def _solve_constrained(self) -> QpSolution:
        arrays = (self.P, self.q_lin, self.G, self.h_u, self.x_l, self.x_u)
        if (
            not all(np.isfinite(a).all() for a in arrays[:4])
            or np.isnan(self.x_l).any()
            or np.isnan(self.x_u).any()
        ):
            return self.failed(QpStatus.NOT_FINITE)
        answer, x, z, z_box = self._solver.solve(self)
        status = QpStatus(answer)
        if status is not QpStatus.OK:
            return self.failed(status)
        return QpSolution(x, status, True, z, z_box, self)

    def failed(self, status: QpStatus) -> QpSolution:
        """Make a solution that only states the failure."""
        return QpSolution(
            self._no_z_box, status, True, self._no_z, self._no_z_box, self
        )

    def data(self, status: QpStatus) -> QpData:
        """Copy the present problem, for saving and replay."""
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
    """Write a problem as .npz atomically; its names are those of QpData.

    Raises:
        OSError: the file cannot be written.
    """
    with atomic_file(path) as file:
        np.savez(file, **asdict(data))
