"""What ``surefoot doctor`` tries: a machine's surroundings, and its speed."""

from __future__ import annotations

import os
import resource
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

from surefoot.cli.doctor_report import Diagnosis, Severity, finding
from surefoot.processes.child import child_environment
from surefoot.recording.write import KEPT_FREE_BYTES
from surefoot.robot_io.bus.bus import loopback_endpoints
from surefoot.robot_io.errors import RobotIoError
from surefoot.schemas.endpoints import DEFAULT_LOCATOR

RECORD_BYTES_PER_S = 1.8e6
"""What a record of a run takes, measured on shipped scenarios."""
WANTED_S = 600.0
GL_TIMEOUT_S = 60.0
SLOW_ROUND_TRIP_MS = 2.0
_GL_BACKENDS = ("egl", "osmesa")
_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")
ENOUGH_CPUS = 2
JITTER_TICKS = 500
TICK_S = 1e-3
MS_PER_S = 1e3
GOOD_JITTER_S = 0.5e-3
"""Wake-up delay that a control period of 1 ms tolerates [s]."""
RT_PRIORITY = 50


def check_bus() -> Diagnosis:
    """Check that Zenoh works on loopback, and how quickly."""
    from surefoot.robot_io.bus.bus import measure_loopback

    name = "Zenoh on loopback"
    try:
        median, p99 = measure_loopback(loopback_endpoints())
    except (RobotIoError, OSError) as error:
        return finding(
            name,
            str(error),
            bad=Severity.FAIL,
            advice="loopback must be up (ip addr show lo), and no firewall may drop "
            "TCP on 127.0.0.1",
        )
    return finding(
        name,
        f"round trip median {median:.2f} ms, p99 {p99:.2f} ms",
        bad=Severity.WARN if median > SLOW_ROUND_TRIP_MS else None,
        advice="this machine is busy; lockstep runs will be slow, real-time ones late",
    )


def check_port() -> Diagnosis:
    """Check that the port where the robot listens by default is free."""
    host, port = DEFAULT_LOCATOR.removeprefix("tcp/").split(":")
    busy = ""
    try:
        socket.create_server((host, int(port))).close()
    except OSError as error:
        busy = error.strerror or str(error)
    return finding(
        "port",
        f"{host}:{port}: {busy}" if busy else f"{host}:{port} is free",
        bad=Severity.WARN if busy else None,
        advice="well if that is your robot (surefoot topics tells); otherwise stop who "
        "listens there, or use --listen and --connect with another port. surefoot run "
        "takes a free one by itself",
    )


def check_disk() -> list[Diagnosis]:
    """Check the room for records in this folder, and for temporary files."""
    return [_room(Path.cwd()), _temporary_folder()]


def check_pictures() -> Diagnosis:
    """Check that MuJoCo draws without a window."""
    asked = os.environ.get("MUJOCO_GL")
    works = [name for name in ((asked,) if asked else _GL_BACKENDS) if _draws(name)]
    if asked and not works and not _loads():
        return finding(
            "pictures (OpenGL)",
            f"MuJoCo does not load with MUJOCO_GL={asked}",
            bad=Severity.FAIL,
            advice="no run starts: leave MUJOCO_GL unset, or write egl or osmesa",
        )
    return finding(
        "pictures (OpenGL)",
        f"works with MUJOCO_GL={works[0]}"
        if works
        else f"nothing draws ({asked or ', '.join(_GL_BACKENDS)} tried)",
        bad=None if works else Severity.WARN,
        advice="only for pictures and video: on Debian and Ubuntu apt-get install "
        "libegl1 libgl1-mesa-dri (or libosmesa6), and leave MUJOCO_GL unset or egl",
    )


def check_browser() -> Diagnosis:
    """Check that there is a browser for the live page and reports."""
    found = [path for path in map(shutil.which, _BROWSERS) if path]
    if not found and sys.platform == "darwin":
        found = ["the system's own"]
    return finding(
        "browser",
        found[0] if found else "none found",
        bad=None if found else Severity.WARN,
        advice="only for looking at pages on this machine; reports can be copied, the "
        "live page reached through ssh -L 8080:127.0.0.1:8080",
    )


def _room(folder: Path) -> Diagnosis:
    free = shutil.disk_usage(folder).free
    recordable_s = max(0.0, free - KEPT_FREE_BYTES) / RECORD_BYTES_PER_S
    return finding(
        "disk",
        f"{free / 2**30:.1f} GiB free in {folder}: records of "
        f"{recordable_s / 60.0:.0f} min",
        bad=Severity.WARN if recordable_s < WANTED_S else None,
        advice="make room, or give --out a folder on another disk",
    )


def _temporary_folder() -> Diagnosis:
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
        bad=Severity.FAIL if fault else None,
        advice="set TMPDIR to a folder that can be written to and has room",
    )


def _draws(backend: str) -> bool:
    """Draw in a process of its own: OpenGL may end the process it fails in."""
    return _works("-m", "surefoot.sim_robot.render", MUJOCO_GL=backend)


def _loads() -> bool:
    """Whether the simulation can be loaded, be it never to draw."""
    return _works("-c", "import surefoot.sim_robot.plant")


def _works(*words: str, **variables: str) -> bool:
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
        return finding(
            "real-time priority",
            "this system has none to give",
            bad=Severity.WARN,
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
