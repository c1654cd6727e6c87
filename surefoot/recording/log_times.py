"""When a message of a record happened, on the time axis of a viewer."""

from __future__ import annotations

from surefoot.recording.counts import LARGEST_GAP
from surefoot.schemas.codec import Head

_NEW_RUN_TICKS = 1000
"""A tick so far behind is another run of the robot, not a late message."""
_NO_TICKS = ("reference", "walk")
"""Planners need not count the robot's ticks: what they say is of the present."""


class LogTimes:
    """Log times of messages: by their stamps, or by the robot's ticks.

    In lockstep the clock on the wall says nothing: ticks do. A robot that begins anew
    goes on behind what it did before, so that times never go back.

    Attributes:
        latest: the latest time given out [ns]; 0 before the first.
    """

    def __init__(self, period_ns: int | None) -> None:
        """Begin.

        Args:
            period_ns: of a tick, for simulated time [ns]; None for the senders' stamps.
        """
        self.latest = 0
        self._period_ns = period_ns
        self._begins = [0]
        self._rounds: dict[str, int] = {}
        self._ticks: dict[str, int] = {}

    @property
    def meaning(self) -> str:
        """What the times are, for whoever opens the file."""
        if self._period_ns is None:
            return "the sender's monotonic clock, as publish time"
        return "simulated: tick times period; publish time is the sender's clock"

    def of(self, channel: str, head: Head) -> int:
        """Time of a message [ns]."""
        time_ns = self._time_ns(channel, head)
        self.latest = max(self.latest, time_ns)
        return time_ns

    def _time_ns(self, channel: str, head: Head) -> int:
        if self._period_ns is None:
            return head.stamp_ns
        before, tick = self._ticks.get(channel, 0), head.tick
        if channel in _NO_TICKS or tick > before + LARGEST_GAP:
            return self.latest
        self._ticks[channel] = tick
        turn = self._rounds.get(channel, 0)
        if tick < before - _NEW_RUN_TICKS:
            turn += 1
            if turn == len(self._begins):
                self._begins.append(self.latest + self._period_ns)
        self._rounds[channel] = turn
        return self._begins[turn] + tick * self._period_ns
