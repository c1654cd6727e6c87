"""Which feet stand, decided from the measured normal forces."""

from __future__ import annotations

import numpy as np

from schemas.arrays import Array
from schemas.settings import ContactSettings


class ContactMonitor:
    """Contact of each foot, with hysteresis in force and time.

    Attributes:
        in_contact: (left, right).
        load: (2,) share of its full load a foot may take: 0 just after touch-down,
            1 after ``reload_s``.
    """

    def __init__(self, settings: ContactSettings, *, period_s: float) -> None:
        """Begins with both feet standing."""
        self._settings = settings
        self._dt = period_s
        self._timer = [0.0, 0.0]
        self.in_contact = [True, True]
        self.load: Array = np.ones(2)

    def update(self, normal_left: float, normal_right: float) -> None:
        """Advances by one tick.

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
            grown = self.load[side] + self._dt / settings.reload_s
            self.load[side] = min(1.0, grown)
        else:
            turning = normal > settings.regained_above_n
            needed = settings.regained_after_s
        self._timer[side] = self._timer[side] + self._dt if turning else 0.0
        if turning and self._timer[side] > needed:
            self.in_contact[side] = not self.in_contact[side]
            self._timer[side] = 0.0
            self.load[side] = 0.0
