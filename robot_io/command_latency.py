"""End to end: from a tick's sensors to the servos that follow its answer."""

from __future__ import annotations

import time

from robot_io.timing import TimingLog

TICKS_KEPT = 1024
"""Ticks whose sensors' stamp is remembered; older answers are refused anyway."""
_NOTHING = 0


class CommandLatency:
    """Times what a whole-body loop is about, on one clock, the robot's.

    Attributes:
        log: stamp of the sensors to command applied; one per command that acts.
    """

    def __init__(self, capacity: int) -> None:
        """Starts empty.

        Args:
            capacity: how many are kept.
        """
        self.log = TimingLog(capacity)
        self._stamps_ns = [_NOTHING] * TICKS_KEPT
        self._acting_ns = [_NOTHING] * TICKS_KEPT

    def sensed(self, tick: int, *, stamp_ns: int) -> None:
        """The sensors of a tick were stamped."""
        self._stamps_ns[tick % TICKS_KEPT] = stamp_ns

    def stamp_ns(self, tick: int) -> int:
        """When the sensors of a recent tick were stamped [ns]."""
        return self._stamps_ns[tick % TICKS_KEPT]

    def taken(self, answered_tick: int, *, acts_at: int) -> None:
        """A command was let through.

        Args:
            answered_tick: the tick it answers.
            acts_at: the tick in whose step the servos begin to follow it.
        """
        self._acting_ns[acts_at % TICKS_KEPT] = self.stamp_ns(answered_tick)

    def applied(self, tick: int) -> None:
        """The servos follow what acts from this tick on."""
        index = tick % TICKS_KEPT
        if self._acting_ns[index] != _NOTHING:
            self.log.add(time.monotonic_ns() - self._acting_ns[index])
            self._acting_ns[index] = _NOTHING
