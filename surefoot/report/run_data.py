"""Load and validate a run folder."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar
from zipfile import BadZipFile

import msgspec
import numpy as np

from surefoot.errors import UsageError
from surefoot.recording.read import Record, read_record, with_nan
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.run_folder import (
    MARKER,
    RECORD,
    RESULT,
    SCENARIO,
    SETTINGS,
    TICKS,
    read_struct,
)
from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.codec import Head
from surefoot.schemas.messages import (
    ForceTorque,
    ImuState,
    Message,
    RobotStatus,
    StabilizerStatus,
)
from surefoot.schemas.result import RunResult
from surefoot.schemas.scenario import Scenario, load_scenario
from surefoot.schemas.toml_file import read_toml

MOST_RUNS = 6
"""So many colours can be told apart."""
_NEEDED = (
    *("time_s", "com", "base_position", "base_quat_xyzw", "sole_left", "sole_right"),
    *("F_left", "F_right", "q", "q_command"),
    *("platform_position", "platform_quat_xyzw"),
)
NS_PER_MS = 1e6
M = TypeVar("M", Head, ForceTorque, ImuState, RobotStatus, StabilizerStatus)


@dataclass(frozen=True)
class BusColumns:
    """Messages of the bus as columns; every ``..._tick`` is the robot's counter.

    Attributes:
        gap: what the record lacks, in words; empty for a whole one.
        told_tick: (n,) of the stabilizer's messages.
        com: (n, 3) estimated centre of mass, stance frame [m].
        com_reference: (n, 3) where it should be, same frame [m].
        F_meas: (n, 12) measured wrenches at left and right sole, sole frames.
        F_id: (n, 12) desired wrenches.
        in_contact: (n, 2) whether left and right foot stand, as the stabilizer sees it.
        state: (n,) the stabilizer's state, one word.
        tick_ms: (n, 2) median and 99th percentile of its compute time [ms].
        ankle_tick: (m,) of the left ankle's sensor.
        ankle: (m, 6) what it reports: force and moment, sensor frame [N, N m].
        imu_tick: (m,) of the IMU.
        imu_quat_xyzw: (m, 4) its own attitude estimate, world from unit.
        answer_tick: (m,) ticks that got a command.
        answer_ms: (m,) from the stamp of the sensors to that of the command [ms].
        mode_tick: (k,) of the robot's status.
        mode: (k,) mode of its command gate.
    """

    gap: str
    told_tick: Array
    com: Array
    com_reference: Array
    F_meas: Array
    F_id: Array
    in_contact: Array
    state: list[str]
    tick_ms: Array
    ankle_tick: Array
    ankle: Array
    imu_tick: Array
    imu_quat_xyzw: Array
    answer_tick: Array
    answer_ms: Array
    mode_tick: Array
    mode: list[str]


def read_heard(path: Path) -> BusColumns:
    """Read a record; what is no message of its channel is left out and told.

    Raises:
        UsageError: it cannot be read.
    """
    record = read_record(path)
    lost: Counter[str] = Counter()
    told = _messages(record, "stabilizer", StabilizerStatus, lost)
    ankle = _messages(record, "left_ankle_ft", ForceTorque, lost)
    imu = _messages(record, "imu", ImuState, lost)
    status = _messages(record, "status", RobotStatus, lost)
    status.sort(key=lambda message: message.tick)
    answer_tick, answer_ms = _answers(record, lost)
    return BusColumns(
        gap=_gap(record, lost),
        told_tick=_column(told, "tick"),
        com=_rows(told, "com", width=3),
        com_reference=_rows(told, "com_reference", width=3),
        F_meas=_rows(told, "F_meas_left", "F_meas_right", width=12),
        F_id=_rows(told, "F_id_left", "F_id_right", width=12),
        in_contact=_rows(told, "in_contact", width=2),
        state=[message.state for message in told],
        tick_ms=np.column_stack(
            (_column(told, "tick_median_ms"), _column(told, "tick_p99_ms"))
        ),
        ankle_tick=_column(ankle, "tick"),
        ankle=_rows(ankle, "force", "moment", width=6),
        imu_tick=_column(imu, "tick"),
        imu_quat_xyzw=_rows(imu, "quat_xyzw", width=4),
        answer_tick=answer_tick,
        answer_ms=answer_ms,
        mode_tick=_column(status, "tick"),
        mode=[message.mode for message in status],
    )


def _gap(record: Record, lost: Counter[str]) -> str:
    words = []
    if record.is_cut_off or record.damage:
        words.append(f"its record of the bus is {record.condition}")
    for channel, count in lost.items():
        words.append(f"{count} messages on {channel} cannot be read")
    return f"{'; '.join(words)}. Curves out of it lack as much." if words else ""


def _answers(record: Record, lost: Counter[str]) -> tuple[Array, Array]:
    """Ticks with a command, and how long each command took [ms].

    Both stamps are of one clock, since a run has both processes on one host.
    """
    sensed = _messages(record, "joints", Head, lost)
    sensed_ns = {head.tick: head.stamp_ns for head in sensed}
    answers = [
        (head.tick, (head.stamp_ns - sensed_ns[head.tick]) / NS_PER_MS)
        for head in _messages(record, "joint_command", Head, lost)
        if head.tick in sensed_ns
    ]
    table = np.array(answers, dtype=np.float64).reshape(-1, 2)
    return table[:, 0], table[:, 1]


def _messages(
    record: Record, channel: str, kind: type[M], lost: Counter[str]
) -> list[M]:
    """What came on a channel, typed; counts what does not fit.

    A reading that was NaN, which JSON does not know, is NaN again.
    """
    if channel not in record.channels:
        return []
    found = []
    for message in record.messages(channel):
        restored = {name: with_nan(value) for name, value in message.items()}
        with contextlib.suppress(msgspec.ValidationError):
            found.append(msgspec.convert(restored, kind))
    unreadable = record.size(channel) - len(found)
    if unreadable:
        lost[channel] += unreadable
    return found


def _column(messages: Sequence[Head | Message], field: str) -> Array:
    return np.array([getattr(one, field) for one in messages], dtype=np.float64)


def _rows(messages: Sequence[Message], *fields: str, width: int) -> Array:
    """(n, width) the fields of each message, one behind the other."""
    rows = [
        [number for field in fields for number in getattr(message, field)]
        for message in messages
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, width)


@dataclass(frozen=True)
class RunData:
    """One run.

    Attributes:
        label: distinguishes it from the other runs of a page.
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
    heard: BusColumns | None
    logs: dict[str, str]


def load_runs(folders: list[Path]) -> list[RunData]:
    """Load runs of one robot.

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
    """Load one run.

    Raises:
        UsageError: it is not there, not finished, or cannot be read.
    """
    from surefoot.sim_robot.plant import Plant

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


def _find_record(folder: Path) -> BusColumns | None:
    for name in (RECORD, f"{RECORD}.partial"):
        if (folder / name).is_file():
            return read_heard(folder / name)
    return None
