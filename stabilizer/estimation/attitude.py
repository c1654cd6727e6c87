"""Attitude of the IMU from gyroscope, accelerometer and leg kinematics.

Part of the estimator: readings of a tick in, R_world_imu out.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.stabilizer.model import GRAVITY

FEWEST_READINGS = 20
"""Fewest readings that can tell noise from turning ground."""
TILT_LEARNING, BIAS_LEARNING = 1.5, 1.0
"""Bandwidths times the time watched, after a start on turning ground [1]."""
LIKELY_BIAS_RAD_S = 0.02
"""Likely bias of a gyroscope [rad/s]."""
DOUBT_RAD_S, DOUBT_SHARE, DOUBT_CHANGE = 0.005, 0.1, 0.3
"""Doubt of a bias shown by gravity: from noise [rad/s], per rate of the ground [1], and
per change of that rate [1]."""
LEVEL_M_S2, ACCELERATES = 0.85, 1.5
"""Lean of ground that is taken for level, 5 deg; and mean acceleration of the ground
over its change as seen [1]."""
NOISE_S = 0.2
"""Time below which noise makes up most of the slopes of readings [s]."""
CERTAIN_S = 0.25
"""Time before which noise makes still ground seem to turn [s]."""
LEAST_KNOWN_S = 0.3
"""Least time watched: shorter ones make gains that noise would shake [s]."""
LEARNT_S = 10.0
"""Time after such a start in which rest of the ground is looked for [s]."""
REST_LAG_S = 0.2
"""Low-pass by which rest is noticed [s]."""
RESTLESS_AT_FIRST_RAD_S, RESTLESS_RAD_S = 0.05, 0.01
"""Change of rate above which ground is not at rest; a gyroscope's noise is less."""
FOUND_REST_S = 0.6
"""Time watched that counts once ground rests: the tilt is learnt anew [s]."""
OFF_RAD_S = 0.005
"""Change of the learnt bias that is told and followed faster. Ground that accelerates
for some seconds, as a vehicle does, changes it by 0.002 [rad/s]."""
OFF_KNOWN_S = 4.0
"""Time watched that counts once the bias has changed as much [s]."""
BIAS_LIMIT_RAD_S = 0.1
"""Largest bias of any gyroscope [rad/s]."""


class AttitudeFilter:
    """Velocity-aided complementary filter.

    The gyroscope is integrated. The accelerometer is integrated to a velocity, which is
    compared with that of the legs. A wrong tilt lets gravity leak into the former, so
    the difference corrects roll and pitch, and slowly the gyroscope's bias. The base's
    own swaying cancels out; it would not if gravity were read from the accelerometer
    directly. Yaw is integrated and corrected from outside (:meth:`pull_yaw`).

    With y the velocity difference and d the tilt error, both horizontal: dy/dt = g (d x
    z) - l_1 y and dd/dt = -(l_2 / g) (z x y), poles at the bandwidth. A start on
    turning ground hides tilt and bias. Both are then learnt faster, the less time has
    passed, and the bias at once when the ground comes to rest. A bias that changes
    later by more than OFF_RAD_S is learnt faster, too.

    Attributes:
        R_world_imu: (3, 3) rotation estimate.
        bias: (3,) gyroscope bias estimate [rad/s].
        rate: (3,) bias-free angular velocity in the IMU frame [rad/s].
        ground_turns: whether the ground was taken to turn while calibrating.
        surely_turns: whether it turned by more than any gyroscope's bias.
        gyro_is_off: whether the bias has changed since by more than OFF_RAD_S.
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
            still_rate: mean rate plus its change above which the ground turns: no
                gyroscope's bias is as large [rad/s].
            ahead: (3,) direction in the IMU frame whose level part is the world's x
                axis at the start.
            period_s: time between two updates [s].
        """
        self._dt = period_s
        self._bandwidth = tilt_bandwidth
        self._bias_pull = bias_gain / tilt_bandwidth
        self._known_s = LEAST_KNOWN_S
        self._level_share = 0.0
        self._still_rate = still_rate
        self._ahead = ahead.copy()
        self._count = 0
        self._R_first_imu: Mat = np.eye(3)
        # Rows: rate, felt acceleration, velocity by the legs. Moments: their sums,
        # times powers 0, 1, 2 of a reading's number.
        self._readings: Mat = np.zeros((3, 3))
        self._moments: Array = np.zeros((3, 3, 3))
        self.ground_turns = self.surely_turns = self.gyro_is_off = False
        self._known_bias = [0.0, 0.0, 0.0]
        self._rest: Vec3 = np.zeros(3)
        self._restless = RESTLESS_AT_FIRST_RAD_S
        self._is_at_rest = False
        self._v_x = 0.0
        self._v_y = 0.0
        self.R_world_imu: Mat = np.eye(3)
        self.bias: Vec3 = np.zeros(3)
        self.rate: Vec3 = np.zeros(3)
        self._rows = self.R_world_imu.tolist()

    def calibrate(
        self,
        gyro: Vec3,
        accel: Vec3,
        *,
        accel_bias: Vec3,
        leg_rate: Vec3,
        leg_velocity: Vec3,
        leg_up: Vec3,
    ) -> None:
        """Take one reading of a robot that keeps its posture.

        The gyroscope is integrated. In the resulting frame gravity's direction stays
        fixed, but turns at the rate of the bias if there is one. If the ground does not
        turn by that measure, and its rate is steady, the mean rate is the bias.

        If the direction turns faster than any bias, it is not gravity's alone: the
        ground accelerates sideways. The less the mean tells about up, the more the
        soles are taken to stand level.

        Args:
            gyro: (3,) angular velocity in the IMU frame [rad/s].
            accel: (3,) specific force in the IMU frame [m/s^2].
            accel_bias: (3,) bias contained in ``accel`` [m/s^2].
            leg_rate: (3,) angular velocity that the legs see, IMU frame [rad/s].
            leg_velocity: (3,) velocity of the IMU by the legs, world, as for a
                gyroscope without bias [m/s].
            leg_up: (3,) normal of the soles, IMU frame.
        """
        if self._count:
            self._R_first_imu = self._R_first_imu @ pin.exp3(gyro * self._dt)
        self._count += 1
        self._known_s = max(self._count * self._dt, LEAST_KNOWN_S)
        R = self._R_first_imu
        rows = self._readings
        rows[0] = gyro - leg_rate
        rows[1] = R @ accel
        rows[2] = R @ (leg_velocity @ self.R_world_imu)
        for moment in self._moments:
            moment += rows
            rows *= self._count
        turn, up = self._judge()
        np.subtract(gyro, self.bias, out=self.rate)
        up += np.cross(turn, up) * (0.5 * self._dt * (self._count - 1))
        up = up @ R - self._believed(accel_bias)
        up /= np.linalg.norm(up)
        if self._level_share:
            up += self._level_share * (leg_up - up)
            up /= np.linalg.norm(up)
            # Known that much longer: the rest is the ground's motion, too.
            self._known_s /= (1.0 - self._level_share) ** 2
        x_axis = self._ahead - (self._ahead @ up) * up
        x_axis /= np.linalg.norm(x_axis)
        self.R_world_imu[:] = np.vstack((x_axis, np.cross(up, x_axis), up))
        self._rows = self.R_world_imu.tolist()

    def start_from(self, leg_velocity: Vec3) -> None:
        """Take a velocity as the IMU's own.

        Args:
            leg_velocity: (3,) velocity that the legs see, world [m/s].
        """
        self._v_x, self._v_y = leg_velocity.item(0), leg_velocity.item(1)
        self._known_bias[:] = self.bias.tolist()

    def _judge(self) -> tuple[Vec3, Vec3]:
        """Set the bias from the rates and directions of gravity so far.

        Returns:
            (3,) the bias [rad/s] and the mean felt acceleration at rest [m/s^2], both
            in the frame of the first reading.
        """
        count, R = self._count, self._R_first_imu
        mean, slope, bend = _parabola(self._moments, count)
        rate, rise, turned = mean[0], slope[0], slope[1]
        # The IMU's own acceleration is not gravity.
        felt = mean[1] - slope[2] / self._dt
        self.bias[:] = rate
        self.ground_turns = self.surely_turns = False
        self._level_share = 0.0
        if count < FEWEST_READINGS:
            return R @ rate, felt
        turned = turned - 2.0 * bend[2] / self._dt
        up = felt / np.linalg.norm(felt)
        by_gravity = np.cross(up, turned) @ R / (np.linalg.norm(felt) * self._dt)
        up = up @ R
        of_ground = rate - (rate @ up) * up - by_gravity
        change = count * float(np.linalg.norm(rise))
        turns = float(np.linalg.norm(of_ground)) + change
        is_too_much = np.linalg.norm(rate) > BIAS_LIMIT_RAD_S
        self.ground_turns = bool(turns > self._still_rate or is_too_much)
        self.surely_turns = bool(is_too_much or change > BIAS_LIMIT_RAD_S)
        if self.ground_turns:
            # Gravity's direction tells less the faster the ground turns; less still
            # while the rate changes, or after a short time.
            doubt = DOUBT_RAD_S + DOUBT_SHARE * turns
            if self._is_certain:
                doubt += DOUBT_CHANGE * change
                doubt += LIKELY_BIAS_RAD_S * (NOISE_S / (count * self._dt)) ** 2.5
            weight = LIKELY_BIAS_RAD_S**2 / (LIKELY_BIAS_RAD_S**2 + doubt**2)
            turn_rate = float(np.linalg.norm(by_gravity))
            self.bias[:] = weight * by_gravity if turn_rate < BIAS_LIMIT_RAD_S else 0.0
            if self._is_certain:
                sideways = ACCELERATES * turn_rate * GRAVITY * count * self._dt
                square = sideways * sideways
                self._level_share = square / (square + LEVEL_M_S2**2)
        return R @ self.bias, felt

    @property
    def _is_certain(self) -> bool:
        return self.surely_turns or self._count * self._dt >= CERTAIN_S

    def _believed(self, accel_bias: Vec3) -> Vec3:
        """Return the bias to subtract: little of what a short time has told."""
        if not (self.ground_turns and self._is_certain):
            return accel_bias
        square = (self._count * self._dt) ** 2
        return accel_bias * (square / (square + NOISE_S**2))

    def update(self, gyro: Vec3, accel: Vec3, *, leg_velocity: Vec3) -> None:
        """Advance by one period.

        Args:
            gyro: (3,) angular velocity in the IMU frame [rad/s].
            accel: (3,) specific force in the IMU frame [m/s^2].
            leg_velocity: (3,) velocity of the IMU that the legs saw one period ago,
                world [m/s].
        """
        dt = self._dt
        tilt_gain, velocity_gain, bias_gain = self._gains()
        row_x, row_y, _ = self._rows
        a_x, a_y, a_z = accel.tolist()
        y_x = leg_velocity.item(0) - self._v_x
        y_y = leg_velocity.item(1) - self._v_y
        force_x = row_x[0] * a_x + row_x[1] * a_y + row_x[2] * a_z
        force_y = row_y[0] * a_x + row_y[1] * a_y + row_y[2] * a_z
        self._v_x += dt * (force_x + velocity_gain * y_x)
        self._v_y += dt * (force_y + velocity_gain * y_y)
        bias, rate, step = self.bias, self.rate, [0.0, 0.0, 0.0]
        for i, w in enumerate(gyro.tolist()):
            # z x y, in the IMU frame.
            turn = y_x * row_y[i] - y_y * row_x[i]
            bias[i] = b = bias.item(i) - bias_gain * dt * turn
            rate[i] = w - b
            step[i] = (w - b + tilt_gain * turn) * dt
        self._rotate(step)
        self._notice()

    def _notice(self) -> None:
        """Learn faster once the bias has changed: it leans the robot until learnt."""
        now = self.bias.tolist()
        if self.looks_for_rest:  # the first one is not known yet
            self._known_bias[:] = now
        elif math.dist(now, self._known_bias) > OFF_RAD_S:
            self.gyro_is_off = True
            self._known_bias[:] = now
            self._known_s = OFF_KNOWN_S

    @property
    def looks_for_rest(self) -> bool:
        """Whether to call :meth:`rest_on`: soon after a start on turning ground."""
        is_early = self._known_s < LEARNT_S and not self.gyro_is_off
        return self.ground_turns and is_early

    def rest_on(self, leg_rate: Vec3) -> None:
        """Learn the bias once turning ground has come to rest.

        Turning ground hides the bias, and gravity's direction may be wrong by as much:
        a rocking robot looks the same. The ground is at rest once the gyroscope reads a
        constant for a while that is no more than a bias.

        Args:
            leg_rate: (3,) angular velocity that the legs see, IMU frame [rad/s].
        """
        blend = self._dt / REST_LAG_S
        change = self.rate - leg_rate - self._rest
        self._rest += blend * change
        size = math.sqrt(change @ change)
        self._restless += blend * (size - self._restless)
        if self._restless > RESTLESS_RAD_S:
            return
        whole = self.bias + self._rest
        if math.sqrt(whole @ whole) < self._still_rate:
            if not self._is_at_rest:
                self._is_at_rest = True
                self._known_s = min(self._known_s, FOUND_REST_S)
            step = blend * self._rest
            self.bias += step
            self._rest -= step

    def _gains(self) -> tuple[float, float, float]:
        """Return l_2 / g, l_1 and l_3 / g."""
        bandwidth, pull = self._bandwidth, self._bias_pull
        if self.ground_turns or self.gyro_is_off:
            self._known_s += self._dt
            bandwidth = max(bandwidth, TILT_LEARNING / self._known_s)
            pull = max(pull, BIAS_LEARNING / self._known_s)
        tilt_gain = bandwidth * bandwidth / GRAVITY
        return tilt_gain, 1.4 * bandwidth, tilt_gain * pull

    def pull_yaw(self, angle: float) -> None:
        """Turn the estimate about the world's vertical.

        Args:
            angle: rotation to apply, counter-clockwise from above [rad].
        """
        cos, sin = math.cos(angle), math.sin(angle)
        (x_x, x_y, x_z), (y_x, y_y, y_z), row_z = self._rows
        self._rows = [
            [cos * x_x - sin * y_x, cos * x_y - sin * y_y, cos * x_z - sin * y_z],
            [sin * x_x + cos * y_x, sin * x_y + cos * y_y, sin * x_z + cos * y_z],
            row_z,
        ]
        self.R_world_imu[:] = self._rows

    def _rotate(self, step: list[float]) -> None:
        """Turn R to R exp(skew(step)) by Rodrigues' formula; rows keep length 1."""
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


def _parabola(moments: Array, count: int) -> Array:
    """Fit a parabola through readings number 1, 2, ...

    Args:
        moments: (3, ...) sums of the readings times the powers 0, 1, 2 of their number.
        count: number of readings.

    Returns:
        (3, ...) mean, c_1 and c_2 of c_0 + c_1 x + c_2 x^2, with x counted from the
        middle; c_1 and c_2 are zero for too few readings.
    """
    total, first, second = moments
    middle = 0.5 * (count + 1)
    square = (count**2 - 1) / 12.0
    fit = np.zeros_like(moments)
    fit[0] = total / count
    if count > 2:
        fit[1] = (first - middle * total) / (count * square)
        about_middle = second - 2.0 * middle * first + middle**2 * total
        spread = count * (count**2 - 1) * (count**2 - 4) / 180.0
        fit[2] = (about_middle - square * total) / spread
    return fit
