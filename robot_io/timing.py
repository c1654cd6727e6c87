"""Durations of a loop, kept without allocating."""

from __future__ import annotations

import time

import numpy as np

from surefoot.schemas.result import Distribution, Histogram

MS_PER_NS = 1e-6
EDGES_MS = (
    *(0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5),
    *(2.0, 3.0, 5.0, 7.0, 10.0, 20.0, 50.0, 100.0, 1000.0),
)
"""Fine around a control period, coarse where only its order counts."""
TICKS_KEPT = 1024
"""Ticks whose sensors' stamp is remembered; older answers are refused anyway."""
_NOTHING = 0


class TimingLog:
    """The newest durations of something that happens every tick."""

    def __init__(self, capacity: int) -> None:
        """Start empty.

        Args:
            capacity: how many are kept; the oldest make room.
        """
        self._durations_ns = np.zeros(capacity, dtype=np.int64)
        self._capacity = capacity
        self._count = 0

    def __len__(self) -> int:
        """How many are kept."""
        return min(self._count, self._capacity)

    def add(self, duration_ns: int) -> None:
        """Add a duration [ns]."""
        self._durations_ns[self._count % self._capacity] = duration_ns
        self._count += 1

    def distribution(self) -> Distribution:
        """Return median, 99th percentile and maximum [ms]; zeros when empty."""
        if not self._count:
            return Distribution(median=0.0, p99=0.0, max=0.0)
        kept = self._durations_ns[: len(self)]
        median, p99 = MS_PER_NS * np.percentile(kept, (50.0, 99.0))
        return Distribution(
            median=float(median), p99=float(p99), max=float(MS_PER_NS * kept.max())
        )

    def histogram(self) -> Histogram:
        """How often it took how long."""
        kept = MS_PER_NS * self._durations_ns[: len(self)]
        bins = np.searchsorted(EDGES_MS, kept, side="right")
        counts = np.bincount(bins, minlength=len(EDGES_MS) + 1)
        return Histogram(edges_ms=list(EDGES_MS), counts=counts.tolist())


class CommandLatency:
    """Measures sensor-to-servo latency on the robot's clock.

    Attributes:
        log: stamp of the sensors to command applied; one per command that acts.
    """

    def __init__(self, capacity: int) -> None:
        """Start empty.

        Args:
            capacity: how many are kept.
        """
        self.log = TimingLog(capacity)
        self._stamps_ns = [_NOTHING] * TICKS_KEPT
        self._acting_ns = [_NOTHING] * TICKS_KEPT

    def sensed(self, tick: int, *, stamp_ns: int) -> None:
        """Note when the sensors of a tick were stamped."""
        self._stamps_ns[tick % TICKS_KEPT] = stamp_ns

    def stamp_ns(self, tick: int) -> int:
        """Return when the sensors of a recent tick were stamped [ns]."""
        return self._stamps_ns[tick % TICKS_KEPT]

    def taken(self, answered_tick: int, *, acts_at: int) -> None:
        """Note a command that the gate let pass.

        Args:
            answered_tick: the tick it answers.
            acts_at: the tick in whose step the servos begin to follow it.
        """
        self._acting_ns[acts_at % TICKS_KEPT] = self.stamp_ns(answered_tick)

    def applied(self, tick: int) -> None:
        """Note that the servos follow what acts from this tick on."""
        index = tick % TICKS_KEPT
        if self._acting_ns[index] != _NOTHING:
            self.log.add(time.monotonic_ns() - self._acting_ns[index])
            self._acting_ns[index] = _NOTHING
