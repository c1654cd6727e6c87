"""First QP: the contact wrenches the feet should feel (op: tsid).

In words: find joint torques that, with the feet at rest, accelerate the centre of
mass, the base and the posture as their PD laws ask, within torque, friction,
centre-of-pressure and load limits; the wrenches that go with them are F_id.

The dynamics and the contact constraint are not equalities of the QP: for feet at
rest the paper's own identities give wrenches and accelerations in terms of tau,

    F   = Gamma_c tau + h_c
    qdd = A tau + b,    A = H^-1 (S^T + J_c^T Gamma_c),   b = H^-1 (J_c^T h_c - c)

so the unknowns are the n_a torques alone.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from schemas.arrays import Array, Mat
from schemas.settings import TsidSettings
from stabilizer.dynamics import Dynamics
from stabilizer.model import GRAVITY, N_BASE_V, RobotModel
from stabilizer.qp import DenseQp, QpSolution
from stabilizer.references import Stance

ROWS_PER_FOOT = 12
COM, BASE = slice(0, 3), slice(3, 6)
NO_CONTACT = "no contact"
SINGULAR = "singular contact"


def cone_rows(settings: TsidSettings, half_length: float, half_width: float) -> Mat:
    """(12, 6) rows C of the sole's limits, C F <= d, in the sole frame.

    Only the last two rows have a non-zero bound d: the largest and the least normal
    force.

    Args:
        settings: friction, sole scale.
        half_length: sole half length along x [m].
        half_width: sole half width along y [m].
    """
    mu = settings.friction / np.sqrt(2.0)
    x, y = settings.sole_scale * half_length, settings.sole_scale * half_width
    yaw = settings.yaw_friction
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
            [0.0, 0.0, -yaw, 0.0, 0.0, 1.0],
            [0.0, 0.0, -yaw, 0.0, 0.0, -1.0],
            [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, -1.0, 0.0, 0.0, 0.0],
        ]
    )


class _FeetProblem:
    """Workspace for one set of standing feet: both, left or right."""

    def __init__(self, n_a: int, feet: tuple[int, ...], cones: list[Mat]) -> None:
        self.feet = feet
        self.rows = slice(6 * feet[0], 6 * feet[-1] + 6)
        n_c = 6 * len(feet)
        self.n_c = n_c
        self.qp = DenseQp("tsid", n=n_a, m=ROWS_PER_FOOT * len(feet))
        self.C: Mat = np.zeros((ROWS_PER_FOOT * len(feet), n_c))
        for i, foot in enumerate(feet):
            rows = slice(ROWS_PER_FOOT * i, ROWS_PER_FOOT * (i + 1))
            self.C[rows, 6 * i : 6 * i + 6] = cones[foot]
        self.d: Array = np.zeros(ROWS_PER_FOOT * len(feet))
        self.known: Mat = np.zeros((n_c, n_a + 1))
        self.Gamma_c: Mat = np.zeros((n_c, n_a))
        self.h_c: Array = np.zeros(n_c)
        # Stacked task rows: com 3, base 3, posture n_a, wrench n_c.
        self.T: Mat = np.zeros((6 + n_a + n_c, n_a))
        self.t: Array = np.zeros(6 + n_a + n_c)
        self.F_even: Array = np.zeros(n_c)


class Tsid:
    """Builds and solves the first QP.

    Attributes:
        F_id: (12,) wrenches the soles should feel, sole frames; a foot that does
            not stand has zeros.
        tau: (n_a,) torques that go with them [N m].
    """

    def __init__(self, model: RobotModel, settings: TsidSettings) -> None:
        """Allocates one problem for each set of standing feet."""
        self._model = model
        self._settings = settings
        n_a = model.n_a
        cones = [
            cone_rows(settings, foot.half_length_m, foot.half_width_m)
            for foot in model.robot.file.foot
        ]
        self._problems = {
            (True, True): _FeetProblem(n_a, (0, 1), cones),
            (True, False): _FeetProblem(n_a, (0,), cones),
            (False, True): _FeetProblem(n_a, (1,), cones),
        }
        for problem in self._problems.values():
            problem.qp.x_l[:] = -model.torque_limit
            problem.qp.x_u[:] = model.torque_limit
        self._com_kp = np.array(settings.com_kp)
        self._com_kd = np.array(settings.com_kd)
        self._weight = model.mass * GRAVITY
        self._com_root = settings.com_weight**0.5
        self._base_root = settings.base_weight**0.5
        self._posture_roots = np.sqrt(
            np.where(
                model.is_leg, settings.leg_posture_weight, settings.posture_weight
            )
        )
        wrench_weight = [settings.force_weight] * 3 + [settings.moment_weight] * 3
        self._wrench_weight = np.sqrt(np.array(wrench_weight * 2))
        self.A: Mat = np.zeros((model.n_v, n_a))
        self.b: Array = np.zeros(model.n_v)
        self.F_id: Array = np.zeros(12)
        self.tau: Array = np.zeros(n_a)
        self._none = QpSolution(
            np.zeros(n_a), NO_CONTACT, False, np.zeros(0), np.zeros(n_a)
        )
        self._singular = QpSolution(
            np.zeros(n_a), SINGULAR, False, np.zeros(0), np.zeros(n_a)
        )

    def solve(
        self,
        dynamics: Dynamics,
        stance: Stance,
        *,
        in_contact: list[bool],
        allowed: Array,
    ) -> QpSolution:
        """Computes F_id for this tick.

        Args:
            dynamics: quantities at the present state.
            stance: reference.
            in_contact: which feet stand.
            allowed: (2,) largest normal force of each foot [N].

        Returns:
            The QP's solution; ``F_id`` keeps its last value when it failed.
        """
        problem = self._problems.get((in_contact[0], in_contact[1]))
        if problem is None:
            self.F_id[:] = 0.0
            return self._none
        if not self.condense(dynamics, problem):
            return self._singular
        self._stack_tasks(dynamics, stance, problem)
        self._set_limits(problem, allowed)
        qp = problem.qp
        np.dot(problem.T.T, problem.T, out=qp.P)
        qp.P.flat[:: self._model.n_a + 1] += self._settings.torque_weight
        np.dot(problem.t, problem.T, out=qp.q_lin)
        np.negative(qp.q_lin, out=qp.q_lin)
        solution = qp.solve()
        if solution.ok:
            self.tau[:] = solution.x
            self.F_id[:] = 0.0
            self.F_id[problem.rows] = problem.Gamma_c @ solution.x + problem.h_c
        return solution

    def problem(self, in_contact: list[bool]) -> DenseQp:
        """The QP of a set of standing feet, as last solved."""
        return self._problems[(in_contact[0], in_contact[1])].qp

    def condense(self, dynamics: Dynamics, problem: _FeetProblem) -> bool:
        """Expresses F and qdd affinely in tau, for the standing feet.

        Returns:
            Whether the feet's Jacobian has full rank.
        """
        rows, X = problem.rows, dynamics.X[:, problem.rows]
        # One factorisation: Lambda_c [J_c H^-1 S^T, J_c H^-1 c - Jdot_c v].
        known = problem.known
        known[:, :-1] = X[N_BASE_V:].T
        known[:, -1] = dynamics.c @ X
        known[:, -1] -= dynamics.Jdot_v_contact[rows]
        _, solved, info = lapack.dposv(
            dynamics.Lambda_c_inv[rows, rows], known, lower=1
        )
        if info != 0:
            return False
        np.negative(solved[:, :-1], out=problem.Gamma_c)
        problem.h_c[:] = solved[:, -1]
        np.dot(X, problem.Gamma_c, out=self.A)
        self.A += dynamics.H_inv[:, N_BASE_V:]
        np.dot(X, problem.h_c, out=self.b)
        self.b -= dynamics.H_inv @ dynamics.c
        return True

    def _stack_tasks(
        self, dynamics: Dynamics, stance: Stance, problem: _FeetProblem
    ) -> None:
        """Weighted task rows T tau = t."""
        settings, T, t = self._settings, problem.T, problem.t
        n_a = self._model.n_a
        posture = slice(6, 6 + n_a)
        wrench = slice(6 + n_a, 6 + n_a + problem.n_c)
        root = self._com_root
        com_acceleration = (
            stance.com_acceleration
            + self._com_kp * (stance.com - dynamics.p_com)
            + self._com_kd * (stance.com_velocity - dynamics.v_com)
        )
        J_com = root * dynamics.J_com
        np.dot(J_com, self.A, out=T[COM])
        t[COM] = root * (com_acceleration - dynamics.Jdot_v_com) - J_com @ self.b
        root = self._base_root
        np.multiply(self.A[BASE], root, out=T[BASE])
        t[BASE] = root * (self._base_acceleration(dynamics, stance) - self.b[BASE])
        roots = self._posture_roots
        np.multiply(self.A[N_BASE_V:], roots[:, None], out=T[posture])
        posture_acceleration = (
            settings.posture_kp * (stance.posture - dynamics.q[7:])
            - settings.posture_kd * dynamics.v[N_BASE_V:]
        )
        t[posture] = roots * (posture_acceleration - self.b[N_BASE_V:])
        self._even_load(dynamics, problem)
        roots = self._wrench_weight[: problem.n_c]
        np.multiply(problem.Gamma_c, roots[:, None], out=T[wrench])
        t[wrench] = roots * (problem.F_even - problem.h_c)

    def _base_acceleration(self, dynamics: Dynamics, stance: Stance) -> Array:
        """(3,) wanted angular acceleration of the base, base axes [rad/s^2]."""
        error = stance.base_error
        wanted: Array = (
            self._settings.base_kp * error - self._settings.base_kd * dynamics.v[BASE]
        )
        return wanted

    def _even_load(self, dynamics: Dynamics, problem: _FeetProblem) -> None:
        """Each standing foot carries its part of the weight, straight up."""
        share = self._weight / len(problem.feet)
        for i, foot in enumerate(problem.feet):
            problem.F_even[6 * i : 6 * i + 3] = share * dynamics.R_world_sole[foot][2]

    def _set_limits(self, problem: _FeetProblem, allowed: Array) -> None:
        least = self._settings.normal_force_min_n
        for i, foot in enumerate(problem.feet):
            largest = max(2.0 * least, float(allowed[foot]))
            # Alone on the ground, a foot must carry what there is to carry.
            if len(problem.feet) == 1:
                largest = max(largest, 2.0 * self._weight)
            problem.d[ROWS_PER_FOOT * i + 10] = largest
            problem.d[ROWS_PER_FOOT * i + 11] = -least
        np.dot(problem.C, problem.Gamma_c, out=problem.qp.G)
        np.dot(problem.C, problem.h_c, out=problem.qp.h_u)
        np.subtract(problem.d, problem.qp.h_u, out=problem.qp.h_u)
