"""Sway with tilting ground, as people do, instead of standing upright in space.

People on a slowly tilting platform lean with it, by several times its tilt. Against a
tilt that stays they stand up again. Off by default; settings ``sway``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from surefoot.schemas.arrays import Vec3
from surefoot.schemas.law_settings import SwaySettings
from surefoot.schemas.settings import WalkSettings
from surefoot.stabilizer.control.reference import Stance
from surefoot.stabilizer.dynamics import SolesAndCom
from surefoot.stabilizer.model import turn_level
from surefoot.stabilizer.walking.footsteps import mean_yaw
from surefoot.stabilizer.walking.ground import ExpectedGround

REACH = 0.6
"""Part of the way from the middle of the feet to the edge of the soles that the CoM may
use [1]. The rest is for pressure that accelerates it."""


class Sway:
    """Offset of the CoM from its reference, given by the ground's tilt.

    The input is the level part of the ground's normal, which leans as the ground tilts,
    along both axes of the feet. Its lasting part is subtracted, and what is too far for
    the soles is bent to their reach. A second-order low-pass gives place, velocity and
    acceleration. Without common ground under two standing feet the input is zero, and
    the offset goes back to zero.
    """

    def __init__(
        self,
        settings: SwaySettings,
        walk: WalkSettings,
        *,
        half_sizes: Sequence[tuple[float, float]],
        period_s: float,
    ) -> None:
        """Begin at rest.

        Args:
            settings: gain and filter.
            walk: when soles show common ground.
            half_sizes: half length and half width of left and right sole [m].
            period_s: time between two ticks [s].
        """
        self._settings, self._dt = settings, period_s
        self.is_on = settings.gain > 0.0
        self._half_length = min(length for length, _ in half_sizes)
        self._half_width = min(width for _, width in half_sizes)
        self._ground = ExpectedGround(walk, half_sizes=half_sizes, period_s=period_s)
        self._lasting = [0.0, 0.0]
        self._p, self._v = [0.0, 0.0], [0.0, 0.0]
        self._offset: Vec3 = np.zeros(3)
        self._rate: Vec3 = np.zeros(3)
        self._acceleration: Vec3 = np.zeros(3)

    def begin(self, soles: SolesAndCom, stance: Stance) -> None:
        """Take the present tilt as lasting."""
        self._ground.from_both(soles)
        self._lasting[:] = self._tilt(mean_yaw(*stance.yaw_sole))

    def step(self, soles: SolesAndCom, stance: Stance, *, stands: bool) -> None:
        """Advance by a tick.

        Args:
            soles: at the present state.
            stance: reference.
            stands: whether both feet stand and are meant to.
        """
        settings, dt = self._settings, self._dt
        self._ground.from_both(soles)
        yaw = mean_yaw(*stance.yaw_sole)
        tilt = self._tilt(yaw)
        omega = 2.0 * math.pi * settings.frequency_hz
        lever = settings.gain * stance.com_nominal if stands else 0.0
        there = []
        for axis, reach in enumerate(self._reach(stance, yaw)):
            lasts = self._lasting[axis]
            lasts += dt / settings.upright_again_s * (tilt[axis] - lasts)
            self._lasting[axis] = lasts
            p, v = self._p[axis], self._v[axis]
            wanted = reach * math.tanh(lever * (tilt[axis] - lasts) / reach)
            a = omega * omega * (wanted - p)
            a -= 2.0 * settings.damping * omega * v
            self._v[axis] = v = v + dt * a
            self._p[axis] = p = p + dt * v
            there.append(_within(p, v, a, reach=reach))
        ahead, left = there
        for out, x, y in zip(
            (self._offset, self._rate, self._acceleration), ahead, left, strict=True
        ):
            out[:2] = turn_level(x, y, yaw)

    def move(self, stance: Stance, way: float) -> None:
        """Add the present offset to the reference, or take it off again.

        Args:
            stance: the reference, changed in place.
            way: 1 to add the offset, -1 to take it off.
        """
        stance.com += way * self._offset
        stance.com_velocity += way * self._rate
        stance.com_acceleration += way * self._acceleration

    def _tilt(self, yaw: float) -> tuple[float, float]:
        """How far the ground's normal leans ahead and to the left of the feet [1]."""
        x, y, _ = self._ground.normal.tolist()
        return turn_level(x, y, -yaw)

    def _reach(self, stance: Stance, yaw: float) -> tuple[float, float]:
        """How far the centre of mass may go ahead and to the left [m]."""
        x, y, _ = (stance.p_sole[0] - stance.p_sole[1]).tolist()
        apart = abs(turn_level(x, y, -yaw)[1])
        return REACH * self._half_length, REACH * (self._half_width + 0.5 * apart)


def _within(
    p: float, v: float, a: float, *, reach: float
) -> tuple[float, float, float]:
    """Bend a motion smoothly so that it never goes beyond a reach.

    Args:
        p: place, from -inf to inf [m].
        v: velocity [m/s].
        a: acceleration [m/s^2].
        reach: largest distance, larger than 0 [m].

    Returns:
        Place, velocity and acceleration of ``reach * tanh(p / reach)``.
    """
    share = math.tanh(p / reach)
    slope = 1.0 - share * share
    bend = -2.0 * share * slope / reach
    return reach * share, slope * v, slope * a + bend * v * v
