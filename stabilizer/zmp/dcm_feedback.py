"""Feedback of the divergent component of motion: which force should act."""

from __future__ import annotations

import numpy as np

from schemas.arrays import Vec3
from schemas.zmp_settings import ZmpSettings
from stabilizer.zmp.averages import ExponentialAverage
from stabilizer.zmp.dcm_bias import DcmBiasEstimator
from stabilizer.zmp.pendulum import StandingPendulum

NOTHING = np.zeros(3)


class DcmFeedback:
    """PID-like law on the DCM; its integrator is an average.

    e = (c_d - c) + (cd_d - cd) / omega, horizontal;
    cdd* = cdd_d + omega (k_p e + (cd_d - cd) + k_i avg(e) + k_d d), where d is the
    DCM's velocity error of the pendulum model without its own average. A bias of e can
    be estimated and taken off first.

    Attributes:
        error: (3,) e of the last update, without the bias [m].
        estimator: of the bias; runs when the settings ask for it.
    """

    def __init__(self, settings: ZmpSettings, *, period_s: float) -> None:
        """Begins without memory."""
        self._kp, self._ki, self._kd = (
            settings.dcm_kp,
            settings.dcm_ki,
            settings.dcm_kd,
        )
        self.average = ExponentialAverage(
            time_constant_s=settings.dcm_average_s,
            limit=settings.dcm_average_limit_m,
            period_s=period_s,
        )
        self.offset = ExponentialAverage(
            time_constant_s=settings.dcm_derivator_s, period_s=period_s
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
        """Computes the acceleration that should act.

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
        wanted: Vec3 = pendulum.acceleration + omega * feedback
        return wanted

    def _corrected(
        self, error: Vec3, velocity_error: Vec3, omega: float
    ) -> tuple[Vec3, Vec3]:
        """Both errors without the bias; filtered, the velocity follows from the DCM."""
        bias = self.estimator.bias
        if self._correction == "bias":
            return error - bias, velocity_error
        filtered = self.estimator.error.copy()
        # omega times the filtered DCM error less the CoM error without its bias.
        return filtered, velocity_error + omega * (filtered - error + bias)
