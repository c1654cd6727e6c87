"""Attitude of the inertial unit from gyroscope, accelerometer and leg kinematics."""

from __future__ import annotations

import math

import numpy as np

from schemas.arrays import Mat, Vec3
from stabilizer.model import GRAVITY


class AttitudeFilter:
    """Velocity-aided complementary filter.

    The gyroscope is integrated; the accelerometer, integrated once to a velocity, is
    compared with the velocity that the legs see. A wrong tilt lets gravity leak into
    that velocity, so the difference corrects roll and pitch, and slowly the
    gyroscope's bias. The base's own swaying cancels out of the comparison, as it
    would not if gravity were read from the accelerometer directly. Yaw is integrated
    and corrected from outside (:meth:`pull_yaw`).

    With y the velocity difference and d the tilt error, both horizontal:
    dy/dt = g (d x z) - l_1 y and dd/dt = -(l_2 / g) (z x y), poles at the bandwidth.

    Attributes:
        R_world_imu: (3, 3) rotation estimate.
        bias: (3,) gyroscope bias estimate [rad/s].
        rate: (3,) bias-free angular velocity in the IMU frame [rad/s].
    """

    def __init__(
        self, *, tilt_bandwidth: float, bias_gain: float, period_s: float
    ) -> None:
        """Sets the gains.

        Args:
            tilt_bandwidth: correction of roll and pitch [rad/s].
            bias_gain: learning of the gyroscope's bias [1/s^2].
            period_s: time between two updates [s].
        """
        self._dt = period_s
        self._velocity_gain = 1.4 * tilt_bandwidth
        self._tilt_gain = tilt_bandwidth**2 / GRAVITY
        self._bias_gain = bias_gain * tilt_bandwidth / GRAVITY
        self._count = 0
        self._accel_sum: Vec3 = np.zeros(3)
        self._bias_sum: Vec3 = np.zeros(3)
        self._first_velocity: Vec3 = np.zeros(3)
        self._v_x = 0.0
        self._v_y = 0.0
        self.R_world_imu: Mat = np.eye(3)
        self.bias: Vec3 = np.zeros(3)
        self.rate: Vec3 = np.zeros(3)

    def calibrate(
        self, gyro: Vec3, accel: Vec3, *, leg_rate: Vec3, leg_velocity: Vec3
    ) -> None:
        """Takes one reading of a robot that stands on still, level ground.

        Args:
            gyro: (3,) angular velocity in the IMU frame [rad/s].
            accel: (3,) specific force in the IMU frame [m/s^2].
            leg_rate: (3,) angular velocity that the legs see, IMU frame [rad/s].
            leg_velocity: (3,) velocity of the unit that the legs see, world [m/s].
        """
        if self._count == 0:
            self._first_velocity[:] = leg_velocity
        self._count += 1
        self._accel_sum += accel
        self._bias_sum += gyro - leg_rate
        np.divide(self._bias_sum, self._count, out=self.bias)
        np.subtract(gyro, self.bias, out=self.rate)
        # What the unit sped up in the meantime is not gravity.
        gained = (leg_velocity - self._first_velocity) / self._dt
        up = self._accel_sum - gained @ self.R_world_imu
        up /= np.linalg.norm(up)
        x_axis = np.array([1.0, 0.0, 0.0]) - up[0] * up
        x_axis /= np.linalg.norm(x_axis)
        self.R_world_imu[:] = np.vstack((x_axis, np.cross(up, x_axis), up))
        self._v_x, self._v_y = float(leg_velocity[0]), float(leg_velocity[1])

    def update(self, gyro: Vec3, accel: Vec3, *, leg_velocity: Vec3) -> None:
        """Advances by one period.

        Args:
            gyro: (3,) angular velocity in the IMU frame [rad/s].
            accel: (3,) specific force in the IMU frame [m/s^2].
            leg_velocity: (3,) velocity of the unit that the legs saw one period
                ago, world [m/s].
        """
        dt, R = self._dt, self.R_world_imu
        y_x = float(leg_velocity[0]) - self._v_x
        y_y = float(leg_velocity[1]) - self._v_y
        force = R @ accel
        self._v_x += dt * (float(force[0]) + self._velocity_gain * y_x)
        self._v_y += dt * (float(force[1]) + self._velocity_gain * y_y)
        # z x y, in the IMU frame.
        turn = y_x * R[1] - y_y * R[0]
        self.bias -= (self._bias_gain * dt) * turn
        np.subtract(gyro, self.bias, out=self.rate)
        step = (self.rate + self._tilt_gain * turn) * dt
        x, y, z = step.tolist()
        self._rotate(x, y, z)

    def pull_yaw(self, angle: float) -> None:
        """Turns the estimate about the world's vertical.

        Args:
            angle: rotation to apply, counter-clockwise from above [rad].
        """
        row_x, row_y = self.R_world_imu[0].copy(), self.R_world_imu[1]
        cos, sin = math.cos(angle), math.sin(angle)
        self.R_world_imu[0] = cos * row_x - sin * row_y
        self.R_world_imu[1] = sin * row_x + cos * row_y

    def _rotate(self, x: float, y: float, z: float) -> None:
        """R <- R exp(skew(x, y, z)) by Rodrigues' formula, kept orthonormal."""
        angle_squared = x * x + y * y + z * z
        # Series: the angle of one tick is a few milliradians at most.
        a = 1.0 - angle_squared / 6.0
        b = 0.5 - angle_squared / 24.0
        step = np.array(
            (
                (1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y),
                (b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x),
                (b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)),
            )
        )
        R = self.R_world_imu @ step
        # One Newton step towards the nearest rotation: R (3 I - R^T R) / 2.
        gram = R.T @ R
        gram *= -0.5
        gram[0, 0] += 1.5
        gram[1, 1] += 1.5
        gram[2, 2] += 1.5
        np.dot(R, gram, out=self.R_world_imu)
