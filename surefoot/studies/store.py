"""Finished runs of a study on the disk, and what makes them those of this code.

A finished run may stand for a new one as long as all three are the same. Code is what
one simulated run imports, however deep: plant, controller, settings and the figures.
The command line, pages, recorders and the bus are not among it, so a change of theirs
throws no study away; nor does a comment or a docstring.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
import platform
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, BinaryIO, Self

import msgspec

from surefoot.errors import UsageError
from surefoot.out_folder import (
    FolderLock,
    make_out_folder,
    not_there,
    take_away,
    write_json,
)
from surefoot.run_plan import RunPlan
from surefoot.schemas.scenario import with_recordings
from surefoot.schemas.toml_file import atomic_file
from surefoot.sim_robot.catalogue import naming_scenario
from surefoot.sim_robot.recorded import recorded_ground, recorded_track
from surefoot.stabilizer.factory import CONTROLLERS, find_target
from surefoot.studies.cell import Row, Task

ROOT = "surefoot.simulation"
"""The module that runs one plan."""
_ELSEWHERE = tuple(
    f"surefoot.{name}"
    for name in (
        *("robot_io.bus", "robot_io.client_side", "robot_io.security"),
        *("robot_io.relay", "robot_io.ticks", "signals", "out_folder", "run_folder"),
    )
)
"""Imported on the way, but never asked for a figure: bus, files and records."""
PACKAGES = ("mujoco", "pin", "piqp", "numpy")
"""What else computes."""
_FOLDER = Path(__file__).resolve().parents[2]
STUDY, RUNS = "study.json", "runs.jsonl"


def about_code() -> dict[str, str]:
    """Return digest of the code and versions of what it computes with, by name."""
    packages = {name: version(name) for name in PACKAGES}
    python = ".".join(platform.python_version_tuple()[:2])
    return {"code": code_fingerprint(), "python": python, **packages}


@cache
def code_fingerprint(root: str = ROOT) -> str:
    """Return the SHA-256 of the code that a run, or a module, depends on."""
    digest = hashlib.sha256()
    for name, tree in sorted(code_of_a_run(root).items()):
        digest.update(f"{name}\n{ast.dump(_without_docstrings(tree))}\n".encode())
    return digest.hexdigest()


def code_of_a_run(root: str = ROOT) -> dict[str, ast.Module]:
    """Return the modules that a run imports, from whatever depth, by name."""
    found: dict[str, ast.Module] = {}
    waiting = [root]
    while waiting:
        name = waiting.pop()
        path = None if name in found or _is_elsewhere(name) else _file_of(name)
        if path is not None:
            found[name] = ast.parse(path.read_bytes())
            waiting += _imports(found[name])
    return found


def _is_elsewhere(name: str) -> bool:
    ours = name.startswith("surefoot.")
    return not ours or any(f"{name}.".startswith(f"{room}.") for room in _ELSEWHERE)


def _file_of(name: str) -> Path | None:
    """Find the source of a module; None for a name inside one."""
    path = _FOLDER.joinpath(*name.split("."))
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file.is_file():
            return file
    return None


def _imports(tree: ast.Module) -> Iterator[str]:
    """Names that may be modules; those for the type checker alone are left out."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        waiting += ast.iter_child_nodes(node)


def _without_docstrings(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [part for part in body if not _is_text(part)]  # type: ignore[attr-defined]
    return tree


def _is_text(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def inputs_fingerprint(plan: RunPlan) -> str:
    """Return the SHA-256 of what a plan puts into a run, besides the seed.

    It is that of contents, wherever the files lie: scenario and recorded motions, robot
    file and URDF, settings, and the source of a controller from outside.

    Raises:
        ScenarioError: a recording cannot be read, or is no motion.
    """
    with naming_scenario(plan.scenario_path or Path(plan.scenario.name)):
        recorded_ground(plan.scenario)
    digest = hashlib.sha256()
    scenario = with_recordings(
        plan.scenario, lambda motion: recorded_track(motion).sha256
    )
    for part in (scenario, plan.settings, plan.robot.file):
        digest.update(msgspec.json.encode(part))
    digest.update(plan.robot.urdf_path.read_bytes())
    digest.update(plan.controller.rpartition(":")[2].encode())
    if plan.controller not in CONTROLLERS:
        source = inspect.getsourcefile(find_target(plan.controller))
        digest.update(b"" if source is None else Path(source).read_bytes())
    return digest.hexdigest()


class StudyStore:
    """A folder of finished runs, one JSON line each.

    A run is written when it is done and never changed; a line that was cut off when
    the process was killed is left out, and that run is done again.

    Attributes:
        rows: finished runs by key.
    """

    def __init__(self, folder: Path, *, about: dict[str, Any]) -> None:
        """Look at a former study, or name a new one; :meth:`begin` writes.

        Args:
            folder: where it is, or will be.
            about: what all runs share, such as overrides; code and packages are
                added.

        Raises:
            UsageError: the folder holds runs of other code or settings, or something
                else altogether.
        """
        self.rows: dict[str, Row] = {}
        self._folder = folder
        self._path = folder / RUNS
        self._file: BinaryIO | None = None
        self._lock: FolderLock | None = None
        self._made: list[Path] = []
        about = {**about, **about_code()}
        self.about = about
        marker = folder / STUDY
        if marker.is_file():
            self._compare(_read_marker(marker), folder)
        elif folder.is_dir() and any(folder.iterdir()):
            raise UsageError(f"{folder}: not empty and no study; name another folder")
        self.rows = {row["key"]: row for row in read_rows(folder)}

    def __enter__(self) -> Self:
        """Give itself."""
        return self

    def begin(self) -> None:
        """Make the folder, and open the file of runs without a line that was cut off.

        Raises:
            UsageError: something on the way to the folder is a file, or another
                command is writing there.
            EnvironmentFailedError: nothing can be written there.
        """
        if self._file is not None:
            return
        files = self._path, self._folder / STUDY
        self._made = [path for file in files for path in not_there(file)]
        make_out_folder(self._folder, out=self._folder)
        self._lock = FolderLock(self._folder)
        # Another command may have done some of them since this one looked.
        self.rows = {row["key"]: row for row in read_rows(self._folder)}
        write_json(self._folder / STUDY, self.about)
        with atomic_file(self._path) as file:
            for row in self.rows.values():
                file.write(msgspec.json.encode(row) + b"\n")
        self._file = self._path.open("ab")

    def __exit__(self, error: object, *more: object) -> None:
        """Close the file, and let others write there.

        After an error a study that has no run yet is as if it had not been begun.
        """
        if self._file is not None:
            self._file.close()
        if error is not None and not self.rows:
            take_away(self._made)
        if self._lock is not None:
            self._lock.release()

    def add(self, row: Row) -> None:
        """Keep a finished run."""
        self.begin()
        assert self._file is not None
        self._file.write(msgspec.json.encode(row) + b"\n")
        self._file.flush()
        self.rows[row["key"]] = row

    def check(self, task: Task) -> None:
        """See that a kept run of a cell, if there is one, is the run that is meant.

        Args:
            task: what is to be run, with scenario, robot and settings as they are.

        Raises:
            UsageError: it was made with others of the same name.
        """
        row = self.rows.get(task.cell.key)
        if row is not None and row["inputs"] != task.inputs:
            raise UsageError(
                f"{self._path}: holds a run of {task.cell.case} from before its "
                "scenario, robot or settings were changed; runs of both would be "
                "mixed. Name another folder, or remove this one"
            )

    def _compare(self, former: dict[str, Any], folder: Path) -> None:
        differing = [
            name
            for name in {**self.about, **former}
            if self.about.get(name) != former.get(name)
        ]
        if differing:
            raise UsageError(
                f"{folder}: holds runs of another study (differing: "
                f"{', '.join(sorted(differing))}); runs of both would be mixed. Name "
                "another folder, or remove this one"
            )


def _read_marker(path: Path) -> dict[str, Any]:
    try:
        return msgspec.json.decode(path.read_bytes(), type=dict[str, Any])
    except msgspec.DecodeError as error:
        raise UsageError(
            f"{path}: does not say what study the folder holds ({error}); name another "
            "folder, or put back this file"
        ) from error


def read_rows(folder: Path) -> Iterable[Row]:
    """Read the finished runs of a folder, without a last line that was cut off.

    Raises:
        UsageError: another line is none of ours.
    """
    path = folder / RUNS
    if not path.is_file():
        return
    lines = path.read_bytes().splitlines(keepends=True)
    for number, line in enumerate(lines, start=1):
        try:
            row = msgspec.json.decode(line, type=Row)
            has_key = isinstance(row.get("key"), str)
        except msgspec.DecodeError:
            has_key = False
        if has_key:
            yield row
        elif number < len(lines) or line.endswith(b"\n"):
            raise UsageError(
                f"{path}, line {number}: is no finished run of a study; take the line "
                "out to have that run made again, or name another folder"
            )
