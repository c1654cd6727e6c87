"""Filters with a memory; all know the period, so any rate gives the same law."""

from __future__ import annotations

import math

import numpy as np

from schemas.arrays import Vec3

SHORTEST_PERIODS = 2.0
"""A time constant is never taken shorter than so many periods."""


class ExponentialAverage:
    """Exponential moving average, clamped: the baseline's "integrator".

    It forgets with its time constant, so it never holds more than the error itself:
    a constant error gives that error, not a ramp.

    Attributes:
        value: (3,) the average.
    """

    def __init__(
        self, *, time_constant_s: float, period_s: float, limit: float = math.inf
    ) -> None:
        """Begins at zero.

        Args:
            time_constant_s: of the forgetting [s].
            period_s: time between two updates [s].
            limit: largest magnitude per axis.
        """
        time_constant_s = max(time_constant_s, SHORTEST_PERIODS * period_s)
        self._blend = -math.expm1(-period_s / time_constant_s)
        self._limit = limit
        self.value: Vec3 = np.zeros(3)

    def update(self, x: Vec3) -> Vec3:
        """Takes one more value.

        Returns:
            (3,) the average, reused by the next call.
        """
        self.value += self._blend * (x - self.value)
        np.clip(self.value, -self._limit, self._limit, out=self.value)
        return self.value

    def reset(self) -> None:
        """Forgets everything."""
        self.value[:] = 0.0


class LeakyIntegrator:
    """Clamped integral that returns to zero by itself.

    Attributes:
        value: (3,) the integral.
    """

    def __init__(self, *, leak: float, limit: float, period_s: float) -> None:
        """Begins at zero.

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
        """Advances by one period; returns (3,) the integral, reused."""
        self.value *= self._keep
        self.value += self._dt * rate
        np.clip(self.value, -self._limit, self._limit, out=self.value)
        return self.value
