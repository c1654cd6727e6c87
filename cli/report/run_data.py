"""A run as its folder has it, checked and ready to be told of."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import msgspec
import numpy as np

from cli.errors import UsageError
from cli.report.heard import Heard, read_heard
from cli.run_directory import MARKER
from cli.run_files import RECORD, RESULT, SCENARIO, SETTINGS, TICKS, read_struct
from robot_io.robot import Robot, load_robot
from schemas.arrays import Array, Vec3
from schemas.result import RunResult
from schemas.scenario import Scenario, load_scenario
from schemas.toml_file import read_toml

MOST_RUNS = 6
"""So many colours can be told apart."""
_NEEDED = (
    *("time_s", "com", "base_position", "base_quat_xyzw", "sole_left", "sole_right"),
    *("F_left", "F_right", "q", "q_command"),
    *("platform_position", "platform_quat_xyzw"),
)


@dataclass(frozen=True)
class RunData:
    """One run.

    Attributes:
        label: what tells it from the others of a page.
        result: its figures.
        about: what ``run.json`` says: seed, mode, versions.
        robot: its files, as they are now.
        scenario: what was done to it.
        scenario_text: the same as written.
        settings: ``section.name`` to value, as resolved for the run.
        ticks: columns of every tick; see :meth:`RunRecord.arrays`.
        com_reference: (3,) x and y from the midpoint of the soles, z in the world [m].
        heard: what was said on the bus; None for a run without a record.
        logs: name of a process to what it said.
    """

    label: str
    result: RunResult
    about: dict[str, Any]
    robot: Robot
    scenario: Scenario
    scenario_text: str
    settings: dict[str, Any]
    ticks: dict[str, Array]
    com_reference: Vec3
    heard: Heard | None
    logs: dict[str, str]


def load_runs(folders: list[Path]) -> list[RunData]:
    """Loads runs of one robot.

    Raises:
        UsageError: a folder is not there, no finished run, or of another robot.
    """
    if len(folders) > MOST_RUNS:
        raise UsageError(
            f"{len(folders)} runs on one page, at most {MOST_RUNS} can be told apart; "
            "name fewer"
        )
    runs = [
        load_run(folder, label=label)
        for folder, label in zip(folders, _labels(folders), strict=True)
    ]
    first = runs[0]
    for folder, run in zip(folders, runs, strict=True):
        if run.robot.joint_names != first.robot.joint_names or (
            run.result.robot != first.result.robot
        ):
            raise UsageError(
                f"{folder} is a run of {run.result.robot}, {folders[0]} of "
                f"{first.result.robot}; a page compares runs of one robot"
            )
    return runs


def load_run(folder: Path, *, label: str) -> RunData:
    """Loads one run.

    Raises:
        UsageError: it is not there, not finished, or cannot be read.
    """
    from sim_robot.plant import Plant

    result, about = _read_ends(folder)
    ticks = _read_ticks(folder / TICKS)
    robot = load_robot(about["robot"], servo_profile=about["servo_profile"])
    recorded = ticks["q"].shape[1]
    if recorded != robot.n_a:
        raise UsageError(
            f"{folder}: a run with {recorded} joints, but {robot.path} now has "
            f"{robot.n_a}; make the run again"
        )
    scenario = load_scenario(folder / SCENARIO)
    return RunData(
        label=label,
        result=result,
        about=about,
        robot=robot,
        scenario=scenario,
        scenario_text=(folder / SCENARIO).read_text(encoding="utf-8"),
        settings={
            f"{section}.{name}": value
            for section, table in read_toml(folder / SETTINGS).items()
            for name, value in table.items()
        },
        ticks=ticks,
        com_reference=Plant(robot, scenario, seed=result.seed).com_reference,
        heard=_find_record(folder),
        logs={
            path.stem: path.read_text(encoding="utf-8", errors="replace")
            for path in sorted(folder.glob("*.log"))
        },
    )


def _labels(folders: list[Path]) -> list[str]:
    whole = [folder.resolve() for folder in folders]
    for index, folder in enumerate(whole):
        if folder in whole[:index]:
            raise UsageError(f"{folders[index]}: named twice; name each run once")
    names = [folder.name for folder in whole]
    if len(set(names)) == len(names):
        return names
    return [str(folder) for folder in folders]


def _read_ends(folder: Path) -> tuple[RunResult, dict[str, Any]]:
    if not folder.is_dir():
        raise UsageError(
            f"{folder}: no such folder; `surefoot run SCENARIO --out {folder}` makes "
            "one"
        )
    if not (folder / MARKER).is_file():
        raise UsageError(
            f"{folder}: not the folder of a run, {MARKER} is missing; name what "
            "`surefoot run --out` was given"
        )
    if not (folder / RESULT).is_file():
        raise UsageError(
            f"{folder}: the run did not finish, {RESULT} is missing; its logs "
            "(*.log) say why"
        )
    try:
        result = read_struct(folder / RESULT, RunResult)
        about: dict[str, Any] = msgspec.json.decode((folder / MARKER).read_bytes())
        about["robot"], about["servo_profile"], about["packages"]
    except (msgspec.DecodeError, KeyError, TypeError) as error:
        raise UsageError(
            f"{folder}: {RESULT} or {MARKER} is damaged, or of another version of "
            f"surefoot ({error}); make the run again"
        ) from error
    return result, about


def _read_ticks(path: Path) -> dict[str, Array]:
    if not path.is_file():
        raise UsageError(
            f"{path}: missing; the run kept no ticks, so there is nothing to draw. "
            "Make it again with --out"
        )
    try:
        with np.load(path, allow_pickle=False) as arrays:
            ticks = {name: arrays[name] for name in _NEEDED}
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise UsageError(f"{path}: damaged ({error}); make the run again") from error
    if len(ticks["time_s"]) == 0:
        raise UsageError(f"{path}: holds no tick; the run ended before its first")
    return ticks


def _find_record(folder: Path) -> Heard | None:
    for name in (RECORD, f"{RECORD}.partial"):
        if (folder / name).is_file():
            return read_heard(folder / name)
    return None
