"""White noise and bias of all noisy sensors, each from its own random numbers."""

from __future__ import annotations

import numpy as np

from schemas.arrays import Array
from schemas.scenario import Sensors

BLOCK_ROWS = 256
"""Ticks drawn at a time; the streams do not depend on it."""

GYRO, ACCEL = slice(0, 3), slice(3, 6)
FT_LEFT, FT_RIGHT = slice(6, 12), slice(12, 18)
"""Channels of the readings that :meth:`SensorNoise.add_to` disturbs."""
CHANNELS = 18


class SensorNoise:
    """Gaussian noise plus a constant bias, on every axis of every noisy sensor.

    Each sensor's stream advances by one standard normal number per axis and tick,
    whatever the settings, so that one setting never shifts another's numbers.
    """

    def __init__(self, settings: Sensors, *, seed: int) -> None:
        """Starts the streams.

        Args:
            settings: standard deviations and biases.
            seed: of the run; each sensor gets a child of its own.
        """
        children = np.random.SeedSequence(seed).spawn(4)
        self._streams = [
            (np.random.default_rng(child), channels)
            for child, channels in zip(
                children, (FT_LEFT, FT_RIGHT, GYRO, ACCEL), strict=True
            )
        ]
        self._deviation = _by_channel(
            gyro=settings.gyro_noise_rad_s,
            accel=settings.accel_noise_m_s2,
            force=settings.force_noise_n,
            moment=settings.moment_noise_nm,
        )
        self._bias = _by_channel(
            gyro=settings.gyro_bias_rad_s,
            accel=settings.accel_bias_m_s2,
            force=settings.force_bias_n,
            moment=settings.moment_bias_nm,
        )
        self._silent = not self._deviation.any() and not self._bias.any()
        self._rows = np.empty((BLOCK_ROWS, CHANNELS))
        self._next = BLOCK_ROWS

    def add_to(self, readings: Array) -> None:
        """Disturbs the readings of one tick in place.

        Args:
            readings: (18,) gyroscope, accelerometer, left wrench, right wrench.
        """
        if self._silent:
            return
        if self._next == BLOCK_ROWS:
            self._draw()
        readings += self._rows[self._next]
        self._next += 1

    def _draw(self) -> None:
        for generator, channels in self._streams:
            block = self._rows[:, channels]
            block[:] = generator.standard_normal(block.shape)
        self._rows *= self._deviation
        self._rows += self._bias
        self._next = 0


def _by_channel(*, gyro: float, accel: float, force: float, moment: float) -> Array:
    """(18,) one value per kind of channel, spread over the channels."""
    values = np.empty(CHANNELS)
    values[GYRO], values[ACCEL] = gyro, accel
    for wrench in (FT_LEFT, FT_RIGHT):
        values[wrench] = np.repeat([force, moment], 3)
    return values
