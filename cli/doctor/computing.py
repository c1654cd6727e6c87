"""What bears on the time a tick takes: processors, algebra, codec, clock, priority."""

from __future__ import annotations

import os
import resource
import time
from importlib.util import find_spec

from surefoot.cli.doctor.examine import Diagnosis, Severity, finding

ENOUGH_CPUS = 2
JITTER_TICKS = 500
TICK_S = 1e-3
MS_PER_S = 1e3
GOOD_JITTER_S = 0.5e-3
"""Wake-up delay that a control period of 1 ms tolerates [s]."""
RT_PRIORITY = 50


def check_blas() -> Diagnosis:
    """Check that linear algebra works in one thread."""
    import numpy as np
    from threadpoolctl import threadpool_info

    np.linalg.cholesky(np.eye(2))  # loads what is to be asked
    pools = [pool for pool in threadpool_info() if pool["user_api"] == "blas"]
    threads = max((int(pool["num_threads"]) for pool in pools), default=0)
    kinds = ", ".join(
        sorted({f"{pool['internal_api']} {pool['version']}" for pool in pools})
    )
    return finding(
        "linear algebra",
        f"{kinds}, {threads} thread{'s' if threads != 1 else ''}"
        if pools
        else "a library that does not tell its threads",
        bad=Severity.WARN if threads > 1 else None,
        advice="export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 (or unset them); more "
        "threads only make a tick of small matrices slower",
    )


def check_msgpack() -> Diagnosis:
    """Check that MessagePack has its compiled part."""
    is_compiled = find_spec("msgpack._cmsgpack") is not None
    return finding(
        "MessagePack",
        "compiled" if is_compiled else "pure Python",
        bad=None if is_compiled else Severity.WARN,
        advice="pip install --force-reinstall --only-binary :all: msgpack; pure Python "
        "takes ten times as long to say what is wrong with a message",
    )


def check_processors() -> Diagnosis:
    """Check how many processors this process may use, and how busy they are."""
    count = _usable_cpus()
    load = os.getloadavg()[0]
    words = f"{count} processor{'s' if count != 1 else ''}, load {load:.1f}"
    few = count < ENOUGH_CPUS
    return finding(
        "processors",
        words,
        bad=Severity.WARN if few or load > count else None,
        advice=(
            "robot and stabilizer share one: lockstep is slower, real time misses ticks"
            if few
            else "something else is computing: real-time runs miss ticks and timings "
            "mean little; lockstep gives the same figures, later"
        ),
    )


def check_clock() -> Diagnosis:
    """Measure how late a sleeping process is woken."""
    late = []
    due = time.monotonic()
    for _ in range(JITTER_TICKS):
        due += TICK_S
        time.sleep(max(0.0, due - time.monotonic()))  # how late it ends is the finding
        late.append(time.monotonic() - due)
        due = max(due, time.monotonic() - TICK_S)
    late.sort()
    median, p99, most = late[JITTER_TICKS // 2], late[-JITTER_TICKS // 100], late[-1]
    return finding(
        "clock",
        f"1 ms sleeps end late by {median * MS_PER_S:.2f} ms (median), "
        f"{p99 * MS_PER_S:.2f} (p99), {most * MS_PER_S:.2f} (max)",
        bad=Severity.WARN if p99 > GOOD_JITTER_S else None,
        advice="of consequence with --realtime only: stop what else runs, use bare "
        "metal rather than a virtual machine, and give real-time priority",
    )


def check_priority() -> Diagnosis:
    """Check that processes may have real-time priority."""
    limit = getattr(resource, "RLIMIT_RTPRIO", None)
    if limit is None or not hasattr(os, "sched_setscheduler"):
        return Diagnosis(
            name="real-time priority",
            verdict=Severity.WARN,
            got="this system has none to give",
            advice="simulate here; drive a robot from Linux",
        )
    soft, _ = resource.getrlimit(limit)
    may = _may_be_real_time()
    return finding(
        "real-time priority",
        f"{'allowed' if may else 'not allowed'} (rtprio limit {soft})",
        bad=None if may else Severity.WARN,
        advice="for hardware only: add '@YOURGROUP - rtprio 99' to "
        "/etc/security/limits.conf and log in again",
    )


def _usable_cpus() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _may_be_real_time() -> bool:
    """Try it for a moment: the limit alone is not enough, since root has none."""
    policy, before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(RT_PRIORITY))
    except PermissionError:
        return False
    os.sched_setscheduler(0, policy, before)
    return True
