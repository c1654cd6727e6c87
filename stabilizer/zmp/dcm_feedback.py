"""DCM feedback of the ZMP baseline: desired CoM acceleration, and a bias estimate."""

from __future__ import annotations

import math

import numpy as np

from surefoot.schemas.arrays import Mat, Vec3
from surefoot.schemas.law_settings import ZmpSettings
from surefoot.stabilizer.control.reference import Stance
from surefoot.stabilizer.model import GRAVITY, turn_level
from surefoot.stabilizer.walking.dcm import Point

ORIGINAL_PERIOD_S = 0.005
"""Period of the published standard deviations [s]."""
FIRST_STD_M = 0.01
"""Initial standard deviation of DCM error and bias [m]."""
SHORTEST_PERIODS = 2.0
"""Shortest time constant, in periods."""
STIFFNESS = 5.0
"""Pull of the pendulum to its target [1/s^2]."""
FARTHEST_M = 1.0
"""Distance to the target at which its pull stops growing [m]."""
LEAST_STIFFNESS = 1.0
"""Floor of the pendulum's omega^2, which is negative in free fall [1/s^2]."""


class DcmBiasEstimator:
    """Kalman filter of the DCM error e and the bias b in its measurement.

    A model with misplaced masses puts the centre of mass beside its true place. The
    pendulum separates error and bias: a true error e diverges from the ZMP error z with
    de/dt = omega (e - z), a bias does not. Per tick, with a = exp(omega dt):

        e <- a e + (1 - a) z of the tick before,   b <- b turned with the base,
        measured: e + b.

    Noise is the same along x and y, so both axes share one covariance, which a rotation
    leaves unchanged. The variances scale with the period, so that any rate gives the
    same filter. After Caron's stabilizer in mc_rtc (``dcm_bias``), which uses the
    estimator of Benallegue's state-observation library.

    Attributes:
        error: (3,) e, horizontal, world frame [m].
        bias: (3,) b, horizontal, world frame [m].
        covariance: (2, 2) of (e, b) along either axis [m^2].
    """

    def __init__(self, settings: ZmpSettings, *, period_s: float) -> None:
        """Initialise; the filter starts with the first update."""
        self._dt = period_s
        rates = ORIGINAL_PERIOD_S * period_s
        self._drift_variance = rates * settings.bias_drift_per_second_std_m**2
        self._zmp_variance = rates * settings.zmp_measure_error_std_m**2
        self._dcm_variance = (
            ORIGINAL_PERIOD_S / period_s * settings.dcm_measure_error_std_m**2
        )
        self._limit = settings.bias_limit_m
        self._zmp: Vec3 = np.zeros(3)
        self._yaw = 0.0
        self._is_running = False
        self.error: Vec3 = np.zeros(3)
        self.bias: Vec3 = np.zeros(3)
        self.covariance: Mat = np.zeros((2, 2))

    def reset(self) -> None:
        """Forget everything; the next update starts the filter again."""
        self._is_running = False
        self.bias[:] = 0.0

    def update(self, measured: Vec3, zmp: Vec3, *, omega: float, yaw: float) -> None:
        """Take one more measurement.

        Args:
            measured: (3,) DCM error, desired less measured, horizontal [m].
            zmp: (3,) ZMP error, desired less measured, horizontal [m].
            omega: natural frequency of the pendulum [rad/s].
            yaw: heading of the base; the bias turns with it [rad].
        """
        if self._is_running:
            self._predict(omega, yaw)
            self._correct(measured)
        else:
            self.error[:] = measured
            self.covariance[:] = FIRST_STD_M**2 * np.eye(2)
            self._is_running = True
        self._zmp[:] = zmp
        self._yaw = yaw
        self._limit_bias(yaw)

    def _predict(self, omega: float, yaw: float) -> None:
        growth = math.exp(omega * self._dt)
        self.error *= growth
        self.error += (1.0 - growth) * self._zmp
        self.bias[:] = _turned(self.bias, yaw - self._yaw)
        P = self.covariance
        P[0, 0] = growth * growth * P[0, 0] + omega * omega * self._zmp_variance
        P[0, 1] = P[1, 0] = growth * P[0, 1]
        P[1, 1] += self._drift_variance

    def _correct(self, measured: Vec3) -> None:
        P = self.covariance
        seen = P[0] + P[1]
        scale = float(seen[0] + seen[1]) + self._dcm_variance
        surprise = (measured - self.error - self.bias) / scale
        self.error += float(seen[0]) * surprise
        self.bias += float(seen[1]) * surprise
        P -= np.outer(seen, seen) / scale

    def _limit_bias(self, yaw: float) -> None:
        """Clamp the bias along the base's axes and add the rest to the error."""
        own = _turned(self.bias, -yaw)
        limited = _turned(np.clip(own, -self._limit, self._limit), yaw)
        self.error += self.bias - limited
        self.bias[:] = limited


def _turned(vector: Vec3, angle: float) -> Vec3:
    """Return a horizontal vector, turned about the vertical."""
    return np.array([*turn_level(vector[0], vector[1], angle), 0.0])


NOTHING = np.zeros(3)
DAMPING = 2.0 * math.sqrt(STIFFNESS)
UP = np.array([0.0, 0.0, 1.0])
GRAVITY_VECTOR = -GRAVITY * UP


class StandingPendulum:
    """CoM reference that settles over a target.

    Attributes:
        com: (3,) reference of the centre of mass [m].
        velocity: (3,) [m/s].
        acceleration: (3,) [m/s^2].
        zmp: (3,) ZMP of the pendulum [m].
        omega: natural frequency of the pendulum [rad/s].
    """

    def __init__(self, com: Vec3, *, period_s: float) -> None:
        """Begin at rest.

        Args:
            com: (3,) centre of mass, over ground at z = 0 [m].
            period_s: time between two updates [s].
        """
        self._dt = period_s
        self.com: Vec3 = com.copy()
        self.velocity: Vec3 = np.zeros(3)
        self.acceleration: Vec3 = np.zeros(3)
        self.zmp: Vec3 = com * (1.0, 1.0, 0.0)
        self.omega = math.sqrt(GRAVITY / com.item(2))

    def update(self, target: Vec3) -> None:
        """Advance by one period.

        Args:
            target: (3,) place where the centre of mass should come to rest; the centre
                of pressure then lies under it, at z = 0 [m].
        """
        dt = self._dt
        step = np.clip(target - self.com, -FARTHEST_M, FARTHEST_M)
        self.acceleration = STIFFNESS * step - DAMPING * self.velocity
        # n . (cdd - g) / n . (c - cop), with n straight up.
        stiffness = (self.acceleration.item(2) + GRAVITY) / self.com.item(2)
        stiffness = max(stiffness, LEAST_STIFFNESS)
        self.omega = math.sqrt(stiffness)
        self.zmp = self.com + (GRAVITY_VECTOR - self.acceleration) / stiffness
        self.com += dt * self.velocity + (0.5 * dt * dt) * self.acceleration
        self.velocity += dt * self.acceleration

    def follow(self, stance: Stance, *, zmp: Point, omega: float) -> None:
        """Take over the centre of mass of a walk.

        Args:
            stance: stance of the walk.
            zmp: desired ZMP [m].
            omega: of the walk's pendulum [rad/s].
        """
        self.com[:2] = stance.com[:2]
        self.velocity[:2] = stance.com_velocity[:2]
        self.acceleration = self.acceleration.copy()
        self.acceleration[:2] = stance.com_acceleration[:2]
        self.zmp[:2] = zmp
        self.omega = omega


class ExponentialMovingAverage:
    """Clamped exponential moving average: the baseline's "integrator".

    Old values fade with the time constant, so a constant error yields that error, not
    a ramp.

    Attributes:
        value: (3,) the average.
    """

    def __init__(
        self, *, time_constant_s: float, period_s: float, limit: float = math.inf
    ) -> None:
        """Begin at zero.

        Args:
            time_constant_s: time over which old values fade [s].
            period_s: time between two updates [s].
            limit: largest magnitude per axis.
        """
        time_constant_s = max(time_constant_s, SHORTEST_PERIODS * period_s)
        self._blend = -math.expm1(-period_s / time_constant_s)
        self._limit = limit
        self.value: Vec3 = np.zeros(3)

    def update(self, x: Vec3) -> Vec3:
        """Take one more value.

        Returns:
            (3,) the average, reused by the next call.
        """
        self.value += self._blend * (x - self.value)
        np.clip(self.value, -self._limit, self._limit, out=self.value)
        return self.value

    def reset(self) -> None:
        """Forget everything."""
        self.value[:] = 0.0


class LeakyIntegrator:
    """Clamped integral that returns to zero by itself.

    Attributes:
        value: (3,) the integral.
    """

    def __init__(self, *, leak: float, limit: float, period_s: float) -> None:
        """Begin at zero.

        Args:
            leak: rate of the return [1/s].
            limit: largest magnitude per axis.
            period_s: time between two updates [s].
        """
        self._keep = 1.0 - leak * period_s
        self._dt = period_s
        self._limit = limit
        self.value: Vec3 = np.zeros(3)

    def update(self, rate: Vec3) -> Vec3:
        """Advance by one period and return (3,) the integral, reused."""
        self.value *= self._keep
        self.value += self._dt * rate
        np.clip(self.value, -self._limit, self._limit, out=self.value)
        return self.value


class DcmFeedback:
    """PID-like law on the DCM whose integrator is a moving average.

    e = (c_d - c) + (cd_d - cd) / omega, horizontal;
    cdd* = cdd_d + omega (k_p e + (cd_d - cd) + k_i avg(e) + k_d d), where d is the
    DCM velocity error of the pendulum model less its own average. A bias of e can be
    estimated and subtracted first.

    Attributes:
        error: (3,) e of the last update, without the bias [m].
        estimator: of the bias; runs if ``zmp.dcm_bias`` is not "off".
    """

    def __init__(self, settings: ZmpSettings, *, period_s: float) -> None:
        """Start with all filters at zero."""
        self._kp, self._ki, self._kd = (
            settings.dcm_prop_gain,
            settings.dcm_integral_gain,
            settings.dcm_deriv_gain,
        )
        self.average = ExponentialMovingAverage(
            time_constant_s=settings.dcm_integrator_time_constant_s,
            limit=settings.max_average_dcm_error_m,
            period_s=period_s,
        )
        self.offset = ExponentialMovingAverage(
            time_constant_s=settings.dcm_derivator_time_constant_s, period_s=period_s
        )
        self.estimator = DcmBiasEstimator(settings, period_s=period_s)
        self._correction = settings.dcm_bias
        self.error: Vec3 = np.zeros(3)

    def update(
        self,
        pendulum: StandingPendulum,
        *,
        com: Vec3,
        velocity: Vec3,
        zmp: Vec3,
        in_air: bool,
        yaw: float = 0.0,
    ) -> Vec3:
        """Compute the desired CoM acceleration.

        Args:
            pendulum: reference.
            com: (3,) measured [m].
            velocity: (3,) measured [m/s].
            zmp: (3,) measured [m].
            in_air: whether no foot stands.
            yaw: heading of the base [rad].

        Returns:
            (3,) cdd* [m/s^2].
        """
        omega = pendulum.omega
        velocity_error = pendulum.velocity - velocity
        error = pendulum.com - com + velocity_error / omega
        error[2] = 0.0
        if in_air:
            self.offset.reset()
            self.estimator.reset()
            average, derivative = self.average.update(NOTHING), NOTHING
        else:
            zmp_error = pendulum.zmp - zmp
            zmp_error[2] = 0.0
            if self._correction != "off":
                self.estimator.update(error, zmp_error, omega=omega, yaw=yaw)
                error, velocity_error = self._corrected(error, velocity_error, omega)
            average = self.average.update(error)
            rate = omega * (error - zmp_error)
            derivative = rate - self.offset.update(rate)
        self.error = error
        feedback = self._kp * error + velocity_error
        feedback += self._ki * average + self._kd * derivative
        desired: Vec3 = pendulum.acceleration + omega * feedback
        return desired

    def _corrected(
        self, error: Vec3, velocity_error: Vec3, omega: float
    ) -> tuple[Vec3, Vec3]:
        """Subtract the bias from both errors; ``filter`` takes both from the filter."""
        bias = self.estimator.bias
        if self._correction == "bias":
            return error - bias, velocity_error
        filtered = self.estimator.error.copy()
        # omega times the filtered DCM error less the CoM error without its bias.
        return filtered, velocity_error + omega * (filtered - error + bias)
