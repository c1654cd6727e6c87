"""Durations of a loop, kept without allocating."""

from __future__ import annotations

import numpy as np

from schemas.result import Distribution

MS_PER_NS = 1e-6


class TimingLog:
    """The newest durations of something that happens every tick."""

    def __init__(self, capacity: int) -> None:
        """Starts empty.

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
        """Adds a duration [ns]."""
        self._durations_ns[self._count % self._capacity] = duration_ns
        self._count += 1

    def distribution(self) -> Distribution:
        """Median, 99th percentile and maximum [ms]; zeros when there is nothing."""
        if not self._count:
            return Distribution(median=0.0, p99=0.0, max=0.0)
        kept = self._durations_ns[: len(self)]
        median, p99 = MS_PER_NS * np.percentile(kept, (50.0, 99.0))
        return Distribution(
            median=float(median), p99=float(p99), max=float(MS_PER_NS * kept.max())
        )
