"""Reference of the standing robot: an inverted pendulum brought to rest."""

from __future__ import annotations

import math

import numpy as np

from schemas.arrays import Vec3
from stabilizer.model import GRAVITY

STIFFNESS = 5.0
"""Pull of the pendulum to its target [1/s^2]."""
DAMPING = 2.0 * math.sqrt(STIFFNESS)
UP = np.array([0.0, 0.0, 1.0])
GRAVITY_VECTOR = -GRAVITY * UP
FARTHEST_M = 1.0
"""A target farther away pulls no harder [m]."""
LEAST_STIFFNESS = 1.0
"""Floor of the pendulum's omega^2 [1/s^2]; a falling reference has none."""


class StandingPendulum:
    """CoM reference that settles over a target.

    Attributes:
        com: (3,) reference of the centre of mass [m].
        velocity: (3,) [m/s].
        acceleration: (3,) [m/s^2].
        zmp: (3,) its zero-moment point [m].
        omega: natural frequency of the pendulum [rad/s].
    """

    def __init__(self, com: Vec3, *, period_s: float) -> None:
        """Begins at rest.

        Args:
            com: (3,) over the ground at z = 0 [m].
            period_s: time between two updates [s].
        """
        self._dt = period_s
        self.com: Vec3 = com.copy()
        self.velocity: Vec3 = np.zeros(3)
        self.acceleration: Vec3 = np.zeros(3)
        self.zmp: Vec3 = com * (1.0, 1.0, 0.0)
        self.omega = math.sqrt(GRAVITY / com.item(2))

    def update(self, target: Vec3) -> None:
        """Advances by one period.

        Args:
            target: (3,) where the centre of mass should come to rest; the centre of
                pressure belongs right under it, at z = 0 [m].
        """
        dt = self._dt
        step = np.clip(target - self.com, -FARTHEST_M, FARTHEST_M)
        self.acceleration = STIFFNESS * step - DAMPING * self.velocity
        # n . (cdd - g) / n . (c - cop), with n straight up.
        stiffness = (self.acceleration.item(2) + GRAVITY) / self.com.item(2)
        stiffness = max(stiffness, LEAST_STIFFNESS)
        self.omega = math.sqrt(stiffness)
        self.zmp = self.com + (GRAVITY_VECTOR - self.acceleration) / stiffness
        self.com += dt * self.velocity + (0.5 * dt * dt) * self.acceleration
        self.velocity += dt * self.acceleration
