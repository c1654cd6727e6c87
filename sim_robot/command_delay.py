"""The way a command takes: the answer to tick k acts from tick k + d on."""

from __future__ import annotations

from surefoot.schemas.arrays import Array
from surefoot.sim_robot.errors import CommandError


class CommandDelay:
    """Holds answers back for a fixed number of ticks.

    Attributes:
        ticks: the delay d.
    """

    def __init__(self, ticks: int, *, posture: Array) -> None:
        """Start without answers.

        Args:
            ticks: d, zero or more.
            posture: (n_a,) acts until the first answer does [rad].
        """
        self.ticks = ticks
        self._answers: dict[int, Array] = {}
        self._acting = posture

    def needed(self, tick: int) -> int | None:
        """The tick whose answer acts in the step from ``tick`` on, if any."""
        return tick - self.ticks if tick >= self.ticks else None

    def put(self, q_command: Array, *, answers: int, now: int) -> None:
        """Take in the answer to a tick.

        Args:
            q_command: (n_a,) [rad]; copied.
            answers: the tick it answers.
            now: the present tick.

        Raises:
            CommandError: it answers a tick to come, or one too long ago to act.
        """
        if not now - self.ticks <= answers <= now:
            raise CommandError(
                f"command: answers tick {answers} at tick {now}, expected one from "
                f"{max(0, now - self.ticks)} to {now} with a delay of {self.ticks} "
                "ticks; drop commands that come too late"
            )
        self._answers[answers] = q_command.copy()

    def take(self, now: int) -> Array:
        """The posture for the step from ``now`` on, (n_a,) [rad].

        Without the answer that is due, the posture before goes on acting.
        """
        answer = self._answers.pop(now - self.ticks, None)
        if answer is not None:
            self._acting = answer
        return self._acting
