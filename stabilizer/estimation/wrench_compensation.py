"""From what the ankle sensors report to the ground's wrench at the soles."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array, Mat, Vec3, Vec6
from surefoot.stabilizer.model import GRAVITY, RobotModel, skew


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
    """Removes the weight below each sensor and shifts to the soles.

    The sensor reports the wrench from below on the ankle. Newton for the plate,
    its acceleration neglected: F_ground = F_sensor - plate weight. Both the shift and
    the weight's wrench, as a function of where up is, are constant matrices.
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
    """Return what both sensors read but for the weight of the foot below them.

    Args:
        model: the robot.
        mean: of readings of a robot at rest, both feet off the ground; the
            accelerometer tells where up is.

    Returns:
        (2, 6) [force; moment] of left and right, sensor frames [N, N m].
    """
    q = model.nominal_configuration()
    q[7:] = mean.q[model.to_model]
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, q)
    up_in_base = model.T_base_imu.rotation @ mean.linear_acceleration
    up_in_base /= np.linalg.norm(up_in_base)
    # Only the row of "up" counts: which way a sole looks is no matter for a weight.
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
