"""White noise of one sensor, from its own stream of random numbers."""

from __future__ import annotations

import numpy as np

from schemas.arrays import Array

BLOCK_ROWS = 256
"""Samples drawn at a time; the stream does not depend on it."""


class Noise:
    """Gaussian noise plus a constant bias on each channel of a sensor.

    The stream advances by one standard normal number per channel and sample, noise
    or none, so that one setting never shifts another's random numbers.
    """

    def __init__(
        self, seed: np.random.SeedSequence, *, deviation: Array, bias: Array
    ) -> None:
        """Starts the stream.

        Args:
            seed: this sensor's own.
            deviation: (m,) standard deviation per sample, in the sensor's units.
            bias: (m,) added to every sample.
        """
        self._generator = np.random.default_rng(seed)
        self._deviation = deviation
        self._bias = bias
        self._silent = not np.any(deviation) and not np.any(bias)
        self._rows = np.empty((0, deviation.size))
        self._next = 0

    def add_to(self, reading: Array) -> None:
        """Disturbs one sample, (m,), in place."""
        if self._silent:
            return
        if self._next == len(self._rows):
            shape = (BLOCK_ROWS, self._deviation.size)
            self._rows = self._generator.standard_normal(shape)
            self._rows *= self._deviation
            self._rows += self._bias
            self._next = 0
        reading += self._rows[self._next]
        self._next += 1
