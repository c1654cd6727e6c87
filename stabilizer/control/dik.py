"""Second QP: joint velocities that drive the wrenches to F_id (op: u).

In words: find the velocity v of base and joints that moves the soles as the wrench
law r asks, the centre of mass, base and posture as their references ask, within
joint velocity and position limits.

    r = -Lambda_c^-1 K^-1 e_F,   e_F = F_meas - F_id,   K negative definite

Delta = J_c v - r is eliminated: minimising its norm is the same problem. A foot that
is pushed too hard gets r_z > 0: it yields. (The paper's final law has this sign; its
intermediate one, eq. contact_measure, has it flipped.)
"""

from __future__ import annotations

import numpy as np

from surefoot.schemas.arrays import Array, Mat
from surefoot.schemas.settings import DikSettings
from surefoot.stabilizer.control.reference import Stance
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.model import N_BASE_V, RobotModel
from surefoot.stabilizer.qp import DenseQp, QpSolution

CONTACT, COM = slice(0, 12), slice(12, 15)
BASE = slice(3, 6)


class Dik:
    """Builds and solves the second QP."""

    def __init__(self, model: RobotModel, settings: DikSettings) -> None:
        """Allocate everything once."""
        self._model = model
        self._settings = settings
        n_v = model.n_v
        self.qp = DenseQp("dik", n=n_v, m=0)
        self._T: Mat = np.zeros((15, n_v))
        self._t: Array = np.zeros(15)
        self._contact_roots = np.sqrt(np.array(settings.contact_weight * 2))
        self._com_roots = np.sqrt(np.array(settings.com_weight))
        self._com_gain = np.array(settings.com_gain)
        self._diagonal = np.full(n_v, settings.regularisation)
        self._diagonal[BASE] += settings.base_weight
        self._posture = np.where(
            model.is_leg, settings.leg_posture_weight, settings.posture_weight
        )
        self._diagonal[N_BASE_V:] += self._posture
        self._velocity = np.minimum(model.velocity_limit, settings.velocity_limit_rad_s)
        self._minus_velocity = -self._velocity
        margin = settings.limit_margin_rad
        # Rows: lower and upper limits.
        self._range: Mat = np.vstack((model.lower + margin, model.upper - margin))
        self._limits: Mat = np.zeros_like(self._range)
        self._per_second = 1.0 / settings.limit_time_s

    def retune(self, settings: DikSettings) -> None:
        """Take new gains; weights and limits stay as they were built."""
        self._settings = settings
        self._com_gain[:] = settings.com_gain

    def solve(
        self, dynamics: Dynamics, stance: Stance, *, r: Array, q_command: Array
    ) -> QpSolution:
        """Compute the velocity of this tick.

        Args:
            dynamics: quantities at the present state.
            stance: reference.
            r: (12,) wanted sole twists, sole frames.
            q_command: (n_a,) present joint command, model order.

        Returns:
            The QP's solution, x = (base twist, v_J).
        """
        settings, T, t, qp = self._settings, self._T, self._t, self.qp
        np.multiply(dynamics.J_contact, self._contact_roots[:, None], out=T[CONTACT])
        np.multiply(r, self._contact_roots, out=t[CONTACT])
        np.multiply(dynamics.J_com, self._com_roots[:, None], out=T[COM])
        com_error = stance.com - dynamics.p_com
        t[COM] = self._com_roots * (stance.com_velocity + self._com_gain * com_error)
        T.T.dot(T, out=qp.P)
        qp.P.flat[:: self._model.n_v + 1] += self._diagonal
        t.dot(T, out=qp.q_lin)
        base_velocity = settings.base_gain * stance.base_error
        qp.q_lin[BASE] += settings.base_weight * base_velocity
        posture_velocity = settings.posture_gain * (stance.posture - q_command)
        qp.q_lin[N_BASE_V:] += self._posture * posture_velocity
        np.negative(qp.q_lin, out=qp.q_lin)
        self._set_limits(q_command)
        return qp.solve()

    def _set_limits(self, q_command: Array) -> None:
        """Velocity limits, and a damper before each end of the joint range."""
        limits = self._limits
        np.subtract(self._range, q_command, out=limits)
        limits *= self._per_second
        np.minimum(limits, self._velocity, out=limits)
        np.maximum(limits, self._minus_velocity, out=limits)
        self.qp.x_l[N_BASE_V:] = limits[0]
        self.qp.x_u[N_BASE_V:] = limits[1]
