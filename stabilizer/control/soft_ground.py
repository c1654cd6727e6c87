"""Ground that gives way: how far a sole turns into it, told from how it turns.

A sole on soft ground turns with the moments on it, and sinks under the load. Fed
forward as the ground's motion, that would be a loop of its own, and a robot on one foot
falls over it. So what the wrench makes its sole do is taken off: the ground moves by

    v_sole + C dF/dt

along its normal and about its level axes, there over the square of the sole's half
size. The compliance C is a regression of twists on rates of wrenches, of what is quick
in them: ground that moves by itself is slower than a step. It counts as far as it
explains how the sole turns. A sole that firm ground turns is pressed harder, not less.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.stabilizer.dynamics import NORMAL, SOLE_ROWS

CUTOFF_HZ = 40.0
"""Of the low-pass on the wrenches, before their rate is taken."""
QUICK_HZ = 2.5
"""Of the high-pass, of second order, on turns and rates that are compared."""
MEMORY_S = 0.7
"""Time on the ground after which what was seen counts by 1/e."""
LIGHT_N = 60.0
"""A sole that feels less shows no ground."""
EDGE = 0.9
"""Nor does one that is pressed farther out: it may tip [1]."""
FAST_N_S = 2000.0
"""Rates of a moment over half the sole's size beyond this count less: a bounce is none
of the ground's doing."""
PRIOR = (0.1 * FAST_N_S) ** 2
"""Of the squares: so much firmness is assumed at first [N^2/s]."""
STILL_M_S = 1e-3
"""Speeds of the sole's edges below it are noise."""
EXPLAINED = (0.15, 0.35)
"""Part of the turns' squares up to which compliance explains nothing, and all [1]."""
FIRM_M_N, SOFT_M_N = 0.6e-6, 0.9e-6
"""Up to the first all ground counts as firm, from the second on it gives way."""
SOFTEST_M_N = 1.0 / 20e3
"""No ground is taken to be softer."""


class SoftGround:
    """Compliance of the ground under each sole, and how the soles turn because of it.

    Attributes:
        compliance: of the ground under left and right sole, pressed at an edge [m/N].
        sinking: the same, pressed in the middle, not more than at an edge [m/N].
        given: (12,) to be added to the soles' twists, for those of the ground.
    """

    def __init__(
        self, *, half_sizes: Sequence[tuple[float, float]], period_s: float
    ) -> None:
        """Take all ground for firm.

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
        # Decaying sums of rate squared, less rate times speed, speed squared.
        self._turns = [[PRIOR, 0.0, 0.0], [PRIOR, 0.0, 0.0]]
        self._sinks = [[PRIOR, 0.0, 0.0], [PRIOR, 0.0, 0.0]]
        self._wrench = np.zeros(12)
        self._rate = np.zeros(12)
        self._slow = (np.zeros(24), np.zeros(24))
        self._quick = np.zeros(24)
        self._step = np.zeros(24)
        self._parts = self._quick[:12], self._quick[12:]

    def update(self, v_sole: Array, F_meas: Array, stands: Sequence[bool]) -> None:
        """Advance by one tick.

        Args:
            v_sole: (12,) twists of both soles, sole frames.
            F_meas: (12,) wrenches of the ground on them.
            stands: which of them stand, the impact of their touchdown over.
        """
        rate, quick = self._rate, self._quick
        np.subtract(F_meas, self._wrench, out=rate)
        rate *= self._low_pass
        self._wrench += rate
        rate /= self._dt
        np.copyto(self._parts[0], v_sole)
        np.copyto(self._parts[1], rate)
        for slow in self._slow:
            quick -= slow
            np.multiply(quick, self._high_pass, out=self._step)
            slow += self._step
        for side, rows in enumerate(SOLE_ROWS):
            if stands[side]:
                if not self._stood[side]:
                    self._expect(side)
                self._look(side, self._wrench[rows].tolist())
            else:
                self.given[rows] = 0.0
            self._stood[side] = stands[side]

    def _expect(self, side: int) -> None:
        """Expect of a foot that has landed what the other one stands on."""
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
            trust = _between(explained, *EXPLAINED)
            self.compliance[side] = found = min(trust * turns, SOFTEST_M_N)
            sinks = self._regress(self._sinks[side], (f_z, 0.0), (v_z, 0.0))
            self.sinking[side] = min(sinks, found)
        compliance, sinking = self.compliance[side], self.sinking[side]
        soft = _between(compliance, FIRM_M_N, SOFT_M_N)
        f_z, m_x, m_y = self._rate[start + NORMAL : start + 5].tolist()
        self.given[start + NORMAL] = soft * sinking * f_z
        self.given[start + 3] = soft * compliance * m_x / width**2
        self.given[start + 4] = soft * compliance * m_y / length**2

    def _regress(
        self, sums: list[float], rate: tuple[float, float], speed: tuple[float, float]
    ) -> float:
        """Take in a tick, rates of forces and speeds; return the compliance [m/N]."""
        (f_x, f_y), (v_x, v_y) = rate, speed
        square = f_x * f_x + f_y * f_y
        counts = self._dt / (1.0 + square / FAST_N_S**2)
        sums[0] = PRIOR + self._keep * (sums[0] - PRIOR) + counts * square
        sums[1] = self._keep * sums[1] - counts * (f_x * v_x + f_y * v_y)
        sums[2] = self._keep * sums[2] + counts * (v_x**2 + v_y**2 + STILL_M_S**2)
        return max(sums[1], 0.0) / sums[0]


def _between(value: float, low: float, high: float) -> float:
    """Return 0 up to a value, 1 from another one on, in proportion between."""
    return min(max((value - low) / (high - low), 0.0), 1.0)
