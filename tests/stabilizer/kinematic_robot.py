"""Sensor readings of a robot that moves along a given path, without dynamics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from surefoot.robot_io.snapshot import Snapshot, SnapshotLayout
from surefoot.schemas.arrays import Array, Vec3
from surefoot.stabilizer.model import GRAVITY, RobotModel

STEP_S = 1e-4
"""Step of the differences that give velocity and acceleration [s]."""
Motion = Callable[[float], Array]
"""Takes the time [s]; returns the configuration (7 + n_a,) in model order."""


@dataclass(frozen=True)
class Biases:
    """Biases of the IMU in its own frame: what it reads too much."""

    gyro: Vec3
    accel: Vec3


UNBIASED = Biases(gyro=np.zeros(3), accel=np.zeros(3))


class KinematicRobot:
    """Computes sensor readings along a motion.

    Attributes:
        motion: the true motion.
    """

    def __init__(self, model: RobotModel, motion: Motion) -> None:
        self._model = model
        self.motion = motion
        self._data = model.pin_model.createData()
        self._imu = model.pin_model.getFrameId(model.robot.file.imu.frame)

    def velocity(self, time_s: float) -> Array:
        """Return (n_v,) the true velocity, base twist in base."""
        behind, ahead = self.motion(time_s - STEP_S), self.motion(time_s + STEP_S)
        step: Array = pin.difference(self._model.pin_model, behind, ahead)
        return step / (2.0 * STEP_S)

    def acceleration(self, time_s: float) -> Array:
        """Return (n_v,) the true acceleration."""
        change = self.velocity(time_s + STEP_S) - self.velocity(time_s - STEP_S)
        rate: Array = change / (2.0 * STEP_S)
        return rate

    def wrenches(self, time_s: float, *, left_share: float = 0.5) -> Array:
        """Return (12,) the soles' wrenches for this motion, with a given load share."""
        model, data = self._model, self._data
        q, v = self.motion(time_s), self.velocity(time_s)
        forces = pin.rnea(model.pin_model, data, q, v, self.acceleration(time_s))
        on_base = pin.Force(forces[:6])
        pin.framesForwardKinematics(model.pin_model, data, q)
        T_world_base = data.oMi[1]
        return np.concatenate(
            [
                share * (data.oMf[sole].actInv(T_world_base.act(on_base))).vector
                for sole, share in zip(
                    model.sole_ids, (left_share, 1.0 - left_share), strict=True
                )
            ]
        )

    def snapshot(self, time_s: float, biases: Biases = UNBIASED) -> Snapshot:
        """Return the readings of joints and IMU; all other sensors read zero."""
        model, data = self._model, self._data
        q, v = self.motion(time_s), self.velocity(time_s)
        pin.forwardKinematics(model.pin_model, data, q, v, self.acceleration(time_s))
        placement = pin.updateFramePlacement(model.pin_model, data, self._imu)
        arguments = (model.pin_model, data, self._imu, pin.LOCAL)
        rate = pin.getFrameVelocity(*arguments).angular
        acceleration = pin.getFrameClassicalAcceleration(*arguments).linear
        up = placement.rotation.T @ np.array([0.0, 0.0, GRAVITY])
        layout = SnapshotLayout(model.n_a)
        return replace(
            layout.view(0, 0, np.zeros(layout.size)),
            q=q[7:][model.to_bus],
            dq=v[6:][model.to_bus],
            quat_xyzw=pin.Quaternion(placement.rotation).coeffs().copy(),
            angular_velocity=rate + biases.gyro,
            linear_acceleration=acceleration + up + biases.accel,
        )


class StandingOnSoles:
    """Places the base so that the left sole keeps its place."""

    def __init__(self, model: RobotModel) -> None:
        self._model = model.pin_model
        self._data = self._model.createData()
        self._sole = model.sole_ids[0]
        self._q = model.nominal_configuration()
        pin.framesForwardKinematics(self._model, self._data, self._q)
        self._T_world_sole = self._data.oMf[self._sole].copy()
        self._T_world_base = pin.XYZQUATToSE3(self._q[:7])

    def __call__(self, joints: Array) -> Array:
        """Return (7 + n_a,) the configuration with these joints (n_a,), model order."""
        q = self._q.copy()
        q[7:] = joints
        pin.framesForwardKinematics(self._model, self._data, q)
        T_sole_base = self._data.oMf[self._sole].actInv(self._T_world_base)
        q[:7] = pin.SE3ToXYZQUAT(self._T_world_sole * T_sole_base)
        return q


def joint_offsets(model: RobotModel, **by_kind: float) -> Array:
    """Return (n_a,) the same offset for joints of a kind in both legs [rad].

    Args:
        model: defines the order.
        **by_kind: offset by kind, such as ``ankle_pitch=0.1``.
    """
    offsets = np.zeros(model.n_a)
    names = list(model.pin_model.names)[2:]
    for kind, value in by_kind.items():
        for side in ("left", "right"):
            offsets[names.index(f"{side}_{kind}")] = value
    return offsets
