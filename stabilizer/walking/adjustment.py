"""Shifts a step when the DCM leaves its reference: capture what a push has begun."""

from __future__ import annotations

import math

from surefoot.schemas.walk_settings import WalkSettings
from surefoot.stabilizer.walking.footsteps import Foothold
from surefoot.stabilizer.walking.step_queue import Move


class StepAdjustment:
    """Where the present step is set off its plan.

    A shift of all places to come moves the reference of the DCM, now, by

        g = exp(-w t_left) (1 - exp(-w T_double)) / (w T_double)

    per metre. The shift grows at the error beyond a dead band over g and a time
    constant, until reference and measurement meet within that band.

    Attributes:
        shift: (x, y) of the present step [m].
    """

    def __init__(
        self, settings: WalkSettings, *, omega: float, period_s: float
    ) -> None:
        """Begin without a shift.

        Args:
            settings: dead band, speed and limits.
            omega: of the pendulum [1/s].
            period_s: time between two updates [s].
        """
        self._settings = settings
        self._omega, self._dt = omega, period_s
        self.shift = (0.0, 0.0)
        self._stopped = False

    def begin(self) -> None:
        """Begin with another step."""
        self.shift = (0.0, 0.0)
        self._stopped = False

    def stop(self) -> None:
        """The foot is down: it stays where it is."""
        self._stopped = True

    def update(
        self,
        error: tuple[float, float],
        move: Move,
        *,
        support: Foothold,
        left_s: float,
        double_s: float,
    ) -> tuple[float, float]:
        """Advance by one tick.

        Args:
            error: of the DCM against its reference, odometry frame [m].
            move: the step.
            support: foothold of the other foot.
            left_s: of single support [s].
            double_s: double support that follows [s].

        Returns:
            (x, y) by which the steps after it are to be moved, too [m].
        """
        settings, omega = self._settings, self._omega
        is_late = left_s < settings.adjust_until_s
        if settings.adjust == "off" or self._stopped or is_late:
            return 0.0, 0.0
        cos, sin = math.cos(support.yaw), math.sin(support.yaw)
        ahead = cos * error[0] + sin * error[1]
        aside = cos * error[1] - sin * error[0]
        growth = omega * double_s
        gain = math.exp(-omega * left_s) * -math.expm1(-growth) / growth
        fastest = settings.adjust_rate_m_s
        rates = [
            min(
                max(_dead(value, band) / (gain * settings.adjust_time_s), -fastest),
                fastest,
            )
            for value, band in zip((ahead, aside), settings.adjust_dead_m, strict=True)
        ]
        old_x, old_y = self.shift
        x = cos * old_x + sin * old_y + self._dt * rates[0]
        y = cos * old_y - sin * old_x + self._dt * rates[1]
        limit_x, limit_y = settings.adjust_limit_m
        x, y = min(max(x, -limit_x), limit_x), min(max(y, -limit_y), limit_y)
        p_x, p_y, _ = move.place.seen_from(support)
        outward = 1.0 if move.side == 0 else -1.0
        apart = outward * (p_y + y)
        apart = min(max(apart, settings.nearest_m), settings.farthest_m)
        y = outward * apart - p_y
        x = min(max(p_x + x, -settings.longest_m), settings.longest_m) - p_x
        self.shift = (cos * x - sin * y, sin * x + cos * y)
        moved_x, moved_y = self.shift[0] - old_x, self.shift[1] - old_y
        # What follows keeps the way gained ahead, and half of that to the side.
        ahead, aside = cos * moved_x + sin * moved_y, cos * moved_y - sin * moved_x
        aside *= 0.5
        return cos * ahead - sin * aside, sin * ahead + cos * aside


def _dead(value: float, band: float) -> float:
    if value > band:
        return value - band
    return min(value + band, 0.0)
