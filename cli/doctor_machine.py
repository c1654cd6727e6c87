"""The findings of ``surefoot doctor`` on the machine, and the order of all checks.

Each check imports what it needs, so that others work when a package is missing.
"""

from __future__ import annotations

import os
import resource
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from surefoot.cli.doctor_packages import (
    Diagnosis,
    Severity,
    check_extras,
    check_msgpack,
    check_packages,
    check_python,
    finding,
)
from surefoot.schemas.arrays import MS_PER_S

RECORD_BYTES_PER_S = 4.6e6
"""Rate of a real-time run's files at 1 kHz: 2.7 MB/s messages, 1.9 MB/s ticks."""
WANTED_S = 600.0
"""Recording time below which the disk counts as too full [s]."""
GL_TIMEOUT_S = 60.0
SLOW_ROUND_TRIP_MS = 2.0
_GL_BACKENDS = ("egl", "osmesa")
_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")
ENOUGH_CPUS = 2
JITTER_TICKS = 500
TICK_S = 1e-3
GOOD_JITTER_MS = 0.5
"""Wake-up delay that a control period of 1 ms tolerates."""
RT_PRIORITY = 50


def examine() -> Iterator[Diagnosis]:
    """Run all checks; one that cannot be imported becomes a finding of its own."""
    from surefoot.cli.console import import_advice

    for name, check in _CHECKS.items():
        try:
            found = check()
            yield from (found,) if isinstance(found, Diagnosis) else found
        except ImportError as error:
            yield finding(
                name,
                str(error),
                bad=True,
                as_bad_as=Severity.FAIL,
                advice=import_advice(error),
            )


def check_processors() -> Diagnosis:
    """Check the number of processors for this process, and their load."""
    from joblib import cpu_count

    count, load = cpu_count(), os.getloadavg()[0]
    few = count < ENOUGH_CPUS
    return finding(
        "processors",
        f"{count} processor{'s' if count != 1 else ''}, load {load:.1f}",
        bad=few or load > count,
        advice=(
            "robot and stabilizer share one: lockstep is slower, real time misses ticks"
            if few
            else "something else is computing: real-time runs miss ticks and timings "
            "are unreliable; lockstep runs give the same figures, only later"
        ),
    )


def check_clock() -> Diagnosis:
    """Measure how late a sleeping process wakes up."""
    from surefoot.robot_io.realtime import distribution_of

    late = []
    due = time.monotonic()
    for _ in range(JITTER_TICKS):
        due += TICK_S
        time.sleep(max(0.0, due - time.monotonic()))  # measures how late it returns
        late.append(time.monotonic() - due)
        due = max(due, time.monotonic() - TICK_S)
    times = distribution_of([MS_PER_S * late_s for late_s in late])
    return finding(
        "clock",
        f"1 ms sleeps end late by {times.median:.2f} ms (median), "
        f"{times.p99:.2f} (p99), {times.max:.2f} (max)",
        bad=times.p99 > GOOD_JITTER_MS,
        advice="matters with --realtime only: stop other programs, use bare metal "
        "rather than a virtual machine, and give real-time priority",
    )


def check_priority() -> Diagnosis:
    """Check that processes may have real-time priority, by taking it for a moment."""
    from surefoot.robot_io.realtime import leave_priority, take_priority

    limit = getattr(resource, "RLIMIT_RTPRIO", None)
    if limit is None or not hasattr(os, "sched_setscheduler"):
        return finding(
            "real-time priority",
            "this system has none to give",
            bad=True,
            advice="simulate here; drive a robot from Linux",
        )
    # The limit alone does not tell, since root needs none.
    refusal = take_priority(RT_PRIORITY)
    leave_priority()
    soft, _ = resource.getrlimit(limit)
    return finding(
        "real-time priority",
        f"{'not allowed' if refusal else 'allowed'} (rtprio limit {soft})",
        bad=bool(refusal),
        advice="for hardware only: add '@YOURGROUP - rtprio 99' to "
        "/etc/security/limits.conf and log in again",
    )


def check_blas() -> Diagnosis:
    """Check that the BLAS library uses one thread."""
    import numpy as np
    from threadpoolctl import threadpool_info

    np.linalg.cholesky(np.eye(2))  # loads the library
    pools = [pool for pool in threadpool_info() if pool["user_api"] == "blas"]
    threads = max((int(pool["num_threads"]) for pool in pools), default=0)
    kinds = sorted({f"{pool['internal_api']} {pool['version']}" for pool in pools})
    return finding(
        "linear algebra",
        f"{', '.join(kinds)}, {threads} thread{'s' if threads != 1 else ''}"
        if pools
        else "a library that does not report its threads",
        bad=threads > 1,
        advice="export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 (or unset them); more "
        "threads make a tick slower, since its matrices are small",
    )


def check_bus() -> Diagnosis:
    """Check that Zenoh works on loopback, and measure its round trip."""
    from surefoot.robot_io.bus.bus import loopback_endpoints, measure_loopback
    from surefoot.robot_io.errors import RobotIoError

    name = "Zenoh on loopback"
    try:
        times = measure_loopback(loopback_endpoints())
    except (RobotIoError, OSError) as error:
        return finding(
            name,
            str(error),
            bad=True,
            as_bad_as=Severity.FAIL,
            advice="loopback must be up (ip addr show lo), and no firewall may drop "
            "TCP on 127.0.0.1",
        )
    return finding(
        name,
        f"round trip median {times.median:.2f} ms, p99 {times.p99:.2f} ms",
        bad=times.median > SLOW_ROUND_TRIP_MS,
        advice="this machine is busy; lockstep runs will be slow, real-time ones late",
    )


def check_port() -> Diagnosis:
    """Check that the robot's default port is free."""
    from surefoot.schemas.endpoints import DEFAULT_LOCATOR

    host, port = DEFAULT_LOCATOR.removeprefix("tcp/").split(":")
    busy = ""
    try:
        socket.create_server((host, int(port))).close()
    except OSError as error:
        busy = error.strerror or str(error)
    return finding(
        "port",
        f"{host}:{port}: {busy}" if busy else f"{host}:{port} is free",
        bad=bool(busy),
        advice="fine if that is your robot (surefoot topics tells); otherwise stop the "
        "program that listens there, or use --listen and --connect with another port. "
        "surefoot run picks a free port by itself",
    )


def check_disk() -> Diagnosis:
    """Check how long a record the disk of this folder has room for."""
    from surefoot.recording.write import KEPT_FREE_BYTES

    free = shutil.disk_usage(Path.cwd()).free
    recordable_s = max(0.0, free - KEPT_FREE_BYTES) / RECORD_BYTES_PER_S
    return finding(
        "disk",
        f"{free / 2**30:.1f} GiB free in {Path.cwd()}: records of "
        f"{recordable_s / 60.0:.0f} min",
        bad=recordable_s < WANTED_S,
        advice="make room, or give --out a folder on another disk",
    )


def check_temporary_files() -> Diagnosis:
    """Check that temporary files can be written."""
    fault = ""
    try:
        with tempfile.TemporaryFile() as file:
            file.write(b"surefoot")
            file.flush()
    except OSError as error:
        fault = str(error)
    return finding(
        "temporary files",
        fault or f"in {tempfile.gettempdir()}",
        bad=bool(fault),
        as_bad_as=Severity.FAIL,
        advice="set TMPDIR to a folder that can be written to and has room",
    )


def check_pictures() -> Diagnosis:
    """Check that MuJoCo can draw without a window."""
    name, asked = "pictures (OpenGL)", os.environ.get("MUJOCO_GL")
    works = [
        backend
        for backend in ((asked,) if asked else _GL_BACKENDS)
        if _works("-m", "surefoot.sim_robot.render", MUJOCO_GL=backend)
    ]
    if asked and not works and not _works("-c", "import surefoot.sim_robot.plant"):
        return finding(
            name,
            f"MuJoCo does not load with MUJOCO_GL={asked}",
            bad=True,
            as_bad_as=Severity.FAIL,
            advice="no run starts: leave MUJOCO_GL unset, or write egl or osmesa",
        )
    return finding(
        name,
        f"works with MUJOCO_GL={works[0]}"
        if works
        else f"nothing draws ({asked or ', '.join(_GL_BACKENDS)} tried)",
        bad=not works,
        advice="only for pictures and video: on Debian and Ubuntu apt-get install "
        "libegl1 libgl1-mesa-dri (or libosmesa6), and leave MUJOCO_GL unset or egl",
    )


def _works(*words: str, **variables: str) -> bool:
    """Run Python with these words in a child process: OpenGL may crash it."""
    from surefoot.processes.child import child_environment

    try:
        done = subprocess.run(
            [sys.executable, "-P", *words],
            env={**child_environment(), **variables},
            capture_output=True,
            timeout=GL_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def check_browser() -> Diagnosis:
    """Check that there is a browser for the live page and reports."""
    found = [path for path in map(shutil.which, _BROWSERS) if path]
    if not found and sys.platform == "darwin":
        found = ["the system's own"]
    return finding(
        "browser",
        found[0] if found else "none found",
        bad=not found,
        advice="only needed to look at pages on this machine; reports can be copied, "
        "and the live page reached through ssh -L 8080:127.0.0.1:8080",
    )


def check_margins() -> Iterator[Diagnosis]:
    """Check the margins of every shipped robot with every servo profile."""
    from surefoot.controllers import compute_margins
    from surefoot.robot_io.robot import list_robots, load_robot

    for name in list_robots():
        for profile in load_robot(name).file.servo.profiles:
            found = compute_margins(name, servo_profile=profile)
            yield finding(
                f"margins of {name}, {profile}",
                "; ".join(found.in_words()),
                bad=not found.is_enough,
                advice="this follows from the robot file, not from this machine; "
                "surefoot margins tells more",
            )


_CHECKS: dict[str, Callable[[], Diagnosis | Iterable[Diagnosis]]] = {
    "Python": check_python,
    "packages": check_packages,
    "extras": check_extras,
    "MessagePack": check_msgpack,
    "processors": check_processors,
    "clock": check_clock,
    "real-time priority": check_priority,
    "linear algebra": check_blas,
    "Zenoh on loopback": check_bus,
    "port": check_port,
    "disk": check_disk,
    "temporary files": check_temporary_files,
    "pictures (OpenGL)": check_pictures,
    "browser": check_browser,
    "margins": check_margins,
}
"""In the order of the output; the key names a check whose import failed."""
