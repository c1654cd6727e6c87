"""Accelerometer that reports the velocity it gained, as strapdown units do."""

from __future__ import annotations

import numpy as np

from schemas.arrays import Array, Mat, Vec3
from sim_robot.constants import GRAVITY_M_S2


class Accelerometer:
    """Mean specific force since the last reading, in the frame of this reading.

    R a_k = (v_k - v_(k-1)) / period - g holds exactly: integrating the readings
    gives the true velocity. (The simulator's own sensor reports the acceleration
    before the implicit damping of the drives, some per cent off what happens.)
    """

    def __init__(self, *, period_s: float) -> None:
        """Starts at rest: the first reading is gravity alone.

        Args:
            period_s: time between readings.
        """
        self._rate = 1.0 / period_s
        self._last: Vec3 = np.zeros(3)
        self._started = False
        self._force_in_world: Array = np.empty(3)

    def read(self, velocity: Vec3, rotation: Mat) -> Vec3:
        """Reads the sensor once per tick.

        Args:
            velocity: (3,) of the sensor in the world [m/s].
            rotation: (3, 3) world from sensor.

        Returns:
            (3,) specific force in the sensor's frame [m/s^2]; + g upwards at rest.
        """
        force = self._force_in_world
        if not self._started:
            self._last[:] = velocity
            self._started = True
        np.subtract(velocity, self._last, out=force)
        force *= self._rate
        force[2] += GRAVITY_M_S2
        self._last[:] = velocity
        specific_force: Vec3 = force @ rotation
        return specific_force
