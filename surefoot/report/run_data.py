"""A run's folder, loaded and validated."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from surefoot.errors import UsageError
from surefoot.out_folder import printable
from surefoot.recording.mcap_records import RecordError
from surefoot.recording.read import Record, read_record, with_nan
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.run_folder import (
    SCENARIO,
    SETTINGS,
    TICKS,
    About,
    naming_run,
    read_ends,
    record_of_run,
)
from surefoot.schemas.arrays import NS_PER_MS, Array, Vec3
from surefoot.schemas.codec import Head
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.messages import (
    GroundBlock,
    Message,
    RobotStatus,
    StabilizerStatus,
)
from surefoot.schemas.result import RunResult
from surefoot.schemas.scenario import Scenario, load_scenario
from surefoot.schemas.toml_file import read_toml
from surefoot.signals import Signals, read_signals
from surefoot.sim_robot.state_view import ground_blocks

MOST_RUNS = 6
"""Number of colours that can be told apart."""
_DRAWN = (
    *("q", "q_command", "true_com", "true_base_pose", "true_F"),
    *("true_sole_left", "true_sole_right"),
)
"""Signals without which a tick cannot be drawn; where it moves, the ground as well."""
M = TypeVar("M", Head, RobotStatus, StabilizerStatus)


@dataclass(frozen=True)
class BusColumns:
    """Messages of the bus in columns; every ``..._tick`` is the robot's counter.

    Attributes:
        gap: what the record lacks, in words; empty for a complete one.
        told_tick: (n,) ticks of the stabilizer's status messages.
        state: (n,) the stabilizer's state at them.
        answer_tick: (m,) ticks that were answered by a command.
        answer_ms: (m,) from the stamp of the sensors to that of the command [ms].
        mode_tick: (k,) ticks of the robot's status messages.
        mode: (k,) mode of its command gate at them.
    """

    gap: str
    told_tick: Array
    state: list[str]
    answer_tick: Array
    answer_ms: Array
    mode_tick: Array
    mode: list[str]


def read_heard(path: Path) -> BusColumns:
    """Read a record; ``gap`` tells what could not be read."""
    try:
        record = read_record(path)
    except RecordError as error:  # the recorder was cut off at its start
        nothing = np.zeros(0)
        gap = f"its record of the bus is missing: {error}"
        return BusColumns(gap, nothing, [], nothing, nothing, nothing, [])
    lost: Counter[str] = Counter()
    told = _messages(record, "stabilizer", StabilizerStatus, lost)
    status = _messages(record, "status", RobotStatus, lost)
    status.sort(key=lambda message: message.tick)
    answer_tick, answer_ms = _answers(record, lost)
    return BusColumns(
        gap=_gap(record, lost),
        told_tick=_column(told, "tick"),
        state=[message.state for message in told],
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
    """Return the ticks with a command, (m,), and the time that each took, (m,) [ms].

    Both stamps are of one clock, since both processes of a run are on one host.
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
    """Return a channel's messages, typed; adds the unreadable ones to ``lost``.

    NaN readings, which JSON cannot hold, become NaN again.
    """
    if channel not in record.channels:
        return []
    found = []
    for message in record.each(channel):
        restored = {name: with_nan(value) for name, value in message.items()}
        with contextlib.suppress(msgspec.ValidationError):
            found.append(msgspec.convert(restored, kind))
    unreadable = record.size(channel) - len(found)
    if unreadable:
        lost[channel] += unreadable
    return found


def _column(messages: Sequence[Head | Message], field: str) -> Array:
    return np.array([getattr(one, field) for one in messages], dtype=np.float64)


@dataclass(frozen=True)
class RunData:
    """One run.

    Attributes:
        label: name that distinguishes it from the other runs of a page.
        result: figures of the run.
        about: content of ``run.json``: seed, mode, versions.
        robot: the robot's files as they are now.
        scenario: the scenario as read.
        scenario_text: the scenario's file.
        settings: value by ``section.name``, as resolved for the run.
        signals: signals of every tick.
        com_reference: (3,) x and y from the midpoint of the soles, z in the world [m].
        ground: all blocks of the ground.
        heard: messages of the bus; None for a run without a record.
        logs: text of the log by process.
    """

    label: str
    result: RunResult
    about: About
    robot: Robot
    scenario: Scenario
    scenario_text: str
    settings: dict[str, Any]
    signals: Signals
    com_reference: Vec3
    ground: list[GroundBlock]
    heard: BusColumns | None
    logs: dict[str, str]

    @property
    def is_walk(self) -> bool:
        """Whether the robot took steps."""
        phase = self.signals.get("walk_phase")
        return phase is not None and bool(np.any(phase > 0))

    def drawable(self, rows: Array) -> NDArray[np.int64]:
        """Return the given rows, or the next ones of which all is known.

        A slow disk or damage may have cost some.

        Args:
            rows: (n,) wanted rows, in order.
        """
        known = _known(self.signals)
        at = np.searchsorted(known, rows.astype(np.int64))
        found: NDArray[np.int64] = known[np.minimum(at, len(known) - 1)]
        return found


def _known(signals: Signals) -> NDArray[np.int64]:
    """Return the rows that can be drawn."""
    parts = [*_DRAWN, *({"true_platform_pose"} & set(signals))]
    whole = [
        np.isfinite(signals[name]).reshape(signals.count, -1).all(axis=1)
        for name in parts
    ]
    return np.flatnonzero(np.logical_and.reduce(whole))


def load_runs(folders: list[Path]) -> list[RunData]:
    """Load runs of one robot.

    Raises:
        UsageError: there are too many, a folder is missing or holds no finished run,
            or the robots differ.
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
        UsageError: it is missing, unfinished or unreadable.
    """
    from surefoot.sim_robot.plant import Plant

    result, about = read_ends(folder)
    signals = read_signals(folder)
    if not {*_DRAWN, "ft_left"} <= set(signals) or not len(_known(signals)):
        kept_none = f"{TICKS} is missing; the run kept no ticks of the robot"
        raise UsageError(
            f"{folder}: {'; '.join(signals.gaps) or kept_none}. So there is nothing "
            "to draw; make the run again with --out, and let it run"
        )
    with naming_run(folder):
        robot = load_robot(about.robot, servo_profile=about.servo_profile)
    recorded = len(signals.layout("q").labels)
    if recorded != robot.n_a:
        raise UsageError(
            f"{folder}: a run with {recorded} joints, but {robot.path} now has "
            f"{robot.n_a}; make the run again"
        )
    scenario = load_scenario(folder / SCENARIO)
    plant = Plant(robot, scenario, seed=result.seed)
    record = record_of_run(folder)
    return RunData(
        label=label,
        result=result,
        about=about,
        robot=robot,
        scenario=scenario,
        scenario_text=(folder / SCENARIO).read_text(encoding="utf-8"),
        settings=_settings(folder / SETTINGS),
        signals=signals,
        com_reference=plant.com_reference,
        ground=ground_blocks(plant.world),
        heard=None if record == folder else read_heard(record),
        logs={
            path.stem: path.read_text(encoding="utf-8", errors="replace")
            for path in sorted(folder.glob("*.log"))
            if path.is_file()
        },
    )


def _settings(path: Path) -> dict[str, Any]:
    """Read the resolved settings, including those that this version does not know."""
    tables = read_toml(path)
    for section, table in tables.items():
        if not isinstance(table, dict):
            raise FileFormatError(
                f"{path}: {section}: got {table!r}, expected a table", field=section
            )
    return {
        f"{section}.{name}": value
        for section, table in tables.items()
        for name, value in table.items()
    }


def _labels(folders: list[Path]) -> list[str]:
    whole = [folder.resolve() for folder in folders]
    for index, folder in enumerate(whole):
        if folder in whole[:index]:
            raise UsageError(f"{folders[index]}: named twice; name each run once")
    names = [printable(folder.name) for folder in whole]
    if len(set(names)) == len(names):
        return names
    return [printable(str(folder)) for folder in folders]
