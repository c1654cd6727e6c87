"""Finished runs of a study on disk, with fingerprints of code, packages and inputs.

A finished run replaces a new one as long as all three are the same. Code means all
modules that a simulated run imports, directly or not: plant, controller, settings and
figures. Command line, pages, recorders and bus are left out: a change there keeps all
studies valid, and so does a change of comments or docstrings.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
import platform
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import entry_points, version
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, Self

import msgspec

from surefoot.errors import UsageError
from surefoot.installation import imported_names, own_sources
from surefoot.out_folder import (
    FolderLock,
    make_out_folder,
    not_there,
    take_away,
    write_json,
)
from surefoot.robot_io.errors import RobotFileError
from surefoot.run_plan import RunPlan
from surefoot.schemas.result import RunResult
from surefoot.schemas.scenario import with_recordings
from surefoot.schemas.toml_file import atomic_file
from surefoot.sim_robot.catalogue import ScenarioError, naming_scenario
from surefoot.sim_robot.recorded import recorded_ground, recorded_track
from surefoot.stabilizer.controller import CONTROLLERS
from surefoot.stabilizer.foreign import ENTRY_POINTS, find_target
from surefoot.studies.cell import FIGURES, Row, Work

ROOT = "surefoot.simulation"
"""The module that runs one plan."""
_ELSEWHERE = tuple(
    f"surefoot.{name}"
    for name in (
        *("robot_io.bus", "robot_io.client_side", "robot_io.security"),
        *("robot_io.relay", "robot_io.ticks", "signals", "out_folder", "run_folder"),
    )
)
"""Modules that are imported but affect no figure: bus, files and records."""
PACKAGES = ("mujoco", "pin", "piqp", "numpy")
"""Packages that affect the figures."""
_FOLDER = Path(__file__).resolve().parents[2]
STUDY, RUNS = "study.json", "runs.jsonl"
_Kept = msgspec.defstruct(
    "_Kept",
    [
        *((name, str) for name in ("key", "inputs", "variant", "servo_profile")),
        ("seed", int),
        *(
            (f.name, f.type)
            for f in msgspec.structs.fields(RunResult)
            if f.name in FIGURES
        ),
    ],
)
"""What every row has, with types. Rows also tell what varies in their kind of study."""


def about_code() -> dict[str, str]:
    """Return the digest of the code and the versions of its packages, by name."""
    packages = {name: version(name) for name in PACKAGES}
    python = ".".join(platform.python_version_tuple()[:2])
    return {"code": code_fingerprint(), "python": python, **packages}


@cache
def code_fingerprint(root: str = ROOT) -> str:
    """Return the SHA-256 of the code on which a run, or a module, depends."""
    digest = hashlib.sha256()
    for name, tree in sorted(code_of_a_run(root).items()):
        digest.update(f"{name}\n{ast.dump(_without_docstrings(tree))}\n".encode())
    return digest.hexdigest()


def code_of_a_run(root: str = ROOT) -> dict[str, ast.Module]:
    """Return the modules that a run imports, directly or not, by name."""
    found: dict[str, ast.Module] = {}
    waiting = [root]
    while waiting:
        name = waiting.pop()
        path = None if name in found or _is_elsewhere(name) else _file_of(name)
        if path is not None:
            found[name] = ast.parse(path.read_bytes())
            waiting += imported_names(found[name])
    return found


def _is_elsewhere(name: str) -> bool:
    ours = name.startswith("surefoot.")
    return not ours or any(f"{name}.".startswith(f"{room}.") for room in _ELSEWHERE)


def _file_of(name: str) -> Path | None:
    """Find the source of a module; None if the name is not a module."""
    path = _FOLDER.joinpath(*name.split("."))
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file.is_file():
            return file
    return None


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
    """Return the SHA-256 of all inputs of a run except the seed.

    It is taken of contents, not of paths: scenario and recorded motions, robot file and
    URDF, settings, and an external controller's file with the modules it imports.

    Raises:
        ScenarioError: a recording cannot be read, or is not a motion.
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
        for source in _own_code(plan.controller):
            digest.update(source)
    return digest.hexdigest()


def _own_code(controller: str) -> Iterator[bytes]:
    """Sources of a foreign controller: its file, and what this imports of the user."""
    target, (place, colon, _) = find_target(controller), controller.rpartition(":")
    kind = target if inspect.isclass(target) else type(target)
    modules = [cls.__module__ for cls in kind.__mro__]
    modules.insert(0, getattr(target, "__module__", modules[0]))
    if not colon:
        entries = entry_points(group=ENTRY_POINTS)
        place = next((e.module for e in entries if e.name == controller), modules[0])
    return own_sources(place, modules)


class Task(NamedTuple):
    """A run with all its inputs, as it is sent to a worker process.

    Attributes:
        cell: the run.
        robot: shipped name or path of a robot file.
        overrides: settings, texts ``section.name=value``.
        inputs: fingerprint of the inputs where the study was begun; None: any.
    """

    cell: Work
    robot: str
    overrides: tuple[str, ...] = ()
    inputs: str | None = None

    def run(self) -> Row:
        """Run it and return its row: case and figures.

        Raises:
            UsageError: the inputs differ on this machine, or the run cannot begin.
        """
        plan = self.cell.plan(robot=self.robot, overrides=self.overrides)
        here = inputs_fingerprint(plan)
        if self.inputs not in (None, here):
            raise UsageError(
                f"{self.cell.case}: scenario, robot, settings or controller on "
                f"{platform.node()} are not those that the study began with; a run "
                "with them would be mixed in. Give this machine the same files, or "
                "begin another study"
            )
        try:
            row = self.cell.run(plan)
        except (RobotFileError, ScenarioError) as error:
            raise UsageError(f"{self.cell.case}: cannot begin: {error}") from error
        return {"key": self.cell.key, "inputs": here, **row}


class StudyStore:
    """A folder of finished runs, one JSON line each.

    A run is written when it is done and never changed. A line that a killed process
    left incomplete is dropped, and its run is done again.

    Attributes:
        rows: finished runs by key.
    """

    def __init__(self, folder: Path, *, about: dict[str, Any]) -> None:
        """Read a former study, or describe a new one; :meth:`begin` writes.

        Args:
            folder: existing or new folder of the study.
            about: inputs common to all runs, such as overrides; code and packages are
                added.

        Raises:
            UsageError: the folder holds runs of other code or settings, or other
                files.
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
        """Return itself."""
        return self

    def begin(self) -> None:
        """Make the folder, drop an incomplete last line, and open the file of runs.

        Raises:
            UsageError: a part of the folder's path is a file, or another command is
                writing there.
            EnvironmentFailedError: nothing can be written there.
        """
        if self._file is not None:
            return
        self._made = not_there(self._folder)
        make_out_folder(self._folder, out=self._folder)
        self._lock = FolderLock(self._folder)
        # Only now: until then they could be those of another command.
        self._made += [f for f in (self._path, self._folder / STUDY) if not f.exists()]
        # Another command may have finished some runs since the first look.
        self.rows = {row["key"]: row for row in read_rows(self._folder)}
        write_json(self._folder / STUDY, self.about)
        with atomic_file(self._path) as file:
            for row in self.rows.values():
                file.write(msgspec.json.encode(row) + b"\n")
        self._file = self._path.open("ab")

    def __exit__(self, error: object, *more: object) -> None:
        """Close the file, and let other commands write.

        After an error, a study without any run is removed again.
        """
        if self._file is not None:
            self._file.close()
        if error is not None and not self.rows:
            take_away(self._made)
        if self._lock is not None:
            self._lock.release()

    def add(self, row: Row) -> None:
        """Store a finished run."""
        self.begin()
        assert self._file is not None
        self._file.write(msgspec.json.encode(row) + b"\n")
        self._file.flush()
        self.rows[row["key"]] = row

    def check(self, task: Task) -> None:
        """Check that the stored run of a task, if there is one, has the same inputs.

        Args:
            task: the run with its present scenario, robot and settings.

        Raises:
            UsageError: the stored run had other inputs under the same names.
        """
        row = self.rows.get(task.cell.key)
        if row is not None and row["inputs"] != task.inputs:
            raise UsageError(
                f"{self._path}: holds a run of {task.cell.case} from before its "
                "scenario, robot, settings or controller were changed; runs of both "
                "would be mixed. Name another folder, or remove this one"
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
    """Read the finished runs of a folder; an incomplete last line is dropped.

    Raises:
        UsageError: another line is not a run.
    """
    path = folder / RUNS
    if not path.is_file():
        return
    lines = path.read_bytes().splitlines(keepends=True)
    for number, line in enumerate(lines, start=1):
        try:
            row = msgspec.json.decode(line, type=Row)
            msgspec.convert(row, _Kept)
        except msgspec.DecodeError as error:
            if number == len(lines) and not line.endswith(b"\n"):
                return
            raise UsageError(
                f"{path}, line {number}: is no finished run of a study ({error}); take "
                "the line out to have that run made again, or name another folder"
            ) from error
        yield row
