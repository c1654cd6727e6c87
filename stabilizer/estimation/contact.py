"""Contacts of the feet by measured normal forces, and the places of their footholds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.settings import ContactSettings


class ContactMonitor:
    """Contact of each foot, with hysteresis in force and time.

    Attributes:
        in_contact: (left, right).
        allowed: (2,) largest normal force to ask of each foot [N]. It is
            ``largest_force`` while the foot stands; after a touchdown it grows from the
            present force to that within ``reload_s``.
        owned: whether a walk controls left and right foot; its entries in
            ``in_contact`` and ``allowed`` are left alone.
    """

    def __init__(
        self, settings: ContactSettings, *, largest_force: float, period_s: float
    ) -> None:
        """Begin with both feet standing.

        Args:
            settings: thresholds and times.
            largest_force: largest normal force to ask of a foot that stands [N].
            period_s: time between two updates [s].
        """
        self._largest = largest_force
        self._settings = settings
        self._dt = period_s
        self._timer = [0.0, 0.0]
        self.in_contact = [True, True]
        self.owned = [False, False]
        self._load = [1.0, 1.0]
        self.allowed: Array = np.full(2, largest_force)

    def update(self, normal_left: float, normal_right: float) -> None:
        """Advance by one tick.

        Args:
            normal_left: measured normal force of the left foot [N].
            normal_right: measured normal force of the right foot [N].
        """
        for side, normal in enumerate((normal_left, normal_right)):
            if not self.owned[side]:
                self._update_foot(side, normal)

    @property
    def reload_s(self) -> float:
        """Time after a touchdown in which a foot takes its full share [s]."""
        return self._settings.reload_s

    def take_back(self, side: int) -> None:
        """Monitor a foot again that a walk has controlled; it stands."""
        self.owned[side] = False
        self._timer[side] = 0.0
        self._load[side] = min(1.0, float(self.allowed[side]) / self._largest)

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


class Anchors:
    """Place and heading of each foothold, in the stance frame of the first stance.

    The odometry is relative to these. For a robot that only stands they are the feet's
    places in the nominal stance, unchanged.

    Attributes:
        p: x, y, z of left and right foothold [m]; z from the first stance's ground.
        yaw: headings of the soles there [rad].
        level: planned heights of the footholds, to which the base's height refers:
            those in ``p`` drift on turning ground [m].
        carrying: planned height of the carrying foothold, or by load between both [m].
        relief: how much higher each foothold was found than planned [m].
        planted: whether each foot is where it was set down. Otherwise its anchor
            follows the foot.
        by_load: whether the heading is that of the carrying foot (walking) or the mean
            of both (standing).
    """

    def __init__(self, soles: Sequence[Vec3], yaws: Sequence[float]) -> None:
        """Begin in the nominal stance.

        Args:
            soles: (3,) positions of left and right sole there [m].
            yaws: their headings [rad].
        """
        # Soles are at zero height but for rounding, which must not move a height.
        self.p = [[float(x), float(y), 0.0] for x, y, _ in soles]
        self.yaw = list(yaws)
        self.level = [0.0, 0.0]
        self.carrying = 0.0
        self.relief = [0.0, 0.0]
        self.planted = [True, True]
        self.by_load = False

    def share(self, measured: float) -> float:
        """Return the part by which the left anchor determines the base's place [1].

        Args:
            measured: filtered part of the load on the left foot.
        """
        left, right = self.planted
        if left == right:
            return measured
        return 1.0 if left else 0.0
