"""First QP (TSID): the desired contact wrenches F_id.

The task-space inverse dynamics QP of the paper's section IV-A.

In words: find joint torques that, with the feet at rest, give the accelerations that
the tasks ask for: of the centre of mass, base, posture and further tasks. Limits are
torque, friction, centre of pressure and load. The wrenches that go with these torques
are F_id.

Dynamics and contact constraint are not equalities of the QP. For feet at rest the
paper's own identities give wrenches and accelerations in terms of tau,

    F   = Gamma_c tau + h_c
    qdd = A tau + b,    A = H^-1 (S^T + J_c^T Gamma_c),   b = H^-1 (J_c^T h_c - c)

so the n_a torques are the only unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from surefoot.schemas.arrays import Array, Mat
from surefoot.schemas.law_settings import TsidSettings
from surefoot.stabilizer.control.reference import Stance
from surefoot.stabilizer.control.tasks import (
    LoadTask,
    SelectionTask,
    Task,
    weight_roots,
)
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.model import GRAVITY, N_BASE_V, RobotModel
from surefoot.stabilizer.qp import DenseQp, PiqpSolver, QpSolution, QpSolver, QpStatus

ROWS_PER_FOOT = 12


def sole_rows(mu: float, x: float, y: float) -> Mat:
    """Return rows C with C F <= 0, F = [force; moment] in the sole frame, (8, 6).

    The rows are a friction pyramid, and the centre of pressure inside the rectangle.

    Args:
        mu: friction coefficient along each axis [1].
        x: half length of the rectangle [m].
        y: half width [m].
    """
    #    f_x   f_y   f_z   m_x   m_y   m_z
    return np.array(
        [
            [1.0, 0.0, -mu, 0.0, 0.0, 0.0],
            [-1.0, 0.0, -mu, 0.0, 0.0, 0.0],
            [0.0, 1.0, -mu, 0.0, 0.0, 0.0],
            [0.0, -1.0, -mu, 0.0, 0.0, 0.0],
            [0.0, 0.0, -y, 1.0, 0.0, 0.0],
            [0.0, 0.0, -y, -1.0, 0.0, 0.0],
            [0.0, 0.0, -x, 0.0, 1.0, 0.0],
            [0.0, 0.0, -x, 0.0, -1.0, 0.0],
        ]
    )


def cone_rows(settings: TsidSettings, half_length: float, half_width: float) -> Mat:
    """Return rows C of the sole's limits, C F <= d, in the sole frame, (12, 6).

    Only the last two rows have a non-zero bound d: largest and least normal force.

    Args:
        settings: friction, sole scale.
        half_length: sole half length along x [m].
        half_width: sole half width along y [m].
    """
    mu, scale = settings.friction / np.sqrt(2.0), settings.sole_scale
    yaw = settings.yaw_friction
    rows = [
        [0.0, 0.0, -yaw, 0.0, 0.0, 1.0],
        [0.0, 0.0, -yaw, 0.0, 0.0, -1.0],
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, -1.0, 0.0, 0.0, 0.0],
    ]
    return np.vstack((sole_rows(mu, scale * half_length, scale * half_width), rows))


FEET_OF = {(True, True): (0, 1), (True, False): (0,), (False, True): (1,)}
"""Standing feet by (left, right) contact."""


class _Rows(NamedTuple):
    """A task's rows in the buffers of one problem."""

    task: Task
    T: Mat
    y: Array
    bias: Array


class _SelectedRows(NamedTuple):
    """Rows of a task on some entries of v, with their rows of A and b."""

    task: SelectionTask
    T: Mat
    y: Array
    bias: Array
    A: Mat
    b: Array


class _FeetProblem:
    """Workspace for one set of standing feet: both, left or right."""

    def __init__(
        self,
        n_a: int,
        feet: tuple[int, ...],
        *,
        lost: Sequence[int],
        cones: list[Mat],
        tasks: Sequence[Task],
        A: Mat,
        b: Array,
        load_weights: Array,
        solver: QpSolver,
    ) -> None:
        self.feet = feet
        self.rows = slice(6 * feet[0], 6 * feet[-1] + 6)
        n_c = 6 * len(feet)
        self.qp = DenseQp("tsid", n=n_a, m=ROWS_PER_FOOT * len(feet), solver=solver)
        self.C: Mat = np.zeros((ROWS_PER_FOOT * len(feet), n_c))
        for i, foot in enumerate(feet):
            rows = slice(ROWS_PER_FOOT * i, ROWS_PER_FOOT * (i + 1))
            self.C[rows, 6 * i : 6 * i + 6] = cones[foot]
        self.d: Array = np.zeros(ROWS_PER_FOOT * len(feet))
        self.known: Mat = np.zeros((n_c, n_a + 1))
        self.Gamma_c: Mat = np.zeros((n_c, n_a))
        self.h_c: Array = np.zeros(n_c)
        # Stacked rows roots * (T tau + bias - y): every task, then the wrenches.
        roots = [
            (task, weight_roots(task, weights))
            for task in tasks
            if (weights := task.weights_without(lost)) is not None
        ]
        self.roots: Array = np.concatenate(
            [rows for _, rows in roots] + [np.sqrt(load_weights)] * len(feet)
        )
        n_rows = self.roots.size
        self.T: Mat = np.zeros((n_rows, n_a))
        self.t: Array = np.zeros(n_rows)
        self.y: Array = np.zeros(n_rows)
        self.bias: Array = np.zeros(n_rows)
        self.multiplied: list[_Rows] = []
        self.selected: list[_SelectedRows] = []
        start = 0
        for task, _ in roots:
            rows = slice(start, start + task.size)
            views = self.T[rows], self.y[rows], self.bias[rows]
            if isinstance(task, SelectionTask):
                columns = task.columns
                self.selected.append(
                    _SelectedRows(task, *views, A[columns], b[columns])
                )
            else:
                self.multiplied.append(_Rows(task, *views))
            start += task.size
        self.load_T, self.load_y = self.T[start:], self.y[start:]
        self.load_bias = self.bias[start:]


class Tsid:
    """Builds and solves the first QP.

    Attributes:
        F_id: (12,) desired wrenches of the soles, sole frames; zero for a foot that
            does not stand [N, N m].
        tau: (n_a,) torques that go with F_id [N m].
    """

    def __init__(
        self,
        model: RobotModel,
        settings: TsidSettings,
        tasks: Sequence[Task],
        *,
        swing: Sequence[Task] = (),
        solver: Callable[[], QpSolver] = PiqpSolver,
    ) -> None:
        """Allocate one problem for each set of standing feet.

        Args:
            model: the robot.
            settings: limits and weights.
            tasks: motion tasks; their rows are stacked in this order.
            swing: tasks of left and right foot for when it is in the air by plan; none
                for a robot that only stands.
            solver: makes the solver of each problem.
        """
        self._settings = settings
        self._load = LoadTask(model, settings)
        n_a = model.n_a
        cones = [
            cone_rows(settings, foot.half_length_m, foot.half_width_m)
            for foot in model.robot.file.foot
        ]
        self.A: Mat = np.zeros((model.n_v, n_a))
        self.b: Array = np.zeros(model.n_v)

        def problem_of(
            feet: tuple[int, ...], tasks: Sequence[Task], lost: Sequence[int] = ()
        ) -> _FeetProblem:
            return _FeetProblem(
                n_a,
                feet,
                lost=lost,
                cones=cones,
                tasks=tasks,
                A=self.A,
                b=self.b,
                load_weights=self._load.weights,
                solver=solver(),
            )

        self._problems = {
            standing: problem_of(feet, tasks, [i for i in (0, 1) if not standing[i]])
            for standing, feet in FEET_OF.items()
        }
        self._swinging = [
            problem_of((1 - side,), [*tasks, task]) for side, task in enumerate(swing)
        ]
        for problem in (*self._problems.values(), *self._swinging):
            problem.qp.x_l[:] = -model.torque_limit
            problem.qp.x_u[:] = model.torque_limit
        self._weight = model.mass * GRAVITY
        self.F_id: Array = np.zeros(12)
        self.tau: Array = np.zeros(n_a)

    def solve(
        self,
        dynamics: Dynamics,
        stance: Stance,
        *,
        in_contact: list[bool],
        allowed: Array,
        airborne: int | None = None,
    ) -> QpSolution:
        """Compute F_id for this tick.

        Args:
            dynamics: quantities at the present state.
            stance: reference.
            in_contact: which feet stand.
            allowed: (2,) largest normal force of each foot [N].
            airborne: the foot that is in the air by plan; None for none.

        Returns:
            The QP's solution. ``F_id`` is zero without contact, and keeps its last
            value when the QP fails.
        """
        problem = self._problems.get((in_contact[0], in_contact[1]))
        if problem is None:
            self.F_id[:] = 0.0
            return self.problem([True, True]).failed(QpStatus.NO_CONTACT)
        if airborne is not None:
            problem = self._swinging[airborne]
        if not self.condense(dynamics, problem):
            return problem.qp.failed(QpStatus.SINGULAR_CONTACT)
        self._stack_tasks(dynamics, stance, problem)
        self._set_limits(problem, allowed)
        qp = problem.qp
        problem.T.T.dot(problem.T, out=qp.P)
        qp.diagonal += self._settings.torque_weight
        problem.t.dot(problem.T, out=qp.q_lin)
        np.negative(qp.q_lin, out=qp.q_lin)
        solution = qp.solve()
        if solution.ok:
            self.tau[:] = solution.x
            self.F_id[:] = 0.0
            self.F_id[problem.rows] = problem.Gamma_c.dot(solution.x) + problem.h_c
        return solution

    def problem(self, in_contact: list[bool]) -> DenseQp:
        """Return the QP of a set of standing feet, as last solved."""
        return self._problems[(in_contact[0], in_contact[1])].qp

    def condense(self, dynamics: Dynamics, problem: _FeetProblem) -> bool:
        """Express F and qdd affinely in tau, for the standing feet.

        Returns:
            Whether the feet's Jacobian has full rank.
        """
        rows, X = problem.rows, dynamics.X[:, problem.rows]
        # One factorisation: Lambda_c [J_c H^-1 S^T, J_c H^-1 c - Jdot_c v].
        known = problem.known
        known[:, :-1] = X[N_BASE_V:].T
        known[:, -1] = dynamics.c.dot(X) - dynamics.Jdot_v_contact[rows]
        _, solved, info = lapack.dposv(
            dynamics.Lambda_c_inv[rows, rows], known, lower=1
        )
        if info != 0:
            return False
        np.negative(solved[:, :-1], out=problem.Gamma_c)
        problem.h_c[:] = solved[:, -1]
        X.dot(problem.Gamma_c, out=self.A)
        self.A += dynamics.H_inv[:, N_BASE_V:]
        X.dot(problem.h_c, out=self.b)
        self.b -= dynamics.H_inv.dot(dynamics.c)
        return True

    def _stack_tasks(
        self, dynamics: Dynamics, stance: Stance, problem: _FeetProblem
    ) -> None:
        """Fill the weighted rows T tau = t of all tasks, then of the wrenches."""
        for task, T, y, bias in problem.multiplied:
            task.acceleration(dynamics, stance, y)
            J = task.jacobian(dynamics)
            J.dot(self.A, out=T)
            J.dot(self.b, out=bias)
            bias += task.drift(dynamics)
        for selection, T, y, bias, A, b in problem.selected:
            selection.acceleration(dynamics, stance, y)
            T[:] = A
            bias[:] = b
        self._load.wrenches(dynamics, stance, problem.feet, problem.load_y)
        problem.load_T[:] = problem.Gamma_c
        problem.load_bias[:] = problem.h_c
        np.multiply(problem.T, problem.roots[:, None], out=problem.T)
        np.subtract(problem.y, problem.bias, out=problem.t)
        problem.t *= problem.roots

    def _set_limits(self, problem: _FeetProblem, allowed: Array) -> None:
        least = self._settings.normal_force_min_n
        for i, foot in enumerate(problem.feet):
            largest = max(2.0 * least, float(allowed[foot]))
            # A foot alone on the ground must carry the whole load.
            if len(problem.feet) == 1:
                largest = max(largest, 2.0 * self._weight)
            problem.d[ROWS_PER_FOOT * i + 10] = largest
            problem.d[ROWS_PER_FOOT * i + 11] = -least
        problem.C.dot(problem.Gamma_c, out=problem.qp.G)
        problem.C.dot(problem.h_c, out=problem.qp.h_u)
        np.subtract(problem.d, problem.qp.h_u, out=problem.qp.h_u)
