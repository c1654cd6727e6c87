"""Computes a record's commands again and compares them with the recorded ones."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

from surefoot.errors import UsageError
from surefoot.playback.recompute import (
    Inputs,
    ReplayOutcome,
    Session,
    SessionOutcome,
    find_sessions,
    recompute,
)
from surefoot.playback.timeline import (
    Entry,
    RecordedSensors,
    Timeline,
    read_timeline,
    recorded_robot,
    to_wire,
)
from surefoot.recording.contents import VERSIONS, version_notes, versions
from surefoot.recording.read import decode_json
from surefoot.robot_io.robot import Robot
from surefoot.run_folder import MARKER, SETTINGS
from surefoot.run_plan import Settings, resolve_settings
from surefoot.schemas.codec import decode
from surefoot.schemas.errors import FileFormatError, MessageError
from surefoot.schemas.messages import (
    JointCommand,
    Message,
    Reference,
    RobotMode,
    RobotStatus,
    SettingsChange,
    StabilizerStatus,
)
from surefoot.schemas.reasons import StabilizerState
from surefoot.schemas.settings import ControllerSettings, build_settings
from surefoot.schemas.walk_plan import WalkPlan, joined
from surefoot.stabilizer.control.reference import ReferenceLimits
from surefoot.stabilizer.factory import check_read
from surefoot.stabilizer.model import RobotModel

M = TypeVar("M", bound=Message)


def replay(
    file: str | Path,
    *,
    controller: str | None = None,
    settings: Settings = None,
    robot: str | Path | Robot | None = None,
    until_s: float | None = None,
    on_tick: Callable[[int], None] | None = None,
) -> ReplayOutcome:
    """Compute the commands of a record again from its sensors, and compare.

    The robot does not follow the new commands: each tick has the recorded sensors.

    Args:
        file: a record (.mcap), or the folder of a run that holds one.
        controller: a name as on the command line; None for the recorded one.
        settings: see :func:`surefoot.simulate`; None for those of the record.
        robot: None for the one attached to the record.
        until_s: compare this much from the first tick on [s]; None for all.
        on_tick: called with each tick.

    Returns:
        Counts of compared and differing commands, with the first and the largest
        difference.

    Raises:
        UsageError: there is no such file, or it holds nothing to compute again.
        ControllerError: there is no such controller.
    """
    timeline = read_timeline(Path(file))
    resolved = (
        recorded_settings(timeline, [])
        if settings is None
        else resolve_settings(settings, reader=controller)
    )
    instead = str(robot.path) if isinstance(robot, Robot) else robot
    with recorded_robot(
        timeline.record, None if instead is None else str(instead)
    ) as model:
        return check(
            timeline,
            model,
            resolved,
            file=timeline.record.path,
            law=controller,
            until_s=until_s,
            on_tick=on_tick or (lambda tick: None),
        )


def recorded_settings(timeline: Timeline, overrides: list[str]) -> ControllerSettings:
    """Return the settings attached to a record, with overrides.

    Args:
        timeline: the record; the defaults are used if it has no settings.
        overrides: texts ``section.name=value``.

    Raises:
        FileFormatError: the settings cannot be used.
    """
    table: dict[str, Any] = {}
    data = timeline.record.attachments.get(SETTINGS)
    if data is not None:
        try:
            table = tomllib.loads(data.decode())
        except ValueError as error:
            raise FileFormatError(f"the attached {SETTINGS}: {error}") from error
    return build_settings(table, overrides=overrides, source=f"attached {SETTINGS}")


def check(
    timeline: Timeline,
    robot: Robot,
    settings: ControllerSettings,
    *,
    file: Path,
    law: str | None,
    overrides: Sequence[str] = (),
    until_s: float | None,
    on_tick: Callable[[int], None],
) -> ReplayOutcome:
    """Compute all commands of a record again, and compare.

    Args:
        timeline: the record.
        robot: the recorded robot.
        settings: the controllers' settings at their start.
        file: path to name in the outcome.
        law: name of the controller to use; None for the recorded one.
        overrides: settings that the controllers must read.
        until_s: compare this much from the first tick on [s]; None for all.
        on_tick: called with each tick.

    Raises:
        UsageError: it holds no command, or not the start of any commander.
        FileFormatError: a controller does not read an override.
    """
    said = _Said(timeline, robot, until_s=until_s)
    outcomes: list[SessionOutcome] = []
    notes = said.notes
    sensors = RecordedSensors(said.entries, joint_count=robot.n_a, raw=said.raw)
    limits = ReferenceLimits(RobotModel(robot))
    inputs = Inputs(
        robot,
        settings,
        said.of(SettingsChange),
        [one for one in said.of(Reference) if not limits.why_not(one)],
        joined(said.of(WalkPlan)),
    )
    for session in find_sessions(said.of(JointCommand), said.of(RobotStatus)):
        whole = _followable(session, notes)
        if whole is None:
            continue
        name = law or said.law_of(whole)
        check_read(overrides, [name])
        outcome_of_one = recompute(
            whole,
            sensors,
            _of_session(inputs, whole, said.of(StabilizerStatus)),
            controller=name,
            on_tick=on_tick,
        )
        left_out = len(whole.commands) - outcome_of_one.compared
        if left_out:
            notes.append(
                f"{left_out} commands of {whole.commander} are not compared: sensors "
                "that its controller began with are not in the record"
            )
        if outcome_of_one.compared:
            outcomes.append(outcome_of_one)
    if not outcomes:
        told = "; ".join(notes) or "it holds no command"
        raise UsageError(f"{file}: nothing to compute again: {told}")
    outcome = ReplayOutcome(
        file=str(file),
        robot=robot.file.name,
        is_cut_off=timeline.record.is_cut_off,
        is_equal=not any(session.differing for session in outcomes),
        compared=sum(session.compared for session in outcomes),
        sessions=outcomes,
        notes=notes,
    )
    if not outcome.is_equal:
        stale = sum(session.stale for session in outcomes)
        notes += _doubts(inputs, said.mode, stale=stale)
    return outcome


def _followable(session: Session, notes: list[str]) -> Session | None:
    """Return the part of a session before its first gap; None without its start."""
    who = session.commander
    if 0 not in session.starts:
        tick = session.commands[0].tick
        notes.append(
            f"{who} commanded before the record begins (tick {tick}): the state of "
            "its controller is unknown"
        )
        return None
    if session.missing:
        before, after = next(
            (earlier.tick, later.tick)
            for earlier, later in pairwise(session.commands)
            if later.sequence != earlier.sequence + 1
        )
        notes.append(
            f"{session.missing} commands of {who} are not in the record; compared up "
            f"to tick {before}, before the first of them"
        )
        count = [command.tick for command in session.commands].index(after)
        return Session(who, session.commands[:count], session.starts)
    return session


def _of_session(
    inputs: Inputs, session: Session, told: Sequence[StabilizerStatus]
) -> Inputs:
    """Keep the changes, plans and stop of one session, and all references."""
    first, last = session.commands[0].tick, session.commands[-1].tick
    stops = [
        status.tick
        for status in told
        if status.state is StabilizerState.SOFT_STOP and first <= status.tick <= last
    ]
    return replace(
        inputs,
        changes=[change for change in inputs.changes if first <= change.tick <= last],
        plans=[plan for plan in inputs.plans if first <= plan.tick <= last],
        stop_tick=min(stops, default=None),
    )


def _doubts(inputs: Inputs, mode: str, *, stale: int) -> list[str]:
    """Return what besides code and settings may explain differences."""
    doubts = []
    if stale:
        doubts.append(
            f"{stale} ticks lack a sensor's message: the sensor was silent, or the "
            "message was lost on its way to the recorder alone"
        )
    if inputs.references:
        doubts.append(
            "a planner gave references: the record does not tell from which tick on "
            "each counted, so their stamps are used"
        )
    if mode != "lockstep":  # records of surefoot record do not tell their mode
        doubts.append(
            "in real time a sensor's message may have reached the recorder but been "
            "late for the stabilizer; the record does not tell"
        )
    return doubts


class _Said:
    """Decoded messages of a record, up to the robot's first restart."""

    def __init__(
        self, timeline: Timeline, robot: Robot, *, until_s: float | None
    ) -> None:
        record = timeline.record
        self.raw = {name: record.is_raw(name) for name in record.channels}
        self._robot = robot
        self.notes = version_notes(record.attachments.get(VERSIONS), versions())
        if record.damage:
            self.notes.append(f"the record is {record.condition}")
        if SETTINGS not in record.attachments:
            self.notes.append("no settings attached: the defaults are used")
        self._about: dict[str, Any] = {}
        if MARKER in record.attachments:
            try:
                self._about = decode_json(record.attachments[MARKER])
            except MessageError as error:
                self.notes.append(f"the attached {MARKER} cannot be read ({error})")
        entries = [entry for entry in timeline.entries if entry.round == 0]
        if len(entries) < len(timeline.entries):
            self.notes.append(
                "the robot restarted: only ticks before that are compared"
            )
        self.entries = self._settled(entries)
        if until_s is not None:
            end = timeline.first_tick + round(until_s / robot.period_s)
            self.entries = [entry for entry in self.entries if entry.tick < end]

    @property
    def mode(self) -> str:
        """Pace of the run; empty if unknown."""
        return str(self._about.get("mode", ""))

    def of(self, kind: type[M]) -> list[M]:
        """Return all readable messages of a kind, in order."""
        channel = _CHANNELS[kind]
        decoded = (
            self._decoded(entry, kind)
            for entry in self.entries
            if entry.channel == channel
        )
        return [message for message in decoded if message is not None]

    def law_of(self, session: Session) -> str:
        """Return the name of the controller in a session.

        Raises:
            UsageError: the record does not tell.
        """
        first, last = session.commands[0].tick, session.commands[-1].tick
        for status in self.of(StabilizerStatus):
            if first <= status.tick <= last:
                return status.controller
        if "controller" in self._about:
            return str(self._about["controller"])
        raise UsageError(
            f"the record does not say which controller {session.commander} was; name "
            "it with --law"
        )

    def _decoded(self, entry: Entry, kind: type[M]) -> M | None:
        try:
            return decode(
                to_wire(entry.data, is_raw=self.raw[entry.channel]),
                kind,
                joint_count=self._robot.n_a,
            )
        except MessageError:
            return None

    def _settled(self, entries: list[Entry]) -> list[Entry]:
        """Leave out last commands whose sensors the record may lack.

        The recorder writes in batches, channel by channel, with ``status`` last. A
        command may be in one batch and its sensors in the next, which is missing if
        the record ends in the middle of a run.
        """
        statuses = [entry for entry in entries if entry.channel == "status"]
        last = self._decoded(statuses[-1], RobotStatus) if statuses else None
        if last is None or last.mode is RobotMode.OFF:
            return entries
        places = sorted(entry.place for entry in statuses)
        moments = [place for place, later in pairwise(places) if later != place + 1]
        end = moments[-1] if moments else 0
        settled = [
            entry
            for entry in entries
            if entry.channel != "joint_command" or entry.place < end
        ]
        if len(settled) < len(entries):
            self.notes.append(
                f"the record ends in mid-run: its last {len(entries) - len(settled)} "
                "commands are left out, as what they answer may be missing"
            )
        return settled


_CHANNELS: dict[type[Message], str] = {
    JointCommand: "joint_command",
    RobotStatus: "status",
    StabilizerStatus: "stabilizer",
    SettingsChange: "settings_change",
    Reference: "reference",
    WalkPlan: "walk_taken",
}
