"""CoM admittance: the commanded centre of mass gives way to ZMP errors."""

from __future__ import annotations

import numpy as np

from schemas.arrays import Vec3
from schemas.zmp_settings import ZmpSettings
from stabilizer.zmp.averages import LeakyIntegrator


class ComAdmittance:
    """Offset of the CoM reference from the ZMP error.

    The CoM moves towards where the measured ZMP exceeds the distributed one:
    cd = -A (z_distributed - z_measured).

    Attributes:
        offset: (3,) [m].
        velocity: (3,) [m/s].
        acceleration: (3,) [m/s^2].
    """

    def __init__(self, settings: ZmpSettings, *, period_s: float) -> None:
        """Begins without offset."""
        self._gain = np.array([*settings.com_admittance, 0.0])
        self._dt = period_s
        self._integral = LeakyIntegrator(
            leak=settings.com_offset_leak,
            limit=settings.com_offset_limit_m,
            period_s=period_s,
        )
        self.offset: Vec3 = self._integral.value
        self.velocity: Vec3 = np.zeros(3)
        self.acceleration: Vec3 = np.zeros(3)

    def update(self, *, distributed: Vec3, measured: Vec3, active: bool) -> None:
        """Advances by one tick.

        Args:
            distributed: (3,) ZMP of the distributed wrenches [m].
            measured: (3,) measured ZMP [m].
            active: whether both feet stand; otherwise the offset only leaks.
        """
        velocity = self._gain * (measured - distributed)
        if not active:
            velocity = np.zeros(3)
        self.acceleration = (velocity - self.velocity) / self._dt
        self.velocity = velocity
        self.offset = self._integral.update(velocity)
