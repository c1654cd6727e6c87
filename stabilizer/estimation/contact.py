"""Which feet stand, by the measured normal forces, and where they were set down."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.settings import ContactSettings


class ContactMonitor:
    """Contact of each foot, with hysteresis in force and time.

    Attributes:
        in_contact: (left, right).
        allowed: (2,) largest normal force to ask of each foot [N]: all of
            ``largest_force`` while it stands; after touch-down what it carries,
            growing to all within ``reload_s``.
        owned: whether a walk says what a foot does, left and right; what it writes
            into ``in_contact`` and ``allowed`` is left alone.
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
        self.owned = [False, False]
        self._load = [1.0, 1.0]
        self.allowed: Array = np.full(2, largest_force)

    def update(self, normal_left: float, normal_right: float) -> None:
        """Advance by one tick.

        Args:
            normal_left: measured normal force of the left foot [N].
            normal_right: the same for the right foot [N].
        """
        for side, normal in enumerate((normal_left, normal_right)):
            if not self.owned[side]:
                self._update_foot(side, normal)

    @property
    def reload_s(self) -> float:
        """After a touchdown a foot takes its full share within this time."""
        return self._settings.reload_s

    def take_back(self, side: int) -> None:
        """Watch a foot again that a walk has had; it stands."""
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

    What the odometry hangs on. A robot that only stands has its feet where they are in
    the nominal stance, for good.

    Attributes:
        p: x, y, z of left and right foothold [m]; z from the first stance's ground.
        yaw: headings of the soles there [rad].
        level: heights of the footholds as planned, which the height of the base is told
            from: those in ``p`` drift on ground that turns [m].
        carrying: the same of the one that carries, or by load between both [m].
        planted: whether each foot is where it was set down. The anchor of one that
            is not follows its foot.
        by_load: whether the heading is that of the foot that carries, as it is on the
            way, or the mean of both, as it is standing.
    """

    def __init__(self, soles: Sequence[Vec3], yaws: Sequence[float]) -> None:
        """Begin in the nominal stance.

        Args:
            soles: (3,) positions of left and right sole there [m].
            yaws: their headings [rad].
        """
        # Soles are the ground's zero, but for rounding, which must not move a height.
        self.p = [[float(x), float(y), 0.0] for x, y, _ in soles]
        self.yaw = list(yaws)
        self.level = [0.0, 0.0]
        self.carrying = 0.0
        self.planted = [True, True]
        self.by_load = False

    def share(self, measured: float) -> float:
        """Return how much of the base's place hangs on the left foot [1].

        Args:
            measured: left foot's part of the load, filtered.
        """
        left, right = self.planted
        if left == right:
            return measured
        return 1.0 if left else 0.0
