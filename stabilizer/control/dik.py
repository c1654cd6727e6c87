"""Second QP (DIK): joint velocities that drive the contact wrenches to F_id.

In words: find the velocity v of base and joints that fulfils all tasks as well as
possible, within joint velocity and position limits. The soles move as the wrench law's
r asks. Centre of mass, base, posture and further tasks ask for the rest.

    r = -Lambda_c^-1 K^-1 e_F,   e_F = F_meas - F_id,   K negative definite

Delta = J_c v - r is eliminated: minimising its norm is the same problem. A foot that is
pressed too hard gets r_z > 0: it yields. (The paper's final law, in its section IV-B,
has this sign. The relation between sole acceleration and wrench error at the end of its
section III has it flipped.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from surefoot.schemas.arrays import Array, Mat
from surefoot.schemas.law_settings import DikSettings
from surefoot.stabilizer.control.reference import Stance
from surefoot.stabilizer.control.tasks import (
    SelectionTask,
    SoleTwistTask,
    Task,
    weight_roots,
)
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.model import N_BASE_V, RobotModel
from surefoot.stabilizer.qp import DenseQp, PiqpSolver, QpSolution, QpSolver


class _StackedRows(NamedTuple):
    """A task's rows in T and t."""

    task: Task
    T: Mat
    t: Array
    roots: Array
    """(size, 1) square roots of its weights."""


class _SelectedRows(NamedTuple):
    """The part of the cost that a task on some entries of v has."""

    task: SelectionTask
    y: Array
    weights: Array
    q_lin: Array


class Dik:
    """Builds and solves the second QP."""

    def __init__(
        self,
        model: RobotModel,
        settings: DikSettings,
        tasks: Sequence[Task],
        *,
        solver: Callable[[], QpSolver] = PiqpSolver,
    ) -> None:
        """Allocate everything once."""
        self._model = model
        n_v = model.n_v
        self.qp = DenseQp("dik", n=n_v, m=0, solver=solver())
        self._soles = SoleTwistTask(settings)
        self._diagonal = np.full(n_v, settings.regularisation)
        self._stack([self._soles, *tasks])
        self._velocity = np.minimum(model.velocity_limit, settings.velocity_limit_rad_s)
        self._minus_velocity = -self._velocity
        # Rows: lower and upper limits.
        self._range: Mat = model.range_within(settings.limit_margin_rad)
        self._limits: Mat = np.zeros_like(self._range)
        self._per_second = 1.0 / settings.limit_time_s

    def _stack(self, tasks: Sequence[Task]) -> None:
        """Allocate the rows of T and t; tasks on entries of v need none."""
        self._selected: list[_SelectedRows] = []
        dense = []
        for task in tasks:
            weights = task.velocity_weights
            if weights is None:
                continue
            roots = weight_roots(task, weights)
            if isinstance(task, SelectionTask):
                self._diagonal[task.columns] += weights
                y, q_lin = np.zeros(task.size), self.qp.q_lin[task.columns]
                self._selected.append(_SelectedRows(task, y, weights, q_lin))
            else:
                dense.append((task, roots))
        self._roots: Array = np.concatenate([roots for _, roots in dense])
        self._T: Mat = np.zeros((self._roots.size, self._model.n_v))
        self._t: Array = np.zeros(self._roots.size)
        self._stacked: list[_StackedRows] = []
        start = 0
        for task, roots in dense:
            rows = slice(start, start + task.size)
            self._stacked.append(
                _StackedRows(task, self._T[rows], self._t[rows], roots[:, None])
            )
            start += task.size

    def solve(
        self, dynamics: Dynamics, stance: Stance, *, r: Array, q_command: Array
    ) -> QpSolution:
        """Compute the velocity of this tick.

        Args:
            dynamics: quantities at the present state.
            stance: reference.
            r: (12,) desired sole twists, sole frames.
            q_command: (n_a,) present joint command, model order.

        Returns:
            The QP's solution, x = (base twist, v_J).
        """
        T, t, qp = self._T, self._t, self.qp
        self._soles.r = r
        for task, T_rows, t_rows, roots in self._stacked:
            np.multiply(task.jacobian(dynamics), roots, out=T_rows)
            task.velocity(dynamics, stance, q_command, t_rows)
        t *= self._roots
        T.T.dot(T, out=qp.P)
        qp.diagonal += self._diagonal
        t.dot(T, out=qp.q_lin)
        for selection, y, weights, q_lin in self._selected:
            selection.velocity(dynamics, stance, q_command, y)
            y *= weights
            q_lin += y
        np.negative(qp.q_lin, out=qp.q_lin)
        self._set_limits(q_command)
        return qp.solve()

    def _set_limits(self, q_command: Array) -> None:
        """Set velocity limits, with a damper before each end of the joint range."""
        limits = self._limits
        np.subtract(self._range, q_command, out=limits)
        limits *= self._per_second
        np.minimum(limits, self._velocity, out=limits)
        np.maximum(limits, self._minus_velocity, out=limits)
        self.qp.x_l[N_BASE_V:] = limits[0]
        self.qp.x_u[N_BASE_V:] = limits[1]
