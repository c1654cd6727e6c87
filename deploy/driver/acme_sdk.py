"""A made-up vendor SDK with its own joint order, degrees, signs and g.

It stands for the vendor's library in the example; the robot behind it is a Walker that
stands still and follows its servos.
"""

from __future__ import annotations

import random

STIFFNESS_N_PER_DEG = 600.0
WEIGHT_KG = 69.0878
MOTORS = 28


class AcmeRobot:
    """Motors in degrees, legs first; half of them count the other way round."""

    def __init__(self, home_deg: list[float]) -> None:
        """Connect; the motors stand at ``home_deg``."""
        self._home = list(home_deg)
        self._position = list(home_deg)
        self._random = random.Random(1)

    def get_motor_degrees(self) -> list[float]:
        """Return motor positions [deg]."""
        return [p + self._random.gauss(0.0, 1e-4) for p in self._position]

    def set_motor_degrees(self, target: list[float]) -> None:
        """Set motor targets [deg]."""
        self._position = [
            p + 0.2 * (t - p) for p, t in zip(self._position, target, strict=True)
        ]

    def get_imu(self) -> dict[str, list[float]]:
        """Return quaternion w x y z, gyroscope [deg/s], accelerometer [g]."""
        noise = [self._random.gauss(0.0, 0.001) for _ in range(6)]
        return {
            "quat_wxyz": [1.0, 0.0, 0.0, 0.0],
            "gyro_deg_s": noise[:3],
            "accel_g": [noise[3], noise[4], 1.0 + noise[5]],
        }

    def get_load_cells(self) -> dict[str, list[float]]:
        """Return the load of each foot on the ground [kgf, kgf m]; negative is down."""
        # Straightening a knee (motors 3 and 9) shifts weight to that foot.
        left = self._home[3] - self._position[3]
        right = self._position[9] - self._home[9]  # the right side counts backwards
        shift = STIFFNESS_N_PER_DEG * (left - right) / 9.81
        noise = self._random.gauss(0.0, 0.1)
        return {
            "L": [0.0, 0.0, -(WEIGHT_KG / 2.0 + shift) + noise, 0.0, 0.0, 0.0],
            "R": [0.0, 0.0, -(WEIGHT_KG / 2.0 - shift) - noise, 0.0, 0.0, 0.0],
        }
