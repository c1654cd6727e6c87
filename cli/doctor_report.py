"""What ``surefoot doctor`` looks at, line by line: packages, the machine, its speed.

What a check needs is imported in it: without a package the others still tell.
"""

from __future__ import annotations

import os
import platform
import re
import resource
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from enum import StrEnum
from importlib.metadata import requires
from importlib.util import find_spec
from pathlib import Path

import msgspec

from surefoot.installation import install_command, installed_version

LEAST_PYTHON = (3, 11)
_EXTRAS = {
    "view": ("viser", "yourdfpy", "plotly"),
    "parquet": ("pyarrow",),
    "tune": ("optuna",),
    "cluster": ("distributed",),
}
"""Packages of each optional part."""
PINS = Path(__file__).resolve().parents[1] / "constraints.txt"
_NAME = re.compile(r"[A-Za-z0-9._-]+")
_EXTRA = re.compile(r"extra\s*==")
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
GOOD_JITTER_MS = 0.5
"""Wake-up delay that a control period of 1 ms tolerates."""
RT_PRIORITY = 50


class Severity(StrEnum):
    """How much a finding matters."""

    OK = "ok"
    WARN = "warn"
    """Something works less well, or an option is not there."""
    FAIL = "FAIL"
    """A run would stop here."""


class Diagnosis(msgspec.Struct, frozen=True, kw_only=True):
    """What was looked at, what was found, and what to do about it."""

    name: str
    verdict: Severity
    got: str
    advice: str = ""
    """What to do; empty when there is nothing to do."""


def finding(
    name: str, got: str, *, bad: Severity | None = None, advice: str = ""
) -> Diagnosis:
    """Make a finding that has advice only if something is bad."""
    if bad is None:
        return Diagnosis(name=name, verdict=Severity.OK, got=got)
    return Diagnosis(name=name, verdict=bad, got=got, advice=advice)


def examine() -> Iterator[Diagnosis]:
    """Look at everything; a check that cannot be done is a finding of its own."""
    for name, check in (
        ("packages", _packages),
        ("linear algebra", _computing),
        ("bus, disk, pictures", _surroundings),
        ("margins", _robots),
    ):
        yield from _try(name, check)


def _packages() -> Iterator[Diagnosis]:
    yield check_python()
    yield from check_packages()
    yield from check_extras()


def _computing() -> Iterator[Diagnosis]:
    yield check_msgpack()
    yield check_processors()
    yield check_clock()
    yield check_priority()
    yield check_blas()


def _surroundings() -> Iterator[Diagnosis]:
    yield check_bus()
    yield check_port()
    yield from check_disk()
    yield check_pictures()
    yield check_browser()


def _robots() -> Iterator[Diagnosis]:
    """Check the margins of every shipped robot with every servo profile."""
    from surefoot.controllers import compute_margins
    from surefoot.robot_io.robot import list_robots, load_robot

    for name in list_robots():
        for profile in load_robot(name).file.servo.profiles:
            found = compute_margins(name, servo_profile=profile)
            yield finding(
                f"margins of {name}, {profile}",
                "; ".join(found.in_words()),
                bad=None if found.is_enough else Severity.WARN,
                advice="as it was made, and no fault of this machine; surefoot "
                "margins tells more",
            )


def _try(name: str, check: Callable[[], Iterator[Diagnosis]]) -> Iterator[Diagnosis]:
    from surefoot.cli.console import import_advice

    try:
        yield from check()
    except ImportError as error:
        advice = import_advice(error)
        yield finding(name, str(error), bad=Severity.FAIL, advice=advice)


def check_python() -> Diagnosis:
    """Check that Python is new enough."""
    wanted = ".".join(map(str, LEAST_PYTHON))
    is_old = sys.version_info < LEAST_PYTHON
    return finding(
        "Python",
        f"{platform.python_version()} on {platform.platform(terse=True)}",
        bad=Severity.FAIL if is_old else None,
        advice=f"install Python {wanted} or newer",
    )


def check_packages() -> list[Diagnosis]:
    """Check packages: one line for all good ones, and one for each other."""
    names = required_packages()
    pins = read_pins(PINS)
    found, others = [], []
    for name in names:
        got = installed_version(name)
        pin = pins.get(_normal(name), got)
        if got == pin and got is not None:
            found.append(f"{name} {got}")
            continue
        others.append(
            finding(
                f"package {name}",
                f"{got}, tested with {pin}" if got else "not installed",
                bad=Severity.WARN if got else Severity.FAIL,
                advice=f"pip install {name}=={pin}" if got else install_command(),
            )
        )
    against = "as tested" if pins else "no constraints.txt to compare with"
    told = f"surefoot {installed_version('surefoot')}, {', '.join(found)}; {against}"
    return [finding("packages", told), *others]


def check_extras() -> list[Diagnosis]:
    """Check the optional parts; each missing one comes with how to get it."""
    findings = []
    for extra, packages in _EXTRAS.items():
        missing = [name for name in packages if installed_version(name) is None]
        there = [f"{name} {installed_version(name)}" for name in packages]
        findings.append(
            finding(
                f"extra {extra}",
                f"no {', '.join(missing)}" if missing else ", ".join(there),
                bad=Severity.WARN if missing else None,
                advice=f"only if you want it: {install_command(extra)}",
            )
        )
    return findings


def required_packages() -> list[str]:
    """Return the packages that surefoot always needs, from its metadata."""
    wanted = requires("surefoot") or []
    matches = (_NAME.match(line) for line in wanted if not _EXTRA.search(line))
    return [match.group() for match in matches if match]


def read_pins(path: Path) -> dict[str, str]:
    """Read the versions of a constraints file by normalised name; empty without one."""
    if not path.is_file():
        return {}
    lines = (line.strip() for line in path.read_text(encoding="utf-8").splitlines())
    pairs = (line.split("==", 1) for line in lines if "==" in line and line[0] != "#")
    return {_normal(name): pin for name, pin in pairs}


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def check_bus() -> Diagnosis:
    """Check that Zenoh works on loopback, and how quickly."""
    from surefoot.robot_io.bus.bus import loopback_endpoints, measure_loopback
    from surefoot.robot_io.errors import RobotIoError

    name = "Zenoh on loopback"
    try:
        times = measure_loopback(loopback_endpoints())
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
        f"round trip median {times.median:.2f} ms, p99 {times.p99:.2f} ms",
        bad=Severity.WARN if times.median > SLOW_ROUND_TRIP_MS else None,
        advice="this machine is busy; lockstep runs will be slow, real-time ones late",
    )


def check_port() -> Diagnosis:
    """Check that the port where the robot listens by default is free."""
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
    from surefoot.recording.write import KEPT_FREE_BYTES

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
    from surefoot.robot_io.realtime import distribution_of

    late = []
    due = time.monotonic()
    for _ in range(JITTER_TICKS):
        due += TICK_S
        time.sleep(max(0.0, due - time.monotonic()))  # how late it ends is the finding
        late.append(time.monotonic() - due)
        due = max(due, time.monotonic() - TICK_S)
    times = distribution_of([MS_PER_S * late_s for late_s in late])
    return finding(
        "clock",
        f"1 ms sleeps end late by {times.median:.2f} ms (median), "
        f"{times.p99:.2f} (p99), {times.max:.2f} (max)",
        bad=Severity.WARN if times.p99 > GOOD_JITTER_MS else None,
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
