"""Commanded robot of the ZMP baseline: joints from soles, CoM and base by a QP.

In words: find the acceleration of base and joints with which

    the soles follow the admittance's twists        weight 1e4
    the centre of mass follows the pendulum         weight ``zmp.com_weight``
    the base turns to its desired orientation       weight 200
    the joints return to the posture                weight 10

within the joints' position and velocity limits. Only legs and base serve the centre of
mass. The base of the Walker is pelvis and torso in one, so their two tasks of weight
100 are one here.

The unknown of the QP is the velocity after the tick, v + a dt. The cost is divided by
the contact weight and by dt^-2: same optimum, numbers of size one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.schemas.law_settings import DikSettings, ZmpSettings
from surefoot.stabilizer.dynamics import SOLE_ROWS
from surefoot.stabilizer.model import N_BASE_V, RobotModel, yaw_from
from surefoot.stabilizer.qp import DenseQp, QpSolution
from surefoot.stabilizer.walking.swing import SwingReference

CONTACT_WEIGHT, BASE_WEIGHT, POSTURE_WEIGHT = 1e4, 200.0, 10.0
BASE_STIFFNESS = 10.0
POSTURE_STIFFNESS = 1.0
SINGLE_SUPPORT_STIFFNESS = 1000.0
"""Stiffness of the standing foot's position while the other foot is lifted [1/s^2]."""


class Kinematics:
    """Centre of mass and soles at one state; names as in ``Dynamics``."""

    def __init__(self, model: RobotModel) -> None:
        """Allocate every array once."""
        self._pin = model.pin_model
        self._data = self._pin.createData()
        self._soles = model.sole_ids
        self._zero = np.zeros(model.n_v)
        self.p_com: Vec3 = np.zeros(3)
        self.v_com: Vec3 = np.zeros(3)
        self.R_world_sole: list[Mat] = [np.eye(3), np.eye(3)]
        self.p_sole: list[Vec3] = [np.zeros(3), np.zeros(3)]
        self.J_com: Mat = np.zeros((3, model.n_v))
        self.J_contact: Mat = np.zeros((12, model.n_v))
        self.Jdot_v_com: Vec3 = np.zeros(3)
        self.Jdot_v_contact: Array = np.zeros(12)
        self.v_sole: Array = np.zeros(12)

    def update(self, q: Array, v: Array) -> None:
        """Compute poses and velocities at a state.

        Args:
            q: (7 + n_a,) configuration.
            v: (n_v,) velocity, base twist in base first.
        """
        data = self._data
        # With zero joint acceleration, accelerations are the drift Jdot v.
        pin.centerOfMass(self._pin, data, q, v, self._zero)
        self.p_com[:] = data.com[0]
        self.v_com[:] = data.vcom[0]
        self.Jdot_v_com[:] = data.acom[0]
        for side, frame in enumerate(self._soles):
            rows = SOLE_ROWS[side]
            twist = pin.getFrameVelocity(self._pin, data, frame, pin.LOCAL)
            self.v_sole[rows] = twist.vector
            placement = pin.updateFramePlacement(self._pin, data, frame)
            self.R_world_sole[side] = placement.rotation.copy()
            self.p_sole[side] = placement.translation.copy()

    def update_jacobians(self, q: Array, v: Array) -> None:
        """Also compute Jacobians and drifts; arguments as for :meth:`update`."""
        model, data = self._pin, self._data
        self.J_com[:] = pin.jacobianCenterOfMass(model, data, q)
        pin.computeJointJacobians(model, data, q)
        self.update(q, v)
        for side, frame in enumerate(self._soles):
            rows = slice(6 * side, 6 * side + 6)
            self.J_contact[rows] = pin.getFrameJacobian(model, data, frame, pin.LOCAL)
            drift = pin.getFrameAcceleration(model, data, frame, pin.LOCAL)
            self.Jdot_v_contact[rows] = drift.vector
        self.J_contact.dot(v, out=self.v_sole)


COM_STIFFNESS = np.array([1000.0, 1000.0, 100.0])
CONTACT, COM, BASE = slice(0, 12), slice(12, 15), slice(3, 6)


@dataclass
class ComTarget:
    """Target of the commanded centre of mass: (3,) each [m, m/s, m/s^2]."""

    position: Vec3
    velocity: Vec3
    acceleration: Vec3


class CommandedRobot:
    """Commanded configuration and velocity, base included.

    Attributes:
        q: (7 + n_a,) configuration in the stance frame.
        v: (n_v,) velocity.
        kinematics: at that state.
        qp: the last problem.
        p_stance: positions to which the soles return [m].
        swings: whether left and right foot follow a path through the air.
    """

    def __init__(
        self,
        model: RobotModel,
        zmp: ZmpSettings,
        limits: DikSettings,
        *,
        period_s: float,
    ) -> None:
        """Begin in the nominal stance."""
        self._model = model
        self._limits = limits
        self._range = model.range_within(limits.limit_margin_rad)
        self._dt = period_s
        n_v = model.n_v
        self.q: Array = model.nominal_configuration()
        self.v: Array = np.zeros(n_v)
        self.kinematics = Kinematics(model)
        self.kinematics.update_jacobians(self.q, self.v)
        self.qp = DenseQp("zmp ik", n=n_v, m=0)
        self._T: Mat = np.zeros((15, n_v))
        self._t: Array = np.zeros(15)
        self._roots = np.sqrt([1.0] * 12 + [zmp.com_weight / CONTACT_WEIGHT] * 3)
        self._upper_body = N_BASE_V + np.flatnonzero(~model.is_leg)
        self._diagonal = np.zeros(n_v)
        self._diagonal[BASE] = BASE_WEIGHT / CONTACT_WEIGHT
        self._diagonal[N_BASE_V:] = POSTURE_WEIGHT / CONTACT_WEIGHT
        self._desired: Array = np.zeros(n_v)
        self._stiffness = zmp.contact_stiffness
        self._damping = zmp.contact_damping
        self._speed = np.minimum(model.velocity_limit, limits.velocity_limit_rad_s)
        self._R_stance: list[Mat] = []
        self.p_stance: list[Vec3] = []
        self.take_stance()

    def start(self, q_joint: Array) -> None:
        """Begin at rest in a posture, with the soles where they stand.

        Args:
            q_joint: (n_a,) joints, model order [rad].
        """
        self.q = self._model.nominal_configuration()
        self.q[N_BASE_V + 1 :] = q_joint
        self.v[:] = 0.0
        self.kinematics.update_jacobians(self.q, self.v)
        self.take_stance()

    def take_stance(self) -> None:
        """Take the present sole poses as those to return to."""
        self._R_stance = [R.copy() for R in self.kinematics.R_world_sole]
        self.p_stance = [p.copy() for p in self.kinematics.p_sole]
        self.swings = [False, False]

    def stand_at(self, side: int, *, p: Vec3, yaw: float) -> None:
        """Move the whole commanded robot so that a sole is at a given place.

        Ground slips and gives way a little. Without this the commanded feet would drift
        away from those of the robot.

        Args:
            side: the foot.
            p: (3,) place of its sole [m].
            yaw: heading of the sole [rad].
        """
        R, there = self.kinematics.R_world_sole[side], self.kinematics.p_sole[side]
        turn = pin.exp3(np.array([0.0, 0.0, -yaw_from(R, yaw)]))
        self.q[:3] = p + turn @ (self.q[:3] - there)
        base = pin.Quaternion(turn) * pin.Quaternion(self.q[3:7])
        self.q[3:7] = base.coeffs()
        self.p_stance = [p + turn @ (place - there) for place in self.p_stance]
        self._R_stance = [turn @ place for place in self._R_stance]
        self.kinematics.update_jacobians(self.q, self.v)

    def swing(self, side: int, reference: SwingReference, twist: Array) -> None:
        """Make a foot in the air follow its path.

        Args:
            side: the foot.
            reference: reference of the foot, in the world of the commanded robot.
            twist: (12,) desired sole twists; the foot's entries are written.
        """
        R = self.kinematics.R_world_sole[side]
        self.swings[side] = True
        self.p_stance[side][:] = reference.p
        self._R_stance[side][:] = reference.R
        start = 6 * side
        twist[start : start + 3] = reference.v @ R
        twist[start + 3 : start + 6] = reference.w @ R

    def set_down(self, side: int) -> None:
        """End a swing: from now on the foot returns to where it is now."""
        if self.swings[side]:
            self.swings[side] = False
            self.p_stance[side][:] = self.kinematics.p_sole[side]
            self._R_stance[side][:] = self.kinematics.R_world_sole[side]

    def solve(
        self,
        *,
        twist: Array,
        in_contact: list[bool],
        com: ComTarget,
        R_base: Mat,
        posture: Array,
    ) -> QpSolution:
        """Compute the velocity after this tick.

        Args:
            twist: (12,) desired sole twists, commanded sole frames.
            in_contact: which feet stand.
            com: reference of the centre of mass.
            R_base: (3, 3) desired base rotation.
            posture: (n_a,) joints to return to, model order [rad].

        Returns:
            The QP's solution, x = velocity of base and joints.
        """
        kinematics, T, t, qp = self.kinematics, self._T, self._t, self.qp
        T[CONTACT] = kinematics.J_contact
        T[COM] = kinematics.J_com
        T[COM, self._upper_body] = 0.0
        t[CONTACT] = self._damping * (twist - kinematics.v_sole)
        t[CONTACT] -= kinematics.Jdot_v_contact
        self._add_stance_pull(t, in_contact)
        t[COM] = com.acceleration + COM_STIFFNESS * (com.position - kinematics.p_com)
        t[COM] += 2.0 * np.sqrt(COM_STIFFNESS) * (com.velocity - kinematics.v_com)
        t[COM] -= kinematics.Jdot_v_com
        t *= self._dt
        t += T @ self.v
        T *= self._roots[:, None]
        t *= self._roots
        T.T.dot(T, out=qp.P)
        qp.P.flat[:: self._model.n_v + 1] += self._diagonal
        t.dot(T, out=qp.q_lin)
        qp.q_lin += self._diagonal * self._velocity_desired(R_base, posture)
        np.negative(qp.q_lin, out=qp.q_lin)
        self._set_limits()
        return qp.solve()

    def _velocity_desired(self, R_base: Mat, posture: Array) -> Array:
        """Return the next velocity desired for base orientation and posture, (n_v,)."""
        desired = self._desired
        R = pin.Quaternion(self.q[3:7]).toRotationMatrix()
        desired[BASE] = BASE_STIFFNESS * pin.log3(R.T @ R_base)
        desired[BASE] -= 2.0 * BASE_STIFFNESS**0.5 * self.v[BASE]
        desired[N_BASE_V:] = POSTURE_STIFFNESS * (posture - self.q[7:])
        desired[N_BASE_V:] -= 2.0 * POSTURE_STIFFNESS**0.5 * self.v[N_BASE_V:]
        desired *= self._dt
        desired += self.v
        return desired

    def integrate(self, velocity: Array, q_measured: Array, *, ticks: float) -> None:
        """Integrate a velocity, but keep near the measured joints.

        Args:
            velocity: (n_v,) of base and joints.
            q_measured: (n_a,) joints, model order [rad].
            ticks: for how many ticks to move.
        """
        model, reach = self._model, self._limits.windup_limit_rad
        self.v[:] = velocity
        self.q = pin.integrate(model.pin_model, self.q, (ticks * self._dt) * self.v)
        joints = self.q[7:]
        low = np.maximum(q_measured - reach, model.lower)
        high = np.minimum(q_measured + reach, model.upper)
        kept = np.clip(joints, low, np.maximum(low, high))
        # Speed into a limit is dropped; it would come out later as a jump.
        self.v[N_BASE_V:][kept != joints] = 0.0
        joints[:] = kept
        self.kinematics.update_jacobians(self.q, self.v)

    def _add_stance_pull(self, t: Array, in_contact: list[bool]) -> None:
        """Add the slow return of the soles; stiff for a foot that stands alone."""
        alone = in_contact[0] != in_contact[1]
        for side in (0, 1):
            R, p = self.kinematics.R_world_sole[side], self.kinematics.p_sole[side]
            is_stiff = (alone and in_contact[side]) or self.swings[side]
            linear = SINGLE_SUPPORT_STIFFNESS if is_stiff else self._stiffness
            angular = SINGLE_SUPPORT_STIFFNESS if self.swings[side] else self._stiffness
            start = 6 * side
            offset = self.p_stance[side] - p
            turn = pin.log3(R.T @ self._R_stance[side])
            t[start : start + 3] += linear * (offset @ R)
            t[start + 3 : start + 6] += angular * turn

    def _set_limits(self) -> None:
        """Set velocity limits, with a damper before each end of the joint range."""
        limits, speed, q = self._limits, self._speed, self.q[7:]
        lower, upper = self._range
        low = (lower - q) / limits.limit_time_s
        high = (upper - q) / limits.limit_time_s
        self.qp.x_l[N_BASE_V:] = np.clip(low, -speed, speed)
        self.qp.x_u[N_BASE_V:] = np.clip(high, -speed, speed)
