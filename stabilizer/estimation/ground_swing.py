"""Ground that swings at one pace, as platforms do, told from the robot's height."""

from __future__ import annotations

import math

import numpy as np

from surefoot.schemas.arrays import Mat
from surefoot.stabilizer.dynamics import part_between

PACE_CUTOFF = 0.4
"""High-pass on the ground's motion from which the pace is read, in parts of the pace: a
drift of the accelerometer is no swing [1]."""
PACE_MEMORY_S = 2.0
"""Time over which the pace is read [s]."""
LIKELY_PACE, LEAST_SWING_M_S = 2.0, 1.5e-3
"""Pace assumed below this motion, integrated twice [rad/s], [m s]."""
SLOWEST, SLOW, FASTEST = 0.9, 1.0, 12.0
"""Slower ground is no swing; up to the second pace it is one in part; no pace is
assumed above the last [rad/s]."""
PURE_FROM, PURE = 0.85, 0.97
"""Squared correlation of motion and acceleration from which ground counts in part, and
fully, as a swing: 1 for a sine, less for waves of several lengths [1]."""
FROM_CYCLES, CYCLES = 0.25, 1.0
"""Cycles until a swing begins to count, and further ones until it counts fully [1]."""
LAG_S = 0.5
"""Time constant with which its share comes and goes [s]."""
COHERENT_CYCLES = 5.0
"""Cycles for which a swing keeps its amplitude and phase [1]."""
COVARIANCE_S = 0.01
"""Period at which the gains are renewed [s]."""
ACCELERATION_NOISE, BIAS_WALK = 1e-3, 1.4e-3
"""Noise of the acceleration [m/s^2 s^0.5] and of its bias [m/s^2 s^-0.5]."""
FLAT_M, MISFIT_S, CORRELATION_S = 2e-3, 3.0, 0.25
"""Motion that is no swing: least size [m], averaging time [s], correlation time [s]."""
HEIGHT_M, RATE_M_S, BIAS_M_S2, SWING = 1e-3, 1e-3, 2e-3, 1e-5
"""Standard deviations when ground that stood still begins to move."""
_SEEN = np.array([1.0, 0.0, 0.0, -1.0, 0.0])


class Pace:
    """Pace at which ground swings, and whether it has a single one.

    The ground's speed u, without its slow part, is integrated twice with a leak l:

        p' = u - l p,   x' = p - l x,   x'' = u - 2 l p + l^2 x

    For a swing x'' = -pace^2 x, whatever the filters, since both have passed them.

    Attributes:
        value: pace of the ground [rad/s].
        purity: squared correlation of x'' and x [1].
    """

    def __init__(self, *, period_s: float) -> None:
        """Begin on ground that has not moved yet."""
        self._dt = period_s
        self._blend = period_s / PACE_MEMORY_S
        self._way = self._sum = 0.0
        self._xx = self._xa = self._aa = 0.0
        self.value, self.purity = LIKELY_PACE, 0.0

    def update(self, speed: float) -> None:
        """Advance by one period.

        Args:
            speed: of the ground, without its slow part [m/s].
        """
        dt, blend = self._dt, self._blend
        leak = PACE_CUTOFF * max(self.value, SLOWEST)
        self._way += dt * (speed - leak * self._way)
        self._sum += dt * (self._way - leak * self._sum)
        x = self._sum
        a = speed - 2.0 * leak * self._way + leak * leak * x
        self._xx += blend * (x * x - self._xx)
        self._xa += blend * (x * a - self._xa)
        self._aa += blend * (a * a - self._aa)
        least = LEAST_SWING_M_S * LEAST_SWING_M_S
        square = (least * LIKELY_PACE**2 - self._xa) / (least + self._xx)
        self.value = math.sqrt(min(max(square, 0.25 * SLOWEST**2), FASTEST**2))
        powers = self._aa * self._xx
        self.purity = self._xa * self._xa / powers if powers > 0.0 else 0.0


class GroundSwing:
    """Estimates the swing of ground with one pace, so that the rest is height.

    On moving ground the legs' height differs from the estimate mostly because the
    ground has moved. A slow pull to it lets little of this in, but follows an
    accelerometer's drift as slowly. A swing can be predicted: with g the ground's
    height, w its pace and T the time it keeps,

        h' = rate,   rate' = acceleration - bias,   g'' = -w^2 g - 2 / T g',

    the legs see h - g, and a Kalman filter of these five states tells h from g by their
    pace. It treats all else as noise: the worse a swing fits, the slower is the pull.
    The filter's share is zero until the ground has swung for a while, and while it does
    not swing at one pace.

    Attributes:
        share: part to which the filter's gains are to be used [1].
        height: height of the ground by its swing [m].
        gains: k_1, k_2 and k_3 of the height filter.
    """

    def __init__(self, *, period_s: float) -> None:
        """Begin on ground that stands still.

        Args:
            period_s: time between two updates [s].
        """
        self._dt = period_s
        self._every = max(1, round(COVARIANCE_S / period_s))
        self._pace = Pace(period_s=period_s)
        self._ticks = 0
        self._cycles = self._misfit = 0.0
        self._speed = self.height = 0.0
        self._speed_gain = self._height_gain = 0.0
        self._F: Mat = np.eye(5)
        self._P: Mat = np.zeros((5, 5))
        self._moved = False
        self.share = 0.0
        self.gains = (0.0, 0.0, 0.0)

    def update(self, speed: float) -> None:
        """Learn the pace; to be called at every tick.

        Args:
            speed: of the ground, without its slow part [m/s].
        """
        self._pace.update(speed)

    def forget(self) -> None:
        """Assume no swing until the ground has swung again."""
        self._moved = False
        self.share = 0.0

    def follow(self, error: float, *, size: float, moves: float) -> float:
        """Advance by a tick on ground that moves.

        Args:
            error: height by the legs minus the estimated height [m].
            size: largest recent speed of the ground [m/s].
            moves: degree to which the ground counts as moving [1].

        Returns:
            The error without its part of the swing, as far as :attr:`share` goes [m].
        """
        dt, pace = self._dt, self._pace.value
        if not self._moved:
            self._begin()
        self._cycles += dt * pace / (2.0 * math.pi)
        if self._ticks % self._every == 0:
            self._renew(size / pace)
        self._ticks += 1
        rest = error + self.height
        self._misfit += dt / MISFIT_S * (rest * rest - self._misfit)
        spring = pace * pace * self.height + _damping(pace) * self._speed
        self._speed += dt * (self._speed_gain * rest - spring)
        self.height += dt * (self._speed + self._height_gain * rest)
        wanted = (
            moves
            * part_between(self._cycles, FROM_CYCLES, FROM_CYCLES + CYCLES)
            * part_between(self._pace.purity, PURE_FROM, PURE)
            * part_between(pace, SLOWEST, SLOW)
        )
        self.share += dt / LAG_S * (wanted - self.share)
        return error + self.share * self.height

    def _begin(self) -> None:
        sizes = np.array([HEIGHT_M, RATE_M_S, BIAS_M_S2, SWING, SWING])
        self._P = np.diag(sizes * sizes)
        self._moved = True
        self._ticks = 0
        self._cycles = self._misfit = self._speed = self.height = self.share = 0.0

    def _renew(self, amplitude: float) -> None:
        """Compute the gains from the covariance of height, rate, bias, g and g'."""
        dt, pace, F = self._every * self._dt, self._pace.value, self._F
        half_square = 0.5 * amplitude * amplitude
        damping = _damping(pace)
        spring, keep = dt * pace * pace, 1.0 - dt * damping
        F[0, 1], F[1, 2] = dt, -dt
        F[3, 3], F[3, 4] = 1.0 - dt * spring, dt * keep
        F[4, 3], F[4, 4] = -spring, keep
        P = F @ self._P @ F.T
        P[1, 1] += dt * ACCELERATION_NOISE**2
        P[2, 2] += dt * BIAS_WALK**2
        P[4, 4] += dt * 2.0 * damping * pace * pace * half_square
        no_swing = FLAT_M**2 + self._misfit + half_square * math.exp(-self._cycles)
        seen = P @ _SEEN
        total = float(_SEEN @ seen) + no_swing * CORRELATION_S / dt
        P -= np.outer(seen, seen / total)
        self._P = P
        k = (seen / (total * dt)).tolist()
        self.gains = k[0], k[1], -k[2]
        self._height_gain, self._speed_gain = k[3], k[4]


def _damping(pace: float) -> float:
    """Return 2 / T for a swing of this pace [1/s]."""
    return pace / (math.pi * COHERENT_CYCLES)
