"""Joint encoders of finite resolution and the velocity derived from them."""

from __future__ import annotations

import math

import numpy as np

from schemas.arrays import Array

VELOCITY_FILTER_S = 0.005
"""Time constant of the low-pass behind the difference of two positions [s]."""


class Encoders:
    """Rounds positions to the encoder's steps and differentiates what is left.

    Velocity: first-order low-pass of (q_k - q_(k-1)) / period, discretised exactly.
    """

    def __init__(self, *, resolution_rad: float, period_s: float) -> None:
        """Starts without a past: the first velocity is zero.

        Args:
            resolution_rad: one encoder step; greater than zero.
            period_s: time between readings.
        """
        self._resolution = resolution_rad
        self._period = period_s
        self._gain = -math.expm1(-period_s / VELOCITY_FILTER_S)
        self._last: Array | None = None
        self._velocity: Array | None = None

    def read(self, q: Array) -> tuple[Array, Array]:
        """Reads the encoders once per tick.

        Args:
            q: (n_a,) true positions [rad].

        Returns:
            (n_a,) rounded positions [rad] and (n_a,) filtered velocities [rad/s],
            both new arrays.
        """
        rounded = np.rint(q / self._resolution) * self._resolution
        if self._last is None or self._velocity is None:
            velocity = np.zeros_like(rounded)
        else:
            difference = (rounded - self._last) / self._period
            velocity = self._velocity + self._gain * (difference - self._velocity)
        self._last, self._velocity = rounded, velocity
        return rounded, velocity
