"""How surefoot was installed, and the pip command that adds missing packages.

Error messages, ``surefoot doctor`` and the files of runs use it.
"""

from __future__ import annotations

import json
import os
import platform
import re
import shlex
import sys
from importlib.metadata import (
    Distribution,
    PackageNotFoundError,
    distribution,
    version,
)
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

_NAME = "surefoot"
_PACKAGES = (
    *("surefoot", "eclipse-zenoh", "mujoco", "pin", "piqp", "numpy"),
    *("msgpack", "msgspec"),
)
_ROOT = Path(__file__).resolve().parent.parent


def install_command(extra: str = "") -> str:
    """Return the pip command that fits how surefoot was installed.

    A checkout is installed again in the same way. A package from elsewhere may be on
    no index: it is left alone, and the extra's requirements are installed by name.

    Args:
        extra: name of an optional part; empty for the requirements of every run.
    """
    try:
        package = distribution(_NAME)
    except PackageNotFoundError:
        package = None
    if (_ROOT / "pyproject.toml").is_file():
        return _pip("-e", _with(_shown(_ROOT), extra))
    source = None if package is None else _source(package)
    if source is not None:
        return _pip(_with(source, extra))
    needed = [] if package is None else _needed(package, extra)
    return _pip(*needed) if needed else _pip(_with(_NAME, extra))


def lacking(what: str, *packages: str, extra: str) -> str:
    """Return that something needs packages that are missing; empty if none is.

    Args:
        what: needs them, in words.
        packages: their names for imports.
        extra: the optional part that brings them.
    """
    missing = [name for name in packages if find_spec(name) is None]
    if not missing:
        return ""
    names = " and ".join(missing)
    return f"{what} needs {names}, not installed here; {install_command(extra)}"


def installed_version(package: str) -> str | None:
    """Return the version of a package; None if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def this_machine() -> dict[str, Any]:
    """Return Python, platform and the packages that a run depends on, by name."""
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": {name: installed_version(name) for name in _PACKAGES},
    }


def _source(package: Distribution) -> str | None:
    """Folder, file or repository the package came from; None if that is gone."""
    text = package.read_text("direct_url.json")
    if text is None:
        return None
    told = json.loads(text)
    url = str(told.get("url", ""))
    if "vcs_info" in told:
        vcs = told["vcs_info"]
        return f"{_NAME} @ {vcs['vcs']}+{url}@{vcs['commit_id']}"
    path = Path(unquote(urlparse(url).path))
    is_there = url.startswith("file:") and path.exists()
    return _shown(path) if is_there else None


def _needed(package: Distribution, extra: str) -> list[str]:
    """Requirements of a part of the package, by name and version."""
    needed = []
    for line in package.requires or []:
        requirement, _, marker = line.partition(";")
        of = re.search(r"extra\s*==\s*['\"]([^'\"]+)", marker)
        if (of[1] if of else "") == extra:
            needed.append(requirement.strip())
    return needed


def _with(source: str, extra: str) -> str:
    if not extra:
        return source
    name, at, url = source.partition(" @ ")
    return f"{name}[{extra}]{at}{url}"


def _shown(path: Path) -> str:
    """The shortest form of a path from here; it never looks like a package name."""
    near = os.path.relpath(path)
    if near.startswith(".."):
        return str(path)
    return near if near == "." else f".{os.sep}{near}"


def _pip(*words: str) -> str:
    """The pip command of this Python, not of the first one on the path."""
    python = sys.executable or "python3"
    near = os.path.relpath(python)
    program = python if near.startswith("..") else near
    return shlex.join([program, "-m", "pip", "install", *words])
