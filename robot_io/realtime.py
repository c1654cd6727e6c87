"""How robot and controller keep time with each other."""

from __future__ import annotations

import errno
import gc
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum

import numpy as np

from surefoot.robot_io.timing import TimingLog

SWITCH_INTERVAL_S = 1e-4
"""Longest wait of another thread for the interpreter [s]; Python's default is 5 ms."""
NS_PER_S = 1e9
MAX_LAG_PERIODS = 5
"""A loop that is late by more does not try to catch up: a burst of ticks in no time
would ask the impossible of whoever answers them."""


class Pace(StrEnum):
    """Whose time counts."""

    LOCKSTEP = "lockstep"
    """The robot waits for the answer to each tick: the same run every time."""
    REALTIME = "realtime"
    """The robot goes by the clock and follows the newest command, as hardware does."""


@contextmanager
def quiet_interpreter() -> Iterator[None]:
    """Stop garbage collection and give other threads short turns, while inside.

    Numbers that overflow make no warning either: a loop looks at its numbers itself.

    What the loop allocates must be free of cycles, as it is not collected until the
    end.
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
    """Waits for one instant after the other, a period apart, without drift.

    Attributes:
        skipped: periods given up.
    """

    def __init__(self, period_s: float, *, lateness: TimingLog) -> None:
        """Begin now.

        Args:
            period_s: from tick to tick [s].
            lateness: takes how late each tick began.
        """
        self.skipped = 0
        self._period_ns = round(period_s * NS_PER_S)
        self._lateness = lateness
        self._next_ns = time.monotonic_ns() + self._period_ns

    def restart(self) -> None:
        """Begin anew, as if the last tick were now."""
        self._next_ns = time.monotonic_ns() + self._period_ns

    def wait(self) -> None:
        """Sleep until the next tick is due; not at all when it already is."""
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
    """Keep this thread, and those it starts, on one processor.

    Args:
        cpu: its number, from 0.

    Returns:
        Why that was not done; empty when it was.
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
    """Run this thread, and those it starts, before all ordinary ones (SCHED_FIFO).

    Args:
        priority: 1 to 99; the higher one runs.

    Returns:
        Why that was not done, and what to do about it; empty when it was.
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
    """Run this thread as an ordinary one, whatever it has inherited from its maker."""
    if hasattr(os, "sched_setscheduler") and os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _limit() -> str:
    """Return the largest real-time priority this account may ask for."""
    import resource  # not on every system; this one has it, or has no SCHED_FIFO

    soft, _ = resource.getrlimit(resource.RLIMIT_RTPRIO)
    return "none" if soft == resource.RLIM_INFINITY else str(soft)


def _why(error: Exception) -> str:
    if isinstance(error, PermissionError):
        return "not permitted"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()
    return str(error)
