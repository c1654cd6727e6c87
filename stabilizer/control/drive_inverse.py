"""Makes up for the lag of the drives: what to send so that they do what is wanted.

A drive is taken as its servo profile says: a set-point L that moves at a limited speed,
and one S behind it with a lag, S += g (L - S) in every tick. To have S where it is
wanted in the next tick,

    L = S + (q_wanted - S) / g

is sent. What the speed limit takes away is given back to q_wanted (back-calculation):
an inverse that went on asking for it would bounce between its limits.

A robot whose feet bounce wants soft drives instead: then the inverse is left out.
"""

from __future__ import annotations

import math

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.robot_file import ServoProfile


class DriveInverse:
    """The drives' model and its inverse, one for all joints.

    Attributes:
        sent: (n_a,) what is commanded to the drives [rad].
        lead: what is sent goes so many times further than is wanted in a tick [1].
        reached: (n_a,) where their set-points are with it, by the model [rad].
    """

    def __init__(self, profile: ServoProfile, *, joints: int, period_s: float) -> None:
        """Start at rest at zero; see :meth:`take_over`.

        Args:
            profile: speed limit and lag.
            joints: n_a.
            period_s: from tick to tick [s].
        """
        self._gain = -math.expm1(-period_s / profile.lag_s) if profile.lag_s else 1.0
        self.lead = 1.0 / self._gain - 1.0
        self._reach = profile.velocity_limit_rad_s * period_s
        self.sent: Array = np.zeros(joints)
        self.reached: Array = np.zeros(joints)
        self._low, self._high = np.zeros(joints), np.zeros(joints)
        self._asked = np.zeros(joints)

    @property
    def lags(self) -> bool:
        """Whether there is anything to make up for."""
        return self._gain < 1.0

    def take_over(self, q_command: Array) -> None:
        """Begin with drives at rest.

        Args:
            q_command: (n_a,) [rad].
        """
        self.sent[:] = self.reached[:] = q_command

    def follow(self, q_wanted: Array, *, share: float) -> Array:
        """Compute what to send in this tick.

        Args:
            q_wanted: (n_a,) where the set-points are wanted [rad]; what is out of
                reach is taken back in it.
            share: of the inverse, from none (0) to all of it (1).

        Returns:
            (n_a,) ``sent``, reused by the next call.
        """
        asked, reach = self._asked, self._reach
        np.subtract(q_wanted, self.reached, out=asked)
        asked *= share * self.lead
        asked += q_wanted
        np.subtract(self.sent, reach, out=self._low)
        np.add(self.sent, reach, out=self._high)
        np.maximum(asked, self._low, out=self.sent)
        np.minimum(self.sent, self._high, out=self.sent)
        is_beyond = self.sent != asked
        np.subtract(self.sent, self.reached, out=asked)
        asked *= self._gain
        self.reached += asked
        if share > 0.0 and is_beyond.any():
            back = share * (self.reached - q_wanted)
            q_wanted += np.where(is_beyond, back, 0.0)
        return self.sent
