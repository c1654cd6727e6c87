"""Ticks by the clock."""

from __future__ import annotations

import time

from robot_io.timing import TimingLog

NS_PER_S = 1e9
MAX_LAG_PERIODS = 5
"""A loop that is late by more does not try to catch up: a burst of ticks in no time
would ask the impossible of whoever answers them."""


class Pacer:
    """Waits for one instant after the other, a period apart, without drift.

    Attributes:
        skipped: periods given up.
    """

    def __init__(self, period_s: float, *, lateness: TimingLog) -> None:
        """Begins now.

        Args:
            period_s: from tick to tick [s].
            lateness: takes how late each tick began.
        """
        self.skipped = 0
        self._period_ns = round(period_s * NS_PER_S)
        self._lateness = lateness
        self._next_ns = time.monotonic_ns() + self._period_ns

    def restart(self) -> None:
        """Begins anew, as if the last tick were now."""
        self._next_ns = time.monotonic_ns() + self._period_ns

    def wait(self) -> None:
        """Sleeps until the next tick is due; not at all when it already is."""
        ahead_ns = self._next_ns - time.monotonic_ns()
        if ahead_ns > 0:
            time.sleep(ahead_ns / NS_PER_S)  # the robot's own period
        late_ns = time.monotonic_ns() - self._next_ns
        self._lateness.add(late_ns)
        self._next_ns += self._period_ns
        if late_ns > MAX_LAG_PERIODS * self._period_ns:
            behind = late_ns // self._period_ns
            self.skipped += behind
            self._next_ns += behind * self._period_ns
