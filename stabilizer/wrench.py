"""From what the ankle sensors report to the ground's wrench at the soles."""

from __future__ import annotations

import numpy as np

from schemas.arrays import Array, Mat, Vec3, Vec6
from stabilizer.model import GRAVITY, RobotModel, skew


def wrench_shift(R_sensor_sole: Mat, p_sensor_sole: Vec3) -> Mat:
    """(6, 6) map of a wrench from the sensor frame to the sole frame.

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
    its acceleration neglected: F_ground = F_sensor - plate weight.
    """

    def __init__(self, model: RobotModel) -> None:
        """Precomputes the constant maps."""
        self._shift = [
            wrench_shift(T.rotation, T.translation) for T in model.T_sensor_sole
        ]
        self._weight = [plate.mass * GRAVITY for plate in model.plates]
        self._lever = [plate.mass * GRAVITY * plate.com for plate in model.plates]
        self._R_sole_sensor = [T.rotation.T.copy() for T in model.T_sensor_sole]
        self._corrected = np.zeros(6)
        self.F_meas: Array = np.zeros(12)
        """(12,) measured wrenches of the ground on left and right sole."""

    def update(
        self, ft_left: Vec6, ft_right: Vec6, R_world_sole: list[Mat]
    ) -> Array:
        """Computes the sole wrenches.

        Args:
            ft_left: (6,) [force; moment] reported by the left sensor.
            ft_right: (6,) the same of the right sensor.
            R_world_sole: estimated rotation of each sole.

        Returns:
            (12,) ground on robot at the soles, in the sole frames; reused.
        """
        corrected = self._corrected
        for side, reported in enumerate((ft_left, ft_right)):
            # World's up axis in the sensor frame.
            up = R_world_sole[side][2] @ self._R_sole_sensor[side]
            lever = self._lever[side]
            corrected[:] = reported
            corrected[:3] += self._weight[side] * up
            corrected[3] += lever[1] * up[2] - lever[2] * up[1]
            corrected[4] += lever[2] * up[0] - lever[0] * up[2]
            corrected[5] += lever[0] * up[1] - lever[1] * up[0]
            np.dot(
                self._shift[side], corrected, out=self.F_meas[6 * side : 6 * side + 6]
            )
        return self.F_meas
