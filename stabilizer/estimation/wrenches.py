"""Wrenches at ankles and soles, from sensors or from joint efforts and dynamics.

Order in a tick: virtual wrenches, sensor health, force offsets, compensation.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array, Mat, Vec3, Vec6
from surefoot.schemas.robot_file import VirtualForceTorque
from surefoot.stabilizer.dynamics import SOLE_ROWS
from surefoot.stabilizer.model import (
    GRAVITY,
    N_BASE_Q,
    N_BASE_V,
    RobotModel,
    inertia_below,
    skew,
)

EFFORT_NM = 1.0
"""Assumed error of a leg's equation: friction and errors of the efforts."""
PRIOR_N, PRIOR_NM = 1000.0, 100.0
"""Expected size of an ankle's forces and moments. It bounds what the joints hardly
feel, such as the load along a straight leg."""
OFFSET_EVERY_S, OFFSET_CUTOFF_HZ = 0.02, 5.0
"""Period of comparing forces along the sole, and cutoff of following them."""
OFFSET_MEMORY_S, OFFSET_COUNT = 1.0, 4
"""Averaging time of the comparison, and fewest comparisons that count."""
SUDDEN_COUNT = 6
"""Deviations in a row after which the average restarts; impacts are shorter."""
OFFSET_SHARE = 0.2
"""Part of the weight: less may be friction in the joints, or model error [1]."""


def wrench_shift(R_sensor_sole: Mat, p_sensor_sole: Vec3) -> Mat:
    """Return the (6, 6) map of a wrench from the sensor frame to the sole frame.

    Args:
        R_sensor_sole: rotation of the sole in the sensor frame.
        p_sensor_sole: sole origin in the sensor frame [m].

    Returns:
        X with ``F_sole = X @ F_sensor`` for [force; moment]: the force is rotated,
        the moment is taken about the sole origin. X is the transpose of the map of
        twists from sole to sensor, so power is the same in both frames.
    """
    R = R_sensor_sole.T
    X = np.zeros((6, 6))
    X[:3, :3] = R
    X[3:, 3:] = R
    X[3:, :3] = -R @ skew(p_sensor_sole)
    return X


class WrenchCompensation:
    """Removes the weight below each sensor and shifts the wrench to the sole.

    The sensor reports the wrench from below on the ankle. Newton for the plate, its
    acceleration neglected: F_ground = F_sensor - plate weight. Both the shift and the
    weight's wrench, as a function of up, are constant matrices.
    """

    def __init__(self, model: RobotModel) -> None:
        """Precompute the constant maps."""
        self._shift = np.zeros((12, 12))
        self._weight = np.zeros((12, 6))
        for side, (T, plate) in enumerate(
            zip(model.T_sensor_sole, model.plates, strict=True)
        ):
            rows = slice(6 * side, 6 * side + 6)
            shift = wrench_shift(T.rotation, T.translation)
            self._shift[rows, rows] = shift
            # Wrench against gravity, sensor frame: [m g up; com x m g up].
            lift = plate.mass * GRAVITY * np.vstack((np.eye(3), skew(plate.com)))
            self._weight[rows, 3 * side : 3 * side + 3] = shift @ lift @ T.rotation
        self._reported = np.zeros(12)
        self._up = np.zeros(6)
        self._lift = np.zeros(12)
        self.F_meas: Array = np.zeros(12)
        """(12,) measured wrenches of the ground on left and right sole."""

    def update(self, ft_left: Vec6, ft_right: Vec6, R_world_sole: list[Mat]) -> Array:
        """Compute the sole wrenches.

        Args:
            ft_left: (6,) [force; moment] reported by the left sensor.
            ft_right: (6,) the same of the right sensor.
            R_world_sole: estimated rotation of each sole.

        Returns:
            (12,) ground on robot at the soles, in the sole frames; reused.
        """
        reported, up = self._reported, self._up
        reported[:6] = ft_left
        reported[6:] = ft_right
        # World's up axis in the sole frames.
        up[:3] = R_world_sole[0][2]
        up[3:] = R_world_sole[1][2]
        self._shift.dot(reported, out=self.F_meas)
        self._weight.dot(up, out=self._lift)
        self.F_meas += self._lift
        return self.F_meas


def foot_offsets(model: RobotModel, mean: Snapshot) -> Array:
    """Return the offsets of both sensors: their readings without the foot's weight.

    Args:
        model: the robot.
        mean: mean of readings at rest with both feet off the ground; the accelerometer
            tells where up is.

    Returns:
        (2, 6) [force; moment] of left and right, sensor frames [N, N m].
    """
    q = model.nominal_configuration()
    q[7:] = mean.q[model.to_model]
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, q)
    up_in_base = model.T_base_imu.rotation @ mean.linear_acceleration
    up_in_base /= np.linalg.norm(up_in_base)
    # Only the row of "up" matters: the weight does not depend on the heading.
    R_world_sole = []
    for sole in model.sole_ids:
        R = np.zeros((3, 3))
        R[2] = data.oMf[sole].rotation.T @ up_in_base
        R_world_sole.append(R)
    at_soles = WrenchCompensation(model).update(
        mean.ft_left, mean.ft_right, R_world_sole
    )
    return np.array(
        [
            np.linalg.solve(wrench_shift(T.rotation, T.translation), wrench)
            for T, wrench in zip(
                model.T_sensor_sole, (at_soles[:6], at_soles[6:]), strict=True
            )
        ]
    )


class VirtualWrenches:
    """A momentum observer of the legs, in a frame that moves with the IMU.

    The momentum of the leg joints changes by gravity, by their efforts and by the ankle
    wrenches; what gravity and efforts leave unexplained are the wrenches. In a frame
    that moves with the IMU without turning, gravity is what the accelerometer feels, so
    neither the base's nor the ground's velocity is needed::

        p = (H v)_legs,  r = K (p - p_0 - integral((C^T v)_legs - g_legs + tau + r) dt)

    and r follows J^T F as a first-order low-pass of bandwidth K (De Luca and Mattone,
    Actuator failure detection and isolation using generalized momenta, ICRA 2003). The
    parts below the sensors' place are not in the model, so F is what a sensor there
    would report.

    Pure: no clock. Efforts that are all zero count as missing. F is then not finite,
    which the sensors' health takes for a lost sensor.
    """

    def __init__(
        self, model: RobotModel, settings: VirtualForceTorque, *, period_s: float
    ) -> None:
        """Remove the plates from a copy of the model."""
        self._model, self._dt = model, period_s
        self._pin = pin.Model(model.pin_model)
        self._data = self._pin.createData()
        links = [foot.ft_link for foot in model.robot.file.foot]
        self._frames = [
            self._pin.getFrameId(link, pin.FrameType.BODY) for link in links
        ]
        for frame_id in self._frames:
            joint = self._pin.frames[frame_id].parentJoint
            rest = self._pin.inertias[joint].toDynamicParameters()
            plate = inertia_below(model.pin_model, frame_id).toDynamicParameters()
            rest -= plate
            self._pin.inertias[joint] = (
                pin.Inertia.FromDynamicParameters(rest)
                if rest[0] > 0.0  # mass; there is none where the plate is all
                else pin.Inertia.Zero()
            )
        # As a low-pass sampled exactly, so that slow ticks stay stable.
        rate = 2.0 * math.pi * settings.cutoff_hz
        self._gain = -math.expm1(-rate * period_s) / period_s
        self._rows = N_BASE_V + np.flatnonzero(model.is_leg)
        self._damping = model.robot.damping[model.to_model][model.is_leg]
        self._q: Array = np.zeros(N_BASE_Q + model.n_a)
        self._q[N_BASE_Q - 1] = 1.0
        self._v: Array = np.zeros(model.n_v)
        self._zero: Array = np.zeros(model.n_v)
        self._J: Mat = np.zeros((12, len(self._rows)))
        self._prior = np.diag(np.tile([PRIOR_N**-2] * 3 + [PRIOR_NM**-2] * 3, 2))
        self._explained: Array | None = None
        self._residual: Array = np.zeros(len(self._rows))

    def infer(self, snapshot: Snapshot) -> Snapshot:
        """Replace the ankle readings by the inferred wrenches.

        Args:
            snapshot: with efforts measured; to be called at every tick.
        """
        effort = snapshot.effort[self._model.to_model][self._model.is_leg]
        if not effort.any():
            nothing = np.full(6, np.nan)
            return replace(snapshot, ft_left=nothing, ft_right=nothing)
        momentum, drive = self._momentum_and_drive(snapshot, effort)
        if self._explained is None:  # at rest, momentum does not change
            self._residual = -drive
            self._explained = momentum - self._residual / self._gain
        else:
            self._explained += self._dt * (drive + self._residual)
            self._residual = self._gain * (momentum - self._explained)
        J = self._J
        information = J @ J.T / EFFORT_NM**2 + self._prior
        felt = J @ self._residual / EFFORT_NM**2
        F: Array = np.asarray(np.linalg.solve(information, felt), dtype=np.float64)
        if not np.isfinite(F.sum()):
            self._explained = None  # a reading that is no number ends with its tick
        left, right = SOLE_ROWS
        return replace(snapshot, ft_left=F[left], ft_right=F[right])

    def _momentum_and_drive(
        self, snapshot: Snapshot, effort: Array
    ) -> tuple[Array, Array]:
        """Return the leg joints' momentum and its drive without the ankles; fill J."""
        model, robot, data, rows = self._pin, self._model, self._data, self._rows
        q, v = self._q, self._v
        q[N_BASE_Q:] = snapshot.q[robot.to_model]
        R, p = robot.T_base_imu.rotation, robot.T_base_imu.translation
        w: Vec3 = R @ snapshot.angular_velocity
        v[:3] = np.cross(p, w)  # of the base's origin: w x (origin - IMU)
        v[3:N_BASE_V] = w
        v[N_BASE_V:] = snapshot.dq[robot.to_model]
        C = pin.computeCoriolisMatrix(model, data, q, v)
        drive = C.T.dot(v)[rows]
        model.gravity.linear = np.zeros(3)
        momentum: Array = pin.rnea(model, data, q, self._zero, v)[rows]
        model.gravity.linear = -(R @ snapshot.linear_acceleration)
        drive -= pin.computeGeneralizedGravity(model, data, q)[rows]
        drive += effort - self._damping * v[rows]
        pin.computeJointJacobians(model, data, q)
        for side, frame_id in zip(SOLE_ROWS, self._frames, strict=True):
            J = pin.getFrameJacobian(model, data, frame_id, pin.LOCAL)
            self._J[side] = J[:, rows]
        return momentum, drive


class ForceOffsets:
    """Removes offsets of the ankle sensors along the soles, which no joint feels.

    Two feet that push against each other move nothing, so accelerometer and attitude do
    not show such a force. The legs' efforts do: less exactly than a sensor, but well
    enough for an error that fells a robot. The efforts must explain the load on the
    feet, as those do that a driver reports in newton metres.

    Attributes:
        found: whether left and right sensor have had an offset.
        offsets: (2, 6) offsets of left and right sensor, sensor frames [N, N m].
    """

    def __init__(self, model: RobotModel) -> None:
        """Begin with sensors that are right."""
        robot = model.robot
        self._every = max(1, round(OFFSET_EVERY_S / robot.period_s))
        period_s = self._every * robot.period_s
        settings = VirtualForceTorque(cutoff_hz=OFFSET_CUTOFF_HZ)
        self._virtual = VirtualWrenches(model, settings, period_s=period_s)
        self._normals = robot.sole_normals
        self._limit = OFFSET_SHARE * model.weight
        self._least_gain = period_s / OFFSET_MEMORY_S
        self._ticks = self._count = self._sudden = 0
        self._gap: Array = np.zeros((2, 3))
        self.offsets: Array = np.zeros((2, 6))
        self.found = [False, False]

    def correct(self, snapshot: Snapshot) -> Snapshot:
        """Subtract the offsets found; without any the same object is returned.

        Args:
            snapshot: with efforts measured; to be called at every tick.
        """
        if self._ticks % self._every == 0:
            self._compare(snapshot)
        self._ticks += 1
        if not any(self.found):
            return snapshot
        left, right = self.offsets
        return replace(
            snapshot,
            ft_left=snapshot.ft_left - left,
            ft_right=snapshot.ft_right - right,
        )

    def _compare(self, snapshot: Snapshot) -> None:
        virtual = self._virtual.infer(snapshot)
        gap = np.stack((snapshot.ft_left[:3], snapshot.ft_right[:3]))
        gap -= np.stack((virtual.ft_left[:3], virtual.ft_right[:3]))
        if not np.isfinite(gap.sum()):
            return
        self._look_for_sudden(gap - self._gap)
        self._count += 1
        self._gap += max(1.0 / self._count, self._least_gain) * (gap - self._gap)
        normals = (self._gap * self._normals).sum(axis=1)
        # Efforts that do not explain the load explain nothing else.
        if self._count < OFFSET_COUNT or np.abs(normals).max() > self._limit:
            return
        for side, normal in enumerate(normals.tolist()):
            along = self._gap[side] - normal * self._normals[side]
            if math.sqrt(along @ along) > self._limit:
                self.found[side] = True
            if self.found[side]:
                self.offsets[side, :3] = along

    def _look_for_sudden(self, change: Array) -> None:
        """Restart the average when a force along a sole suddenly gets an offset.

        Args:
            change: (2, 3) deviation of a comparison from the average [N].
        """
        normals = (change * self._normals).sum(axis=1)
        along = change - normals[:, np.newaxis] * self._normals
        squares = (along * along).sum(axis=1).tolist()
        is_off = np.abs(normals).max() < self._limit < math.sqrt(max(squares))
        self._sudden = self._sudden + 1 if is_off and self._count else 0
        if self._sudden == SUDDEN_COUNT:
            self._sudden = self._count = 0
