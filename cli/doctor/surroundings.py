"""What a run needs around it: bus, port, disk, pictures, browser."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

from surefoot.cli.doctor.examine import Diagnosis, Severity, finding
from surefoot.endpoints import loopback_endpoints
from surefoot.processes.child import child_environment
from surefoot.recording.write import KEPT_FREE_BYTES
from surefoot.robot_io.errors import RobotIoError
from surefoot.schemas.endpoints import DEFAULT_LOCATOR

RECORD_BYTES_PER_S = 1.8e6
"""What a record of a run takes, measured on shipped scenarios."""
WANTED_S = 600.0
GL_TIMEOUT_S = 60.0
SLOW_ROUND_TRIP_MS = 2.0
_GL_BACKENDS = ("egl", "osmesa")
_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")


def check_bus() -> Diagnosis:
    """Check that Zenoh works on loopback, and how quickly."""
    from surefoot.robot_io.bus.loopback import measure_loopback

    name = "Zenoh on loopback"
    try:
        median, p99 = measure_loopback(loopback_endpoints())
    except (RobotIoError, OSError) as error:
        return Diagnosis(
            name=name,
            verdict=Severity.FAIL,
            got=str(error),
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
    try:
        socket.create_server((host, int(port))).close()
    except OSError as error:
        return Diagnosis(
            name="port",
            verdict=Severity.WARN,
            got=f"{host}:{port}: {error.strerror or error}",
            advice="well if that is your robot (surefoot topics tells); otherwise stop "
            "who listens there, or use --listen and --connect with another port. "
            "surefoot run takes a free one by itself",
        )
    return Diagnosis(name="port", verdict=Severity.OK, got=f"{host}:{port} is free")


def check_disk() -> list[Diagnosis]:
    """Check the room for records in this folder, and for temporary files."""
    return [_room(Path.cwd()), _temporary_folder()]


def check_pictures() -> Diagnosis:
    """Check that MuJoCo draws without a window."""
    asked = os.environ.get("MUJOCO_GL")
    works = [name for name in ((asked,) if asked else _GL_BACKENDS) if _draws(name)]
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
    try:
        with tempfile.TemporaryFile() as file:
            file.write(b"surefoot")
            file.flush()
    except OSError as error:
        return Diagnosis(
            name="temporary files",
            verdict=Severity.FAIL,
            got=str(error),
            advice="set TMPDIR to a folder that can be written to and has room",
        )
    return Diagnosis(
        name="temporary files", verdict=Severity.OK, got=f"in {tempfile.gettempdir()}"
    )


def _draws(backend: str) -> bool:
    """Draw in a process of its own: OpenGL may end the process it fails in."""
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", "surefoot.sim_robot.render"],
            env={**child_environment(), "MUJOCO_GL": backend},
            capture_output=True,
            timeout=GL_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0
