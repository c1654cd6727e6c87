"""How old the sensors are, on average, that the servos are moved by."""

from __future__ import annotations

AVERAGED_OVER_S = 0.5
"""Time constant of the average: long against a stall, short against a fall [s]."""


class LoopDelay:
    """Average age of what the servos follow, over the last half second.

    A command that is old and one that is missing do the same harm: the servos act on
    what was felt long ago. So every tick counts the age of the sensors that the
    command followed in it answers, whenever that command came.

    Attributes:
        mean_s: the average [s].
    """

    def __init__(self, *, period_s: float, oldest: int) -> None:
        """Begins at zero.

        Args:
            period_s: from tick to tick [s].
            oldest: an age above counts as this, so that one long silence, which the
                watchdog acts on, does not count as a slow loop [ticks].
        """
        self._period_s, self._oldest = period_s, oldest
        self._blend = period_s / AVERAGED_OVER_S
        self._answered: int | None = None
        self.mean_s = 0.0

    def restart(self) -> None:
        """Forgets everything; counts again from the next command on."""
        self._answered = None
        self.mean_s = 0.0

    def follow(self, answered: int) -> None:
        """The servos follow a command that answers the sensors of this tick."""
        self._answered = answered

    def count(self, tick: int) -> None:
        """Counts a tick that begins while the robot is commanded."""
        if self._answered is None:
            return
        age_s = self._period_s * min(tick - self._answered, self._oldest)
        self.mean_s += self._blend * (age_s - self.mean_s)
