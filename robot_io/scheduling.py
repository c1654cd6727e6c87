"""A processor and a real-time priority for a control loop, where permitted."""

from __future__ import annotations

import errno
import os


def pin_to_cpu(cpu: int) -> str:
    """Keeps this thread, and those it starts, on one processor.

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
    """Runs this thread, and those it starts, before all ordinary ones (SCHED_FIFO).

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


def _limit() -> str:
    """The largest real-time priority this account may ask for."""
    import resource  # not on every system; this one has it, or has no SCHED_FIFO

    soft, _ = resource.getrlimit(resource.RLIMIT_RTPRIO)
    return "none" if soft == resource.RLIM_INFINITY else str(soft)


def _why(error: Exception) -> str:
    if isinstance(error, PermissionError):
        return "not permitted"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()
    return str(error)
