"""Tells whether the robot fell."""

from __future__ import annotations

import math

from sim_robot.view import PlantView

FALL_HEIGHT_RATIO = 0.6
"""Base height above the soles, against standing, under which the robot fell."""
FALL_TILT_RAD = math.radians(60.0)
FALL_CLEARANCE_M = 0.03
"""Links above the ankles this close to the height of the lower sole are down."""

_UPRIGHT = math.cos(FALL_TILT_RAD)


class FallDetector:
    """Compares the robot with how it stood at first."""

    def __init__(self, view: PlantView) -> None:
        """Takes the present height as that of standing."""
        self._view = view
        base, left, right, *_ = view.heights()
        self._least_height = FALL_HEIGHT_RATIO * (base - 0.5 * (left + right))

    def check(self) -> bool:
        """Whether the robot is low, leans too far, or touches down with a link."""
        base, left, right, *links = self._view.heights()
        # A state that is not a number fails one of these: that is a fall, too.
        standing = (
            self._view.upright > _UPRIGHT
            and base - 0.5 * (left + right) > self._least_height
            and min(links) > min(left, right) + FALL_CLEARANCE_M
        )
        return not standing
