"""Set-point dynamics of the servos: velocity limit, then first-order lag."""

from __future__ import annotations

import math

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.robot_file import ServoProfile


class Servos:
    """What each servo really follows, given the position it was commanded.

    The set-point chases the command at most at the profile's speed; a first-order
    lag follows it, discretised exactly for a set-point held over the step. The PD
    law itself runs in the simulation, on this set-point, every step.

    Attributes:
        setpoint: (n_a,) position the PD law acts on [rad]; a live array.
    """

    def __init__(self, profile: ServoProfile, *, posture: Array, step_s: float) -> None:
        """Start at rest in a posture.

        Args:
            profile: velocity limit and lag.
            posture: (n_a,) [rad].
            step_s: simulation step [s].
        """
        self._largest_change = profile.velocity_limit_rad_s * step_s
        self._lagging = profile.lag_s > 0.0
        self._gain = -math.expm1(-step_s / profile.lag_s) if self._lagging else 1.0
        self._limited = np.array(posture, dtype=np.float64)
        self._change = np.empty_like(self._limited)
        self.setpoint: Array = self._limited.copy() if self._lagging else self._limited

    def reset(self, posture: Array) -> None:
        """Forget the past: at rest in ``posture``, (n_a,) [rad]."""
        np.copyto(self._limited, posture)
        np.copyto(self.setpoint, posture)

    def step(self, q_command: Array) -> Array:
        """Advance one simulation step towards a command.

        Args:
            q_command: (n_a,) [rad].

        Returns:
            (n_a,) the live set-point for this step [rad].
        """
        change, limit = self._change, self._largest_change
        np.subtract(q_command, self._limited, out=change)
        np.minimum(change, limit, out=change)
        np.maximum(change, -limit, out=change)
        self._limited += change
        if self._lagging:
            np.subtract(self._limited, self.setpoint, out=change)
            change *= self._gain
            self.setpoint += change
        return self.setpoint
