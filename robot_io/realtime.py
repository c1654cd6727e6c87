"""Pace, priority, timing and orderly end of a control loop on the clock."""

from __future__ import annotations

import errno
import gc
import math
import os
import signal
import sys
import threading
import time
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from enum import StrEnum
from types import FrameType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.schemas.arrays import MS_PER_NS, NS_PER_S
from surefoot.schemas.reasons import SIGNALS
from surefoot.schemas.result import NO_TIME, Distribution, Histogram

EDGES_MS = (
    *(0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5),
    *(2.0, 3.0, 5.0, 7.0, 10.0, 20.0, 50.0, 100.0, 1000.0),
)
"""Edges of the histogram: fine around a control period, coarse elsewhere [ms]."""
RESOLUTION = 0.01
"""Relative step of the percentiles of a whole run."""
FINEST_NS = 100
"""Shorter durations count as this one [ns]."""
_STEPS_PER_E = 1.0 / math.log1p(RESOLUTION)
_STEPS = 2 + int(_STEPS_PER_E * math.log(1e12 / FINEST_NS))
"""Number of steps: up to a quarter of an hour; longer durations count as that."""
_EDGES_NS = [round(edge / MS_PER_NS) for edge in EDGES_MS]
TICKS_KEPT = 1024
"""Ticks whose sensor stamp is kept; older answers are refused anyway."""
_NOTHING = 0
SWITCH_INTERVAL_S = 1e-4
"""Longest wait of another thread for the interpreter [s]; Python's default is 5 ms."""
MAX_LAG_PERIODS = 5
"""A loop that is later than this many periods does not catch up: nobody could answer
a burst of ticks in no time."""


def distribution_of(
    times_ms: Sequence[float] | NDArray[np.floating[Any]],
) -> Distribution:
    """Return median, 99th percentile and maximum of at least one time [ms]."""
    median, p99, most = np.percentile(times_ms, (50.0, 99.0, 100.0)).tolist()
    return Distribution(median=median, p99=p99, max=most)


class TimingLog:
    """Durations of an event of every tick, for any number of ticks.

    It counts durations in steps of ``RESOLUTION``, so its memory does not grow.
    Percentiles are accurate to half a step; the maximum and the histogram are exact.
    """

    def __init__(self) -> None:
        """Start empty."""
        self._steps = np.zeros(_STEPS + 1, dtype=np.int64)
        self._bins = [0] * (len(EDGES_MS) + 1)
        self._count = 0
        self._least_ns = self._largest_ns = 0

    def __len__(self) -> int:
        """Return the number of durations."""
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
        """Return median, 99th percentile and maximum [ms]; zeros when empty."""
        if not self._count:
            return NO_TIME
        return Distribution(
            median=self._percentile_ms(0.5),
            p99=self._percentile_ms(0.99),
            max=MS_PER_NS * self._largest_ns,
        )

    def histogram(self) -> Histogram:
        """Return the number of durations in each bin of ``EDGES_MS``."""
        return Histogram(edges_ms=list(EDGES_MS), counts=list(self._bins))

    def _percentile_ms(self, share: float) -> float:
        """Return the middle of the step that contains the given quantile [ms]."""
        rank = share * (self._count - 1)
        step = int(np.searchsorted(np.cumsum(self._steps), rank, side="right"))
        middle_ns = FINEST_NS * math.exp((step + 0.5) / _STEPS_PER_E)
        return MS_PER_NS * min(max(middle_ns, self._least_ns), self._largest_ns)


class RecentTimes:
    """The newest durations of an event of every tick."""

    def __init__(self, capacity: int) -> None:
        """Start empty."""
        self._durations_ns = np.zeros(capacity, dtype=np.int64)
        self._count = 0

    def add(self, duration_ns: int) -> None:
        """Add a duration [ns]."""
        self._durations_ns[self._count % len(self._durations_ns)] = duration_ns
        self._count += 1

    def distribution(self) -> Distribution:
        """Return median, 99th percentile and maximum [ms]; zeros when empty."""
        if not self._count:
            return NO_TIME
        return distribution_of(MS_PER_NS * self._durations_ns[: self._count])


class CommandLatency:
    """Measures sensor-to-servo latency on the robot's clock.

    Attributes:
        log: durations from sensor stamp to applied command, one per acting command.
    """

    def __init__(self) -> None:
        """Start empty."""
        self.log = TimingLog()
        self._stamps_ns = [_NOTHING] * TICKS_KEPT
        self._acting_ns = [_NOTHING] * TICKS_KEPT

    def sensed(self, tick: int, *, stamp_ns: int) -> None:
        """Record the stamp of a tick's sensors [ns]."""
        self._stamps_ns[tick % TICKS_KEPT] = stamp_ns

    def stamp_ns(self, tick: int) -> int:
        """Return the stamp of a recent tick's sensors [ns]."""
        return self._stamps_ns[tick % TICKS_KEPT]

    def taken(self, answered_tick: int, *, acts_at: int) -> None:
        """Record a command that the gate let pass.

        Args:
            answered_tick: the tick that the command answers.
            acts_at: the tick in whose step the servos begin to follow it.
        """
        self._acting_ns[acts_at % TICKS_KEPT] = self.stamp_ns(answered_tick)

    def applied(self, tick: int) -> None:
        """Record that the servos now follow the command that acts from this tick on."""
        index = tick % TICKS_KEPT
        if self._acting_ns[index] != _NOTHING:
            self.log.add(time.monotonic_ns() - self._acting_ns[index])
            self._acting_ns[index] = _NOTHING


class Pace(StrEnum):
    """The clock that sets the pace of a run."""

    LOCKSTEP = "lockstep"
    """The robot waits for the answer to each tick: the same run every time."""
    REALTIME = "realtime"
    """The robot keeps to the clock and follows the newest command, like hardware."""


@contextmanager
def quiet_interpreter() -> Iterator[None]:
    """Stop garbage collection and shorten the turns of other threads inside.

    Overflow gives no warnings either: a loop checks its numbers itself.

    Objects that the loop allocates must be free of cycles: cycles are not collected
    until the end.
    """
    switch_interval_s = sys.getswitchinterval()
    was_enabled = gc.isenabled()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            yield
    finally:
        sys.setswitchinterval(switch_interval_s)
        gc.unfreeze()
        if was_enabled:
            gc.enable()


class Pacer:
    """Waits for one instant after the other, one period apart, without drift.

    Attributes:
        skipped: number of periods given up.
    """

    def __init__(self, period_s: float, *, lateness: TimingLog) -> None:
        """Begin now.

        Args:
            period_s: time from tick to tick [s].
            lateness: receives the lateness of each tick.
        """
        self.skipped = 0
        self._period_ns = round(period_s * NS_PER_S)
        self._lateness = lateness
        self._next_ns = time.monotonic_ns() + self._period_ns

    def restart(self) -> None:
        """Begin anew, as if the last tick were now."""
        self._next_ns = time.monotonic_ns() + self._period_ns

    def wait(self) -> None:
        """Sleep until the next tick is due; return at once when it already is."""
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


def pin_to_cpu(cpu: int) -> str:
    """Keep this thread, and threads it starts, on one processor.

    Returns:
        Reason why this was not done; empty when it was.
    """
    if not hasattr(os, "sched_setaffinity"):
        return f"--cpu {cpu}: this system cannot pin a process; going on without"
    allowed = sorted(os.sched_getaffinity(0))
    try:
        os.sched_setaffinity(0, {cpu})
    except (OSError, ValueError) as error:
        is_unknown = getattr(error, "errno", errno.EINVAL) == errno.EINVAL
        why = "no such processor" if is_unknown else _why(error)
        return (
            f"--cpu {cpu}: not done, {why}; this process may use processors "
            f"{', '.join(map(str, allowed))}; going on without"
        )
    return ""


def take_priority(priority: int) -> str:
    """Run this thread, and threads it starts, before all ordinary ones (SCHED_FIFO).

    Args:
        priority: 1 to 99; the thread with the higher one runs.

    Returns:
        Reason why this was not done, and a remedy; empty when it was.
    """
    if not hasattr(os, "sched_setscheduler"):
        return (
            f"--realtime-priority {priority}: this system knows no SCHED_FIFO; going "
            "on without"
        )
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        return (
            f"--realtime-priority {priority}: not done, {_why(error)} (limit of this "
            f"account: {_limit()}); allow it by '- rtprio {priority}' for the account "
            f"in /etc/security/limits.conf, or LimitRTPRIO={priority} in the systemd "
            "unit; going on without"
        )
    return ""


def leave_priority() -> None:
    """Run this thread as an ordinary one, whatever priority it has inherited."""
    if hasattr(os, "sched_setscheduler") and os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _limit() -> str:
    """Return the largest real-time priority open to this account."""
    import resource  # not on every system; this one has it, or has no SCHED_FIFO

    soft, _ = resource.getrlimit(resource.RLIMIT_RTPRIO)
    return "none" if soft == resource.RLIM_INFINITY else str(soft)


def _why(error: Exception) -> str:
    if isinstance(error, PermissionError):
        return "not permitted"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()
    return str(error)


class StopRequest:
    """A request to end, from a signal or from another thread.

    The first signal asks for an orderly end, the second for an immediate one. A third
    is not caught any more: the system ends the process.

    Attributes:
        is_set: whether the end was requested.
        is_urgent: whether a signal has requested it again, at once.
        cause: name of the signal, or another cause.
    """

    def __init__(self) -> None:
        """Start without a request."""
        self.is_set = False
        self.is_urgent = False
        self.cause = ""
        self._wake: Callable[[], None] | None = None

    def set(self, cause: str = "asked to stop") -> None:
        """Request the end; only sets flags, so a signal handler may call it."""
        self.cause = self.cause or cause
        self.is_set = True
        if self._wake is not None:
            self._wake()

    def waking(self, wake: Callable[[], None]) -> None:
        """Set the callback that ends a wait when a request comes.

        Args:
            wake: sets at most a flag; called from signal handlers.
        """
        self._wake = wake
        if self.is_set:
            wake()

    @contextmanager
    def on_signals(self) -> Iterator[None]:
        """Turn signals into requests; only the main thread receives any."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.getsignal(number) for number in SIGNALS}
        for number in SIGNALS:
            signal.signal(number, self._on_signal)
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self.is_set:
            self.is_urgent = True
            for caught in SIGNALS:
                signal.signal(caught, signal.SIG_DFL)
        self.set(signal.Signals(number).name)
