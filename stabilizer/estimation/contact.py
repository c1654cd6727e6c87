"""Which feet stand, decided from the measured normal forces."""

from __future__ import annotations

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import ContactSettings


class ContactMonitor:
    """Contact of each foot, with hysteresis in force and time.

    Attributes:
        in_contact: (left, right).
        allowed: (2,) largest normal force to ask of each foot [N]: all of
            ``largest_force`` while it stands; after touch-down what it carries,
            growing to all within ``reload_s``.
    """

    def __init__(
        self, settings: ContactSettings, *, largest_force: float, period_s: float
    ) -> None:
        """Begin with both feet standing.

        Args:
            settings: thresholds and times.
            largest_force: to be asked of a foot that stands [N].
            period_s: time between two updates [s].
        """
        self._largest = largest_force
        self._settings = settings
        self._dt = period_s
        self._timer = [0.0, 0.0]
        self.in_contact = [True, True]
        self._load = [1.0, 1.0]
        self.allowed: Array = np.full(2, largest_force)

    def update(self, normal_left: float, normal_right: float) -> None:
        """Advance by one tick.

        Args:
            normal_left: measured normal force of the left foot [N].
            normal_right: the same for the right foot [N].
        """
        for side, normal in enumerate((normal_left, normal_right)):
            self._update_foot(side, normal)

    def _update_foot(self, side: int, normal: float) -> None:
        settings = self._settings
        if self.in_contact[side]:
            turning = normal < settings.lost_below_n
            needed = settings.lost_after_s
            grown = self._load[side] + self._dt / settings.reload_s
            self._load[side] = min(1.0, max(grown, normal / self._largest))
        else:
            turning = normal > settings.regained_above_n
            needed = settings.regained_after_s
        self._timer[side] = self._timer[side] + self._dt if turning else 0.0
        if turning and self._timer[side] > needed:
            self.in_contact[side] = not self.in_contact[side]
            self._timer[side] = 0.0
            self._load[side] = 0.0
        self.allowed[side] = self._load[side] * self._largest
