"""What is installed, how surefoot was, and which modules are the user's own.

Error messages, ``surefoot doctor``, the files of runs and studies use it.
"""

from __future__ import annotations

import ast
import json
import os
import platform
import re
import shlex
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from contextlib import suppress
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import (
    Distribution,
    PackageNotFoundError,
    distribution,
    version,
)
from importlib.util import find_spec, resolve_name, spec_from_file_location
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

_NAME = "surefoot"
_PACKAGES = (
    *("surefoot", "eclipse-zenoh", "mujoco", "pin", "piqp", "numpy"),
    *("msgpack", "msgspec"),
)
_SHARED = ("site-packages", "dist-packages")
_PYTHON = Path(sysconfig.get_path("stdlib")).resolve()
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


def own_sources(place: str, modules: Iterable[str] = ()) -> Iterator[bytes]:
    """Yield the source of a module, then of all modules of the user that it imports.

    Left out are Python's own, surefoot's and those of installed packages, apart from
    the module's own package. Imports are read from the sources, and nothing is
    imported: what else is loaded does not count.

    Args:
        place: name of the module, or path of its file.
        modules: further modules that it needs.
    """
    found: dict[Path, str] = {}
    seen: set[str] = set()
    waiting = [*modules, place]
    while waiting:
        name = waiting.pop()
        spec = None if name in seen else _spec(name)
        seen.add(name)
        if spec is None or not spec.has_location:
            continue
        path = Path(str(spec.origin)).resolve()
        if path not in found and (name == place or _is_own(name, path, place)):
            found[path] = name
            waiting.append(spec.name.rpartition(".")[0])
            with suppress(SyntaxError, ValueError):  # compiled, or not for this Python
                waiting += imported_names(ast.parse(path.read_bytes()), spec.parent)
    for path, name in sorted(found.items(), key=lambda it: (it[1] != place, it[1])):
        yield (b"" if name == place else f"\n{name}\n".encode()) + path.read_bytes()


def _is_own(name: str, path: Path, place: str) -> bool:
    package = name.partition(".")[0]
    if package == _NAME:
        return False
    is_shared = path.is_relative_to(_PYTHON) or not {*_SHARED}.isdisjoint(path.parts)
    return package == place.partition(".")[0] or not is_shared


def _spec(name: str) -> ModuleSpec | None:
    """Find a module or a file without importing it; None if there is none."""
    if name == "__main__":
        name = str(getattr(sys.modules[name], "__file__", ""))
    if name.endswith(".py"):
        return spec_from_file_location("", Path(name).resolve())
    above, dot, _ = name.rpartition(".")
    try:
        if not dot:
            return find_spec(name)
        package = _spec(above)
    except (ImportError, ValueError):
        return None
    rooms = None if package is None else package.submodule_search_locations
    return None if rooms is None else PathFinder.find_spec(name, rooms)


def imported_names(tree: ast.Module, package: str | None = None) -> Iterator[str]:
    """Yield imported names that may be modules, without those for the type checker.

    Args:
        tree: source of a module.
        package: the module's package, for its relative imports.
    """
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            waiting += node.orelse
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        if isinstance(node, ast.ImportFrom):
            with suppress(ImportError):  # relative, and above the package
                base = resolve_name("." * node.level + (node.module or ""), package)
                yield from (base, *(f"{base}.{alias.name}" for alias in node.names))
        waiting += ast.iter_child_nodes(node)
