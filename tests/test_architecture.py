"""The structure of the code is that of docs/architecture.md.

Import-linter checks layers and libraries (``make lint``). The tests here check that
there is no import cycle, not even of types, that each module has one name, that
packages stay small, and that only one name is installed.
"""

from __future__ import annotations

import ast
import os
import re
import tomllib
from collections.abc import Iterator
from fnmatch import fnmatch
from graphlib import CycleError, TopologicalSorter
from importlib.metadata import distributions, metadata
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[1]
LIBRARY = "surefoot"
LINKED = ("schemas", "robot_io", "stabilizer", "sim_robot", "cli")
"""Folders at the root that are linked into the library's folder."""
MOST_MODULES = 217
MOST_CLI_LINES = 6000
MOST_ROBOT_IO_ENTRIES = 20
"""Modules and folders at the top of robot_io, which should fit on a screen."""


def module_files(package: Path) -> dict[str, Path]:
    """Return the file of each module by name, including folders behind links."""
    found = {}
    for folder, _, names in os.walk(package, followlinks=True):
        for name in names:
            if name.endswith(".py"):
                path = Path(folder, name)
                parts = path.relative_to(package.parent).with_suffix("").parts
                dotted = parts[:-1] if parts[-1] == "__init__" else parts
                found[".".join(dotted)] = path
    return found


MODULES = module_files(ROOT / LIBRARY)


def imported(node: ast.Import | ast.ImportFrom) -> Iterator[str]:
    """Yield the names that an import may bind: modules, or names in modules."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif node.module is not None:
        for alias in node.names:
            yield f"{node.module}.{alias.name}"


def needs(text: str) -> set[str]:
    """Return the library's modules that a module imports, be it late or for types."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            for name in imported(node):
                parent = name.rpartition(".")[0]
                found |= {part for part in (name, parent) if part in MODULES}
    return found - {LIBRARY}


def order(graph: dict[str, set[str]]) -> list[str]:
    """Return the modules such that each comes after those it needs.

    Raises:
        CycleError: there is no such order; its second argument is the cycle.
    """
    return list(TopologicalSorter(graph).static_order())


def test_no_module_needs_itself() -> None:
    graph = {
        name: needs(path.read_text(encoding="utf-8")) - {name}
        for name, path in MODULES.items()
    }
    assert sum(map(len, graph.values())) > 500
    try:
        assert len(order(graph)) == len(MODULES)
    except CycleError as error:
        pytest.fail(f"import circle: {' -> '.join(error.args[1])}")


def test_a_circle_is_found() -> None:
    one, two = "surefoot.schemas.arrays", "surefoot.schemas.codec"
    circle = {
        one: needs(f"from {two} import encode"),
        two: needs("from surefoot.schemas import arrays"),
    }
    with pytest.raises(CycleError):
        order(circle)
    for text in (
        f"def f():\n    import {two}",
        f"if TYPE_CHECKING:\n    import {two}",
        f"try:\n    import {two}\nexcept ImportError:\n    pass",
    ):
        assert two in needs(text)


def test_links_lead_to_the_folders_of_the_root() -> None:
    links = {path.name for path in (ROOT / LIBRARY).iterdir() if path.is_symlink()}
    assert links == set(LINKED)
    for name in LINKED:
        assert (ROOT / LIBRARY / name).samefile(ROOT / name)
        assert f"{LIBRARY}.{name}" in MODULES


def test_nothing_is_imported_by_a_second_name() -> None:
    """``schemas.messages`` beside ``surefoot.schemas.messages``: two of each class."""
    own = [path for name in LINKED for path in (ROOT / name).rglob("*.py")]
    for folder in (LIBRARY, "tests", "benchmarks", "docs", "deploy", "examples"):
        own += (ROOT / folder).rglob("*.py")
    assert len(own) > 300
    for path in own:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import | ast.ImportFrom):
                tops = {name.partition(".")[0] for name in imported(node)}
                assert not tops & set(LINKED), f"{path}, line {node.lineno}"


def test_only_surefoot_lands_in_site_packages() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    find = project["tool"]["setuptools"]["packages"]["find"]
    assert find.get("namespaces") is False
    packages = {
        ".".join(Path(folder).relative_to(ROOT).parts)
        for top in (*LINKED, LIBRARY, "tests", "benchmarks", "docs", "examples")
        for folder, _, names in os.walk(ROOT / top, followlinks=True)
        if "__init__.py" in names
    }
    installed = {
        name
        for name in packages
        if any(fnmatch(name, pattern) for pattern in find["include"])
    }
    assert {name.partition(".")[0] for name in installed} == {LIBRARY}
    # A folder without __init__.py would be left out of the wheel.
    homes = {
        name if path.name == "__init__.py" else name.rpartition(".")[0]
        for name, path in MODULES.items()
    }
    assert homes <= installed
    assert (ROOT / LIBRARY / "py.typed").is_file()


def test_every_pin_can_be_installed_by_the_oldest_python() -> None:
    """Pip calls a pin that asks for a newer one a conflict, and installs nothing."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    oldest = project["project"]["requires-python"].removeprefix(">=") + ".0"
    text = (ROOT / "constraints.txt").read_text(encoding="utf-8")
    pins = dict(re.findall(r"^(\S+)==(\S+)$", text, re.MULTILINE))
    asks = {
        name: metadata(name).get_all("Requires-Python", [""])[0]
        for name, pinned in pins.items()
        if {d.version for d in distributions(name=name)} == {pinned}
    }
    assert len(asks) > len(pins) // 2  # those of ROS 2 are in an environment of theirs
    assert not [n for n, asked in asks.items() if oldest not in SpecifierSet(asked)]


def test_rooms_stay_within_bounds() -> None:
    modules = [path for path in MODULES.values() if path.name != "__init__.py"]
    assert len(modules) < MOST_MODULES
    cli = (ROOT / "cli").rglob("*.py")
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in cli)
    assert lines < MOST_CLI_LINES
    floor = [
        path.name
        for path in (ROOT / "robot_io").iterdir()
        if re.fullmatch(r"[a-z]\w*(\.py)?", path.name)
    ]
    assert len(floor) <= MOST_ROBOT_IO_ENTRIES
