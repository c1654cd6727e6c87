"""Kinematics of one robot, the measured or the commanded one."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.stabilizer.model import RobotModel


class Kinematics:
    """Centre of mass and soles at one state, computed by :meth:`update`.

    Attributes:
        p_com: (3,) centre of mass in the world [m].
        v_com: (3,) its velocity [m/s].
        R_world_sole: rotation of each sole.
        p_sole: (3,) position of each sole in the world [m].
        J_com: (3, n_v) Jacobian; J_contact: (12, n_v) of the soles, sole frames.
        Jdot_v_com: (3,) drift of the centre of mass [m/s^2].
        Jdot_v_contact: (12,) drift of the soles.
        v_sole: (12,) sole twists.
    """

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
