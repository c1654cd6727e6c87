"""Durations of a loop, kept in memory that does not grow."""

from __future__ import annotations

import math
import time
from bisect import bisect_right

import numpy as np

from surefoot.schemas.result import Distribution, Histogram

MS_PER_NS = 1e-6
EDGES_MS = (
    *(0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5),
    *(2.0, 3.0, 5.0, 7.0, 10.0, 20.0, 50.0, 100.0, 1000.0),
)
"""Fine around a control period, coarse where only its order counts."""
RESOLUTION = 0.01
"""Percentiles of a whole run are told in steps of one hundredth of their value."""
FINEST_NS = 100
"""Shorter durations count as this."""
_STEPS_PER_E = 1.0 / math.log1p(RESOLUTION)
_STEPS = 2 + int(_STEPS_PER_E * math.log(1e12 / FINEST_NS))
"""Up to a quarter of an hour; what takes longer counts as that."""
_EDGES_NS = [round(edge / MS_PER_NS) for edge in EDGES_MS]
TICKS_KEPT = 1024
"""Ticks whose sensors' stamp is remembered; older answers are refused anyway."""
_NOTHING = 0


class TimingLog:
    """Durations of something that happens every tick, however many there are.

    It counts them in steps of ``RESOLUTION``, so that its memory does not grow:
    percentiles are true to half a step, the largest and the histogram exactly.
    """

    def __init__(self) -> None:
        """Start empty."""
        self._steps = np.zeros(_STEPS + 1, dtype=np.int64)
        self._bins = [0] * (len(EDGES_MS) + 1)
        self._count = 0
        self._least_ns = self._largest_ns = 0

    def __len__(self) -> int:
        """How many there were."""
        return self._count

    def add(self, duration_ns: int) -> None:
        """Add a duration [ns]."""
        if duration_ns > self._largest_ns:
            self._largest_ns = duration_ns
        if duration_ns < self._least_ns or not self._count:
            self._least_ns = duration_ns
        self._count += 1
        self._bins[bisect_right(_EDGES_NS, duration_ns)] += 1
        step = int(_STEPS_PER_E * math.log(max(duration_ns, FINEST_NS) / FINEST_NS))
        self._steps[min(step, _STEPS)] += 1

    def distribution(self) -> Distribution:
        """Median, 99th percentile and maximum [ms]; zeros when there is nothing."""
        if not self._count:
            return Distribution(median=0.0, p99=0.0, max=0.0)
        return Distribution(
            median=self._percentile_ms(0.5),
            p99=self._percentile_ms(0.99),
            max=MS_PER_NS * self._largest_ns,
        )

    def histogram(self) -> Histogram:
        """How often it took how long."""
        return Histogram(edges_ms=list(EDGES_MS), counts=list(self._bins))

    def _percentile_ms(self, share: float) -> float:
        """Middle of the step that so large a share of all lies below."""
        rank = share * (self._count - 1)
        step = int(np.searchsorted(np.cumsum(self._steps), rank, side="right"))
        middle_ns = FINEST_NS * math.exp((step + 0.5) / _STEPS_PER_E)
        return MS_PER_NS * min(max(middle_ns, self._least_ns), self._largest_ns)


class RecentTimes:
    """The newest durations of something that happens every tick."""

    def __init__(self, capacity: int) -> None:
        """Start empty.

        Args:
            capacity: how many are kept; the oldest make room.
        """
        self._durations_ns = np.zeros(capacity, dtype=np.int64)
        self._count = 0

    def add(self, duration_ns: int) -> None:
        """Add a duration [ns]."""
        self._durations_ns[self._count % len(self._durations_ns)] = duration_ns
        self._count += 1

    def distribution(self) -> Distribution:
        """Return median, 99th percentile and maximum [ms]; zeros when empty."""
        if not self._count:
            return Distribution(median=0.0, p99=0.0, max=0.0)
        kept = MS_PER_NS * self._durations_ns[: self._count]
        median, p99 = np.percentile(kept, (50.0, 99.0))
        return Distribution(median=float(median), p99=float(p99), max=float(kept.max()))


class CommandLatency:
    """Measures sensor-to-servo latency on the robot's clock.

    Attributes:
        log: stamp of the sensors to command applied; one per command that acts.
    """

    def __init__(self) -> None:
        """Start empty."""
        self.log = TimingLog()
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
