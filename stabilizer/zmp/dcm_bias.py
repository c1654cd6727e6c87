"""Estimate of a constant error in the measured centre of mass, from the DCM's law."""

from __future__ import annotations

import math

import numpy as np

from surefoot.schemas.arrays import Mat, Vec3
from surefoot.schemas.zmp_settings import ZmpSettings

ORIGINAL_PERIOD_S = 0.005
"""Period of the published standard deviations [s]."""
FIRST_STD_M = 0.01
"""Initial standard deviation of DCM error and bias [m]."""


class DcmBiasEstimator:
    """Kalman filter of the DCM error e and of the bias b that is measured on top.

    A model with misplaced masses puts the centre of mass beside its true place. The
    pendulum separates the two: a true error e diverges from the ZMP error z with
    de/dt = omega (e - z), a bias does not. Per tick, with a = exp(omega dt):

        e <- a e + (1 - a) z of the tick before,   b <- b turned with the base,
        measured: e + b.

    Noise is the same along x and y, so both axes share one covariance, which turning
    leaves as it is. The variances scale with the period, so that any rate gives the
    same filter. After Caron's stabilizer in mc_rtc (``dcm_bias``), which uses
    the estimator of Benallegue's state-observation library.

    Attributes:
        error: (3,) e, horizontal, world frame [m].
        bias: (3,) b, horizontal, world frame [m].
        covariance: (2, 2) of (e, b) along either axis [m^2].
    """

    def __init__(self, settings: ZmpSettings, *, period_s: float) -> None:
        """Initialise; the filter starts with the first update.

        Args:
            settings: standard deviations and limit.
            period_s: time between two updates [s].
        """
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
            yaw: heading of the base, with which the bias turns [rad].
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
    """Return a horizontal vector turned about the vertical."""
    cos, sin = math.cos(angle), math.sin(angle)
    x, y, _ = vector
    return np.array([cos * x - sin * y, sin * x + cos * y, 0.0])
