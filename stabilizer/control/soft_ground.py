"""Soft ground: estimates how far it gives way from how a sole turns on it.

On soft ground a sole turns with the moments on it and sinks under the load. If that
were fed forward as ground motion it would close a loop of its own, and a robot on one
foot would fall. So the motion caused by the wrench is removed. The ground moves by

    v_sole + C dF/dt

along its normal and about its level axes, there divided by the square of the sole's
half size. The compliance C is a regression of twists on rates of wrenches. Only their
fast parts count, since ground that moves by itself is slower than a step. C is used as
far as it explains how the sole turns. Firm ground that turns a sole presses it harder,
not less.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.stabilizer.dynamics import NORMAL, SOLE_ROWS, part_between

CUTOFF_HZ = 40.0
"""Cutoff of the low-pass on the wrenches, before their rate is taken."""
QUICK_HZ = 2.5
"""Cutoff of the second-order high-pass on the turns and rates that are compared."""
MEMORY_S = 0.7
"""Time on the ground after which an observation counts by 1/e."""
LIGHT_N = 60.0
"""Normal force below which a sole shows no ground."""
EDGE = 0.9
"""Centre of pressure beyond which a sole may tip and shows no ground [1]."""
FAST_N_S = 2000.0
"""Rate of an edge force (moment over half the sole's size) above which it counts less:
bounces are not caused by the ground."""
PRIOR = (0.1 * FAST_N_S) ** 2
"""Initial sum of the squares of rates: the firmness assumed at first [N^2/s]."""
STILL_M_S = 1e-3
"""Noise of the speed of the sole's edges."""
EXPLAINED = (0.15, 0.35)
"""Part of the turns' squares explained by compliance: up to the first it is not used,
from the second on fully [1]."""
FIRM_M_N, SOFT_M_N = 0.6e-6, 0.9e-6
"""Compliance up to which ground counts as firm, and from which on as soft."""
SOFTEST_M_N = 1.0 / 20e3
"""Largest compliance assumed."""


class SoftGround:
    """Compliance of the ground under each sole, and the sole motion it causes.

    Attributes:
        compliance: of the ground under left and right sole, pressed at an edge [m/N].
        sinking: the same, pressed in the middle; at most ``compliance`` [m/N].
        given: (12,) twists to add to the soles' to get the ground's [m/s, rad/s].
    """

    def __init__(
        self, *, half_sizes: Sequence[tuple[float, float]], period_s: float
    ) -> None:
        """Assume firm ground.

        Args:
            half_sizes: half length and half width of left and right sole [m].
            period_s: time between two updates [s].
        """
        self._half_sizes, self._dt = half_sizes, period_s
        self._low_pass = -math.expm1(-2.0 * math.pi * CUTOFF_HZ * period_s)
        self._high_pass = -math.expm1(-2.0 * math.pi * QUICK_HZ * period_s)
        self._keep = math.exp(-period_s / MEMORY_S)
        self.compliance = [0.0, 0.0]
        self.sinking = [0.0, 0.0]
        self.given: Array = np.zeros(12)
        self._stood = [True, True]
        # Decaying sums: rate squared, minus rate times speed, speed squared.
        self._turns = [[PRIOR, 0.0, 0.0], [PRIOR, 0.0, 0.0]]
        self._sinks = [[PRIOR, 0.0, 0.0], [PRIOR, 0.0, 0.0]]
        self._wrench = np.zeros(12)
        self._slow = (np.zeros(24), np.zeros(24))
        self._seen = np.zeros(24)
        self._twist, self._rate = self._seen[:12], self._seen[12:]
        self._quick = np.zeros(24)
        self._step = np.zeros(24)

    def update(self, v_sole: Array, F_meas: Array, stands: Sequence[bool]) -> None:
        """Advance by one tick.

        Args:
            v_sole: (12,) twists of both soles, sole frames.
            F_meas: (12,) wrenches of the ground on them.
            stands: which soles stand, after the impact of their touchdown.
        """
        rate, quick = self._rate, self._quick
        np.subtract(F_meas, self._wrench, out=rate)
        rate *= self._low_pass
        self._wrench += rate
        rate /= self._dt
        np.copyto(self._twist, v_sole)
        passed = self._seen
        for slow in self._slow:
            np.subtract(passed, slow, out=quick)
            np.multiply(quick, self._high_pass, out=self._step)
            slow += self._step
            passed = quick
        for side, rows in enumerate(SOLE_ROWS):
            if stands[side]:
                if not self._stood[side]:
                    self._expect(side)
                self._look(side, self._wrench[rows].tolist())
            else:
                self.given[rows] = 0.0
            self._stood[side] = stands[side]

    def _expect(self, side: int) -> None:
        """Assume under a landed foot the ground of the other one."""
        for sums in (self._turns, self._sinks):
            square, product, speed = sums[1 - side]
            share = 2.0 * PRIOR / (square + PRIOR)
            sums[side][:] = max(share * square, PRIOR), share * product, share * speed

    def _look(self, side: int, wrench: list[float]) -> None:
        start = 6 * side
        _, _, normal, m_x, m_y, _ = wrench
        length, width = self._half_sizes[side]
        if (
            normal > LIGHT_N
            and abs(m_x) < EDGE * width * normal
            and abs(m_y) < EDGE * length * normal
        ):
            v_z, w_x, w_y = self._quick[start + NORMAL : start + 5].tolist()
            f_z, m_x, m_y = self._quick[start + 12 + NORMAL : start + 17].tolist()
            edges = (m_x / width, m_y / length), (w_x * width, w_y * length)
            turns = self._regress(self._turns[side], *edges)
            explained = turns * self._turns[side][1] / self._turns[side][2]
            trust = part_between(explained, *EXPLAINED)
            self.compliance[side] = found = min(trust * turns, SOFTEST_M_N)
            sinks = self._regress(self._sinks[side], (f_z, 0.0), (v_z, 0.0))
            self.sinking[side] = min(sinks, found)
        compliance, sinking = self.compliance[side], self.sinking[side]
        soft = part_between(compliance, FIRM_M_N, SOFT_M_N)
        f_z, m_x, m_y = self._rate[start + NORMAL : start + 5].tolist()
        self.given[start + NORMAL] = soft * sinking * f_z
        self.given[start + 3] = soft * compliance * m_x / width**2
        self.given[start + 4] = soft * compliance * m_y / length**2

    def _regress(
        self, sums: list[float], rate: tuple[float, float], speed: tuple[float, float]
    ) -> float:
        """Add a tick's force rates and speeds; return the compliance [m/N]."""
        (f_x, f_y), (v_x, v_y) = rate, speed
        square = f_x * f_x + f_y * f_y
        counts = self._dt / (1.0 + square / FAST_N_S**2)
        sums[0] = PRIOR + self._keep * (sums[0] - PRIOR) + counts * square
        sums[1] = self._keep * sums[1] - counts * (f_x * v_x + f_y * v_y)
        sums[2] = self._keep * sums[2] + counts * (v_x**2 + v_y**2 + STILL_M_S**2)
        return max(sums[1], 0.0) / sums[0]
