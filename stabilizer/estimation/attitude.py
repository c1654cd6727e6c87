"""Attitude of the IMU from gyroscope, accelerometer and leg kinematics."""

from __future__ import annotations

import math

import numpy as np

from surefoot.schemas.arrays import Mat, Vec3
from surefoot.stabilizer.model import GRAVITY

FEWEST_READINGS = 20
"""From fewer readings nobody can tell noise from ground that turns."""


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
        self,
        *,
        tilt_bandwidth: float,
        bias_gain: float,
        still_rate: float,
        ahead: Vec3,
        period_s: float,
    ) -> None:
        """Set the gains.

        Args:
            tilt_bandwidth: correction of roll and pitch [rad/s].
            bias_gain: learning of the gyroscope's bias [1/s^2].
            still_rate: a mean rate and a change of it, together more than this, are
                no gyroscope's bias, but ground that turns [rad/s].
            ahead: (3,) direction in the unit's frame that is the world's x, as far as
                it is level, at the start.
            period_s: time between two updates [s].
        """
        self._dt = period_s
        self._velocity_gain = 1.4 * tilt_bandwidth
        self._tilt_gain = tilt_bandwidth**2 / GRAVITY
        self._bias_gain = bias_gain * tilt_bandwidth / GRAVITY
        self._still_rate = still_rate
        self._ahead = ahead.copy()
        self._count = 0
        self._accel_sum: Vec3 = np.zeros(3)
        self._is_turning = self._is_new_turn = False
        self._rate_sum: Vec3 = np.zeros(3)
        self._rising_sum: Vec3 = np.zeros(3)
        self._first_velocity: Vec3 = np.zeros(3)
        self._v_x = 0.0
        self._v_y = 0.0
        self.R_world_imu: Mat = np.eye(3)
        self.bias: Vec3 = np.zeros(3)
        self.rate: Vec3 = np.zeros(3)
        self._rows = self.R_world_imu.tolist()

    def calibrate(
        self, gyro: Vec3, accel: Vec3, *, leg_rate: Vec3, leg_velocity: Vec3
    ) -> None:
        """Take one reading of a robot that keeps its posture.

        On still ground the mean rate is the gyroscope's bias. Ground that turns shows
        by a rate that is large or changes: no bias is learnt then, and readings of
        the accelerometer, from there on, are turned along.

        Args:
            gyro: (3,) angular velocity in the IMU frame [rad/s].
            accel: (3,) specific force in the IMU frame [m/s^2].
            leg_rate: (3,) angular velocity that the legs see, IMU frame [rad/s].
            leg_velocity: (3,) velocity of the unit that the legs see, world [m/s].
        """
        if self._count == 0 or self._is_new_turn:
            self._first_velocity[:] = leg_velocity
            self._accel_sum[:] = 0.0
        self._count += 1
        rate = gyro - leg_rate
        self._rate_sum += rate
        self._rising_sum += self._count * rate
        np.divide(self._rate_sum, self._count, out=self.bias)
        turns = self._ground_turns()
        self._is_new_turn = turns and not self._is_turning
        self._is_turning = turns
        if turns:
            self.bias[:] = 0.0
            self._accel_sum -= self._dt * np.cross(gyro, self._accel_sum)
        self._accel_sum += accel
        np.subtract(gyro, self.bias, out=self.rate)
        # What the unit sped up in the meantime is not gravity.
        gained = (leg_velocity - self._first_velocity) / self._dt
        up = self._accel_sum - gained @ self.R_world_imu
        up /= np.linalg.norm(up)
        x_axis = self._ahead - (self._ahead @ up) * up
        x_axis /= np.linalg.norm(x_axis)
        self.R_world_imu[:] = np.vstack((x_axis, np.cross(up, x_axis), up))
        self._rows = self.R_world_imu.tolist()
        self._v_x, self._v_y = float(leg_velocity[0]), float(leg_velocity[1])

    def _ground_turns(self) -> bool:
        """Tell whether the rates so far are too large or change too much for a bias."""
        count = self._count
        if count < FEWEST_READINGS:
            return False
        # What a straight line through the rates rises by from first to last.
        middle = 0.5 * (count + 1)
        rise = (self._rising_sum - middle * self._rate_sum) * (12.0 / count**2)
        size = np.linalg.norm(self.bias) + np.linalg.norm(rise)
        return bool(size > self._still_rate)

    def update(self, gyro: Vec3, accel: Vec3, *, leg_velocity: Vec3) -> None:
        """Advance by one period.

        Args:
            gyro: (3,) angular velocity in the IMU frame [rad/s].
            accel: (3,) specific force in the IMU frame [m/s^2].
            leg_velocity: (3,) velocity of the unit that the legs saw one period
                ago, world [m/s].
        """
        dt = self._dt
        row_x, row_y, _ = self._rows
        a_x, a_y, a_z = accel.tolist()
        y_x = leg_velocity.item(0) - self._v_x
        y_y = leg_velocity.item(1) - self._v_y
        force_x = row_x[0] * a_x + row_x[1] * a_y + row_x[2] * a_z
        force_y = row_y[0] * a_x + row_y[1] * a_y + row_y[2] * a_z
        self._v_x += dt * (force_x + self._velocity_gain * y_x)
        self._v_y += dt * (force_y + self._velocity_gain * y_y)
        bias, rate, step = self.bias, self.rate, [0.0, 0.0, 0.0]
        for i, w in enumerate(gyro.tolist()):
            # z x y, in the IMU frame.
            turn = y_x * row_y[i] - y_y * row_x[i]
            bias[i] = b = bias.item(i) - self._bias_gain * dt * turn
            rate[i] = w - b
            step[i] = (w - b + self._tilt_gain * turn) * dt
        self._rotate(step)

    def pull_yaw(self, angle: float) -> None:
        """Turn the estimate about the world's vertical.

        Args:
            angle: rotation to apply, counter-clockwise from above [rad].
        """
        cos, sin = math.cos(angle), math.sin(angle)
        row_x, row_y, row_z = self._rows
        self._rows = [
            [cos * x - sin * y for x, y in zip(row_x, row_y, strict=True)],
            [sin * x + cos * y for x, y in zip(row_x, row_y, strict=True)],
            row_z,
        ]
        self.R_world_imu[:] = self._rows

    def _rotate(self, step: list[float]) -> None:
        """Turn R to R exp(skew(step)) by Rodrigues' formula, rows of length one."""
        x, y, z = step
        square = x * x + y * y + z * z
        # Series: the angle of one tick is a few milliradians at most.
        a = 1.0 - square / 6.0
        b = 0.5 - square / 24.0
        turned = []
        for r_x, r_y, r_z in self._rows:
            # Row of R times exp: r + a r x s + b ((r.s) s - |s|^2 r).
            along = b * (r_x * x + r_y * y + r_z * z)
            keep = 1.0 - b * square
            n_x = keep * r_x + a * (r_y * z - r_z * y) + along * x
            n_y = keep * r_y + a * (r_z * x - r_x * z) + along * y
            n_z = keep * r_z + a * (r_x * y - r_y * x) + along * z
            shrink = 1.5 - 0.5 * (n_x * n_x + n_y * n_y + n_z * n_z)
            turned.append([n_x * shrink, n_y * shrink, n_z * shrink])
        self._rows = turned
        self.R_world_imu[:] = turned
