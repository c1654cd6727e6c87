"""What a record keeps beside the messages: the robot's files, versions, code."""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

import msgspec

from surefoot.errors import UsageError
from surefoot.robot_io.robot import EXTENDS, Robot
from surefoot.schemas.toml_file import read_toml

ROBOT_TOML, ROBOT_BELOW, ROBOT_JSON = "robot.toml", "robot-below.toml", "robot.json"
ROBOT_URDF, VERSIONS = "robot.urdf", "versions.json"
_PACKAGES = ("surefoot", "eclipse-zenoh", "mujoco", "pin", "piqp", "numpy", "msgpack")
_GIT_S = 5.0
_MEDIA = {
    ".toml": "application/toml",
    ".json": "application/json",
    ".urdf": "application/xml",
}


class Attachment(NamedTuple):
    """A file that goes into the record."""

    name: str
    media_type: str
    data: bytes


def attachments(robot: Robot, files: Iterable[Path]) -> list[Attachment]:
    """Collect the robot's files, versions, git state, and files named by the user.

    ``robot.toml`` is the robot file as it stands, ``robot-below.toml`` the one it
    extends if any, ``robot.json`` both together with the servo profile in use.

    Raises:
        UsageError: a named file cannot be read, or bears the name of another.
    """
    found = [
        _attachment(ROBOT_TOML, robot.path.read_bytes()),
        _attachment(ROBOT_JSON, msgspec.json.encode(robot.file)),
        _attachment(ROBOT_URDF, robot.urdf_path.read_bytes()),
        _attachment(VERSIONS, msgspec.json.encode(versions())),
    ]
    below = read_toml(robot.path).get(EXTENDS)
    if below is not None:
        data = (robot.path.parent / str(below)).read_bytes()
        found.append(_attachment(ROBOT_BELOW, data))
    for path in files:
        if path.name in {entry.name for entry in found}:
            raise UsageError(f"--attach {path}: the record has a {path.name} already")
        try:
            found.append(_attachment(path.name, path.read_bytes()))
        except OSError as error:
            raise UsageError(f"--attach {path}: {error.strerror}") from error
    return found


def _attachment(name: str, data: bytes) -> Attachment:
    media = _MEDIA.get(Path(name).suffix, "application/octet-stream")
    return Attachment(name, media, data)


class Versions(msgspec.Struct, kw_only=True):
    """What a record was made with."""

    python: str | None = None
    platform: str | None = None
    packages: dict[str, str | None] = {}
    git_commit: str | None = None
    git_changed_files: list[str] = []


def versions() -> Versions:
    """What runs here: packages, Python, commit and changed files of our own code."""
    return Versions(
        python=platform.python_version(),
        platform=platform.platform(),
        packages={name: _version(name) for name in _PACKAGES},
        git_commit=_git("rev-parse", "HEAD"),
        git_changed_files=(_git("status", "--porcelain") or "").splitlines(),
    )


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _git(*words: str) -> str | None:
    """What git says of our own code; None where it is installed without git."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return None
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *words],
            capture_output=True,
            text=True,
            timeout=_GIT_S,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
