"""What of the accelerometer's reading is neither gravity nor motion.

A robot at rest cannot tell a biased accelerometer from a lean by that sensor alone.
Its feet tell two more things about where up is: the direction of the force they feel,
and where on the soles they feel it, below the centre of mass. Three witnesses then, of
three different sensors: whichever is off, the one in the middle is not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surefoot.schemas.arrays import Vec3

BIAS_LIMIT_M_S2 = 0.5
"""More than any accelerometer is off by [m/s^2]; a robot that is pulled at looks so."""
KNOWN_S = 0.5
"""After so long a mean is known, and what is far from it is a push, no bias [s]."""
SUDDEN_M_S2 = 0.1
"""By so much at most a reading counts as off the mean from then on [m/s^2]."""


class HorizontalBias:
    """Learns the accelerometer's bias along the base's x and y.

    Each witness is a comparison, at every tick, of the specific force that the
    accelerometer reports with that of the centre of mass as the feet show it. Their
    means are kept: of all readings at first, later of the last ``memory_s``, in which
    a drift shows but a push, however hard, does not.

    Attributes:
        bias: (3,) in base axes; z is left to the height [m/s^2].
    """

    def __init__(self, *, memory_s: float, period_s: float) -> None:
        """Begin without a bias.

        Args:
            memory_s: how long readings count.
            period_s: time between two of them [s].
        """
        self._least = period_s / memory_s
        self._known = round(KNOWN_S / period_s)
        self._count = 0
        self._by_force = [0.0, 0.0]
        self._by_pressure = [0.0, 0.0]
        self.bias: Vec3 = np.zeros(3)

    def learn(
        self,
        by_force: Sequence[float],
        by_pressure: Sequence[float],
        R_world_base: Sequence[Sequence[float]],
    ) -> None:
        """Take one tick's comparison.

        Args:
            by_force: (3,) specific force of the accelerometer less that which the
                feet's horizontal forces show, world axes [m/s^2].
            by_pressure: (3,) the same by where the soles are pressed.
            R_world_base: rows of the base's rotation.
        """
        self._count += 1
        gain = max(1.0 / self._count, self._least)
        x_axis, y_axis, _ = R_world_base
        for mean, seen in (
            (self._by_force, by_force),
            (self._by_pressure, by_pressure),
        ):
            x, y = seen[0], seen[1]
            for axis in (0, 1):
                in_base = x_axis[axis] * x + y_axis[axis] * y
                off = in_base - mean[axis]
                if self._count > self._known:
                    off = min(max(off, -SUDDEN_M_S2), SUDDEN_M_S2)
                mean[axis] += gain * off
        for axis in (0, 1):
            # The third witness is the accelerometer: not off at all.
            middle = sorted((0.0, self._by_force[axis], self._by_pressure[axis]))[1]
            self.bias[axis] = min(max(middle, -BIAS_LIMIT_M_S2), BIAS_LIMIT_M_S2)
