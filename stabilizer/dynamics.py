"""Dynamics and contact quantities of one tick (section III of the paper)."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import pinocchio as pin

from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.stabilizer.model import N_BASE_V, RobotModel

SOLE_ROWS = (slice(0, 6), slice(6, 12))
"""Rows of left and right sole in every stacked contact quantity."""
NORMAL = 2
"""Index of the normal force in a sole wrench."""


def cross(a: Vec3, b: Vec3) -> Vec3:
    """Return a x b, bit for bit as numpy does, in a thirtieth of its time.

    Args:
        a: (3,).
        b: (3,).
    """
    a_x, a_y, a_z = a.tolist()
    b_x, b_y, b_z = b.tolist()
    return np.array(
        (a_y * b_z - a_z * b_y, a_z * b_x - a_x * b_z, a_x * b_y - a_y * b_x)
    )


def part_between(value: float, none: float, whole: float) -> float:
    """Return 0 up to ``none``, 1 from ``whole`` on, in proportion between."""
    return min(max((value - none) / (whole - none), 0.0), 1.0)


class SolesAndCom(Protocol):
    """Centre of mass and soles at one state.

    Attributes:
        p_com: (3,) centre of mass in the world [m].
        v_com: (3,) its velocity [m/s].
        v_sole: (12,) sole twists, sole frames [m/s, rad/s].
        R_world_sole: rotation of each sole.
        p_sole: position of each sole in the world [m].
    """

    p_com: Vec3
    v_com: Vec3
    v_sole: Array
    R_world_sole: list[Mat]
    p_sole: list[Vec3]


class Dynamics:
    """Rigid-body quantities at one state, computed by :meth:`update`.

    The arrays are reused: read them before the next update, and neither keep nor write
    them. Twists are [linear; angular], wrenches [force; moment]; sole quantities are in
    the sole frame (LOCAL).

    Attributes:
        q: (7 + n_a,) configuration.
        v: (n_v,) velocity.
        H_inv: (n_v, n_v) inverse of the inertia matrix, rotor inertia included.
        c: (n_v,) Coriolis, centrifugal and gravity terms.
        J_contact: (12, n_v) stacked sole Jacobians.
        Jdot_v_contact: (12,) their drift.
        J_com: (3, n_v) centre-of-mass Jacobian, world axes.
        Jdot_v_com: (3,) its drift [m/s^2].
        p_com: (3,) centre of mass in the world [m].
        v_com: (3,) its velocity [m/s].
        v_sole: (12,) sole twists.
        R_world_sole: rotation of each sole.
        p_sole: position of each sole in the world.
        X: (n_v, 12) H^-1 J_contact^T.
        Lambda_c_inv: (12, 12) inverse contact inertia, J_c H^-1 J_c^T.
        mobility: (12, 12) the same with locked and narrow leg joints held, and where
            there are such, the joints above the legs too: how the soles can yield. Its
            rank is lower if legs need these joints.
    """

    def __init__(self, model: RobotModel) -> None:
        """Allocate every array once."""
        self.model = model
        self._pin = model.pin_model
        self._data = self._pin.createData()
        n_v = model.n_v
        self._zero = np.zeros(n_v)
        self.q: Array = np.zeros(7 + model.n_a)
        self.v: Array = np.zeros(n_v)
        self.H_inv: Mat = np.zeros((n_v, n_v))
        self.c: Array = np.zeros(n_v)
        self.J_contact: Mat = np.zeros((12, n_v))
        self.Jdot_v_contact: Array = np.zeros(12)
        self.J_com: Mat = np.zeros((3, n_v))
        self.Jdot_v_com: Array = np.zeros(3)
        self.p_com: Array = np.zeros(3)
        self.v_com: Array = np.zeros(3)
        self.v_sole: Array = np.zeros(12)
        self.X: Mat = np.zeros((n_v, 12))
        self.Lambda_c_inv: Mat = np.zeros((12, 12))
        is_held = model.is_narrow & model.is_leg
        if is_held.any():
            is_held |= ~model.is_leg
        self._held = N_BASE_V + np.flatnonzero(is_held)
        self.mobility = np.zeros((12, 12)) if self._held.size else self.Lambda_c_inv
        self._below = np.tri(n_v, k=-1, dtype=bool)
        # Views of Pinocchio's results: requesting one anew costs more than reading.
        data = self._data
        self._Minv, self._nle, self._Jcom = data.Minv, data.nle, data.Jcom
        self._com, self._vcom, self._acom = data.com[0], data.vcom[0], data.acom[0]
        soles = [data.oMf[frame] for frame in model.sole_ids]
        self.R_world_sole = [sole.rotation for sole in soles]
        self.p_sole = [sole.translation for sole in soles]
        self._rows_of_soles = [
            (frame, self.J_contact[rows], self.Jdot_v_contact[rows])
            for frame, rows in zip(model.sole_ids, SOLE_ROWS, strict=True)
        ]

    def update(self, q: Array, v: Array) -> None:
        """Compute everything at a state.

        Args:
            q: (7 + n_a,) configuration.
            v: (n_v,) velocity, base twist in base first.
        """
        model, data = self._pin, self._data
        self.q[:] = q
        self.v[:] = v
        pin.computeMinverse(model, data, q)
        # Pinocchio fills the upper triangle only.
        self.H_inv[:] = self._Minv
        np.copyto(self.H_inv, self.H_inv.T.copy(), where=self._below)
        pin.computeAllTerms(model, data, q, v)
        self.c[:] = self._nle
        self.J_com[:] = self._Jcom
        # With zero joint acceleration, frame accelerations are the drift Jdot v.
        pin.centerOfMass(model, data, q, v, self._zero)
        self.p_com[:] = self._com
        self.v_com[:] = self._vcom
        self.Jdot_v_com[:] = self._acom
        for frame, J, Jdot_v in self._rows_of_soles:
            pin.updateFramePlacement(model, data, frame)
            J[:] = pin.getFrameJacobian(model, data, frame, pin.LOCAL)
            drift = pin.getFrameAcceleration(model, data, frame, pin.LOCAL)
            Jdot_v[:] = drift.vector
        self.J_contact.dot(v, out=self.v_sole)
        self.H_inv.dot(self.J_contact.T, out=self.X)
        self.J_contact.dot(self.X, out=self.Lambda_c_inv)
        if self._held.size:
            X, H_inv = self.X[self._held], self.H_inv[np.ix_(self._held, self._held)]
            held = X.T @ np.linalg.solve(H_inv, X)
            np.subtract(self.Lambda_c_inv, held, out=self.mobility)

    def inertia_matrix(self) -> Mat:
        """Return the (n_v, n_v) inertia matrix of the last update, for tests."""
        upper: Mat = np.triu(self._data.M)
        full: Mat = upper + np.triu(upper, 1).T
        return full

    def frame_placement(self, frame_id: int) -> tuple[Mat, Vec3]:
        """Return the pose of a frame in the world, which is the stance frame.

        Returns:
            (3, 3) rotation and (3,) position [m]; copies.
        """
        placement = pin.updateFramePlacement(self._pin, self._data, frame_id)
        return placement.rotation.copy(), placement.translation.copy()

    def frame_jacobian(self, frame_id: int) -> Mat:
        """Return the Jacobian of a frame's twist, in world axes.

        Returns:
            (6, n_v) J with J v = [velocity of the frame's origin; angular velocity].
        """
        J: Mat = pin.getFrameJacobian(
            self._pin, self._data, frame_id, pin.LOCAL_WORLD_ALIGNED
        )
        return J

    def frame_drift(self, frame_id: int) -> Array:
        """Return Jdot v of :meth:`frame_jacobian`.

        Returns:
            (6,) acceleration of the frame while vdot is zero [m/s^2, rad/s^2].
        """
        drift: Array = pin.getFrameClassicalAcceleration(
            self._pin, self._data, frame_id, pin.LOCAL_WORLD_ALIGNED
        ).vector
        return drift
