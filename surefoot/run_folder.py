"""Names and contents of the files in the folder of a run."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeVar

import msgspec

from surefoot.errors import UsageError
from surefoot.installation import this_machine
from surefoot.out_folder import OutFolder, printable, write_json
from surefoot.robot_io.errors import RobotFileError
from surefoot.run_plan import (
    Mode,
    RunPlan,
    check_on_disk,
    make_plan,
    resolve_settings,
    settings_text,
)
from surefoot.schemas.result import RunResult

RESULT = "result.json"
SETTINGS = "settings.toml"
SCENARIO = "scenario.toml"
RELAY = "relay.toml"
VIDEO, STILL = "video.mp4", "video.png"
TICKS, CONTROLLER_TICKS = "ticks.mcap", "controller-ticks.mcap"
RECORD = "run.mcap"
QP_FAILURE = "qp-failure.npz"
_T = TypeVar("_T", bound=msgspec.Struct)
MARKER = "run.json"
"""Every folder of a run holds this file."""
NO_RUN = (
    f"not the folder of a run, {MARKER} is missing; name what `surefoot run --out` was "
    "given"
)
_ENDS = ("", ".partial")


class About(msgspec.Struct, kw_only=True, frozen=True):
    """Content of ``run.json``: the run, its command and its packages.

    Fields that only inform may be missing, as in runs of another release.
    """

    command: list[str] = []
    """Name of the program, and its arguments."""
    scenario: str
    robot: str
    """A shipped name or a path."""
    servo_profile: str
    controller: str
    seed: int
    mode: Mode
    relay: str | None = None
    """Name of the relay's plan; None without a relay."""
    started: str = ""
    """Start in UTC, as ISO 8601."""
    python: str = ""
    platform: str = ""
    packages: dict[str, str | None] = {}
    """Version by name; None for a package that is not installed."""


RUN_FILES = (
    *(MARKER, RESULT, SETTINGS, SCENARIO, RELAY, QP_FAILURE),
    *("ground-[0-9].*", "ground-[0-9][0-9].*"),
    *(f"{name}{end}" for name in (TICKS, CONTROLLER_TICKS, RECORD) for end in _ENDS),
    *("robot.log", "stabilizer.log", "recorder.log", "relay.log", "view.log"),
    *("plant.json", "controller.json", "relay.json"),
    *("endpoints.toml", "beyond-endpoints.toml"),
    *(VIDEO, STILL),
)
"""All files that a run writes; it never touches other files in its folder."""


def run_folder(
    out: Path | None, *, reads: Collection[Path] = (), overwrite: bool = False
) -> OutFolder:
    """Return the folder of a run that is about to begin.

    Args:
        out: path of the folder; None for a run that keeps nothing.
        reads: files that the run has yet to read, such as those of its plan.
        overwrite: replace the files of a former run there.
    """
    return OutFolder(
        out,
        marker=MARKER,
        content="a run",
        ours=RUN_FILES,
        reads=reads,
        overwrite=overwrite,
    )


def write_inputs(folder: Path, plan: RunPlan) -> None:
    """Write the inputs of a run: scenario, settings, relay plan and ``run.json``.

    The run can be repeated with the scenario, the settings and the seed in
    ``run.json``.

    Raises:
        UsageError: the robot's file does not hold the robot; nothing is written.
    """
    check_on_disk(plan.robot)
    (folder / SCENARIO).write_text(plan.scenario_text, encoding="utf-8")
    for file, name in plan.recordings.items():
        shutil.copyfile(file, folder / name)
    (folder / SETTINGS).write_text(settings_text(plan.settings), encoding="utf-8")
    if plan.relay_path is not None:
        shutil.copyfile(plan.relay_path, folder / RELAY)
    words = [*(Path(program).name for program in sys.argv[:1]), *sys.argv[1:]]
    about = About(
        command=[*map(printable, words)],
        scenario=plan.scenario_name,
        robot=printable(plan.robot_name),
        servo_profile=plan.robot.file.servo.profile,
        controller=printable(plan.controller),
        seed=plan.seed,
        mode=plan.mode,
        relay=None if plan.relay_path is None else plan.relay_path.stem,
        started=datetime.now(UTC).isoformat(timespec="seconds"),
        **this_machine(),
    )
    write_json(folder / MARKER, about)


def write_result(folder: OutFolder, result: RunResult) -> RunResult:
    """Write the figures of a run; this file is the last one written.

    Returns:
        The figures, with the folder's name in them.
    """
    name = None if folder.out is None else printable(str(folder.out))
    result = msgspec.structs.replace(result, out=name)
    write_json(folder.path / RESULT, result)
    return result


def copy_rest(former: Path, folder: Path) -> None:
    """Copy the files of a run that a copy of it lacks, and its ``run.json``."""
    for name in RUN_FILES:
        for file in former.glob(name):
            if name == MARKER or not (folder / file.name).exists():
                shutil.copyfile(file, folder / file.name)


def settle_run(place: Path) -> None:
    """Bring back a run's files that a killed command set aside, before a reading.

    Args:
        place: folder of the run, or a file in it, which may be missing.
    """
    run_folder(place if place.is_dir() else place.parent).settle()


def folder_of_run(place: Path) -> Path:
    """Return the folder of a run, given this folder or any file in it."""
    settle_run(place)
    is_inside = place.is_file() and (place.parent / MARKER).is_file()
    return place.parent if is_inside else place


def record_of_run(place: Path) -> Path:
    """The record of the bus in a run's folder, also one cut off; others as they are."""
    settle_run(place)
    records = (place / f"{RECORD}{end}" for end in _ENDS)
    return next((record for record in records if record.is_file()), place)


def read_ends(folder: Path) -> tuple[RunResult, About]:
    """Read the figures of a finished run, and its ``run.json``.

    Returns:
        The result, and the content of ``run.json``.

    Raises:
        UsageError: it is not a finished run, or damaged.
    """
    settle_run(folder)
    if folder.is_file():
        raise UsageError(
            f"{folder}: a file, and not in the folder of a run; name the folder that "
            "`surefoot run --out` was given"
        )
    if not folder.is_dir():
        raise UsageError(
            f"{folder}: no such folder; `surefoot run SCENARIO --out {folder}` makes "
            "one"
        )
    if not (folder / MARKER).is_file():
        raise UsageError(f"{folder}: {NO_RUN}")
    if not (folder / RESULT).is_file():
        raise UsageError(
            f"{folder}: the run was cut off, {RESULT} is missing. Its logs (*.log) say "
            f"why; `surefoot log info {folder}` shows what was recorded, `surefoot log "
            f"export {folder} --format csv --out FOLDER` takes it"
        )
    try:
        return (
            read_struct(folder / RESULT, RunResult),
            read_struct(folder / MARKER, About),
        )
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise UsageError(
            f"{folder}: {RESULT} or {MARKER} is damaged, or of another version of "
            f"surefoot ({error}); make the run again"
        ) from error


def read_run(folder: Path) -> tuple[RunResult, RunPlan]:
    """Read the figures of a finished run, and its plan.

    Raises:
        UsageError: it is not a finished run, or damaged.
    """
    result, about = read_ends(folder)
    with naming_run(folder):
        plan = make_plan(
            folder / SCENARIO,
            robot=about.robot,
            servo_profile=about.servo_profile,
            controller=about.controller,
            settings=resolve_settings(folder / SETTINGS),
            seed=about.seed,
            mode=about.mode,
            relay=None if about.relay is None else str(folder / RELAY),
        )
    return result, replace(plan, scenario_name=about.scenario)


@contextmanager
def naming_run(folder: Path) -> Iterator[None]:
    """Turn the error for a kept run's robot file into one that tells what to do.

    Raises:
        UsageError: the robot's file was moved, removed or changed since.
    """
    try:
        yield
    except RobotFileError as error:
        raise UsageError(
            f"{folder}: its robot cannot be loaded ({error}); put the file back, or "
            f"write where it is now into {folder / MARKER}, as `robot`"
        ) from error


def read_struct(path: Path, kind: type[_T]) -> _T:
    """Read a struct from a JSON file."""
    return msgspec.json.decode(path.read_bytes(), type=kind)
