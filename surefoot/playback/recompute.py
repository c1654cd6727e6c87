"""Computes the commands of a record again, stabilizer by stabilizer."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec
import numpy as np

from surefoot.playback.timeline import RecordedSensors
from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import (
    JointCommand,
    Reference,
    RobotMode,
    RobotStatus,
    SettingsChange,
)
from surefoot.schemas.reasons import ModeCause
from surefoot.schemas.settings import ControllerSettings
from surefoot.schemas.walk_plan import WalkPlan
from surefoot.stabilizer.control.controller import Controller, Tunable, Walks
from surefoot.stabilizer.factory import make_controller
from surefoot.stabilizer.requests import SettingsRamp
from surefoot.stabilizer.safety.safety import Safety


class Start(NamedTuple):
    """The controller begins, or begins anew after a hold.

    Attributes:
        commander: identity.
        tick: at which the robot was enabled.
        held_tick: at which it began to hold before that; -1 at the very beginning.
        q_held: (n_a,) posture it held [rad].
    """

    commander: str
    tick: int
    held_tick: int
    q_held: list[float]


@dataclass
class Session:
    """One stabilizer, from its first command to its last.

    Attributes:
        commander: identity.
        commands: in order of sequence.
        starts: posture the controller begins from, by index of the command that is
            the first to answer from there; index 0 is missing when the record begins
            later than the stabilizer.
        missing: commands that the record lacks between the first and the last.
    """

    commander: str
    commands: list[JointCommand]
    starts: dict[int, Start] = field(default_factory=dict)
    missing: int = 0


def find_sessions(
    commands: Iterable[JointCommand], statuses: Iterable[RobotStatus]
) -> list[Session]:
    """Tell the stabilizers of a record apart."""
    sessions: list[Session] = []
    for command in commands:
        last = sessions[-1] if sessions else None
        if (
            last is None
            or command.commander != last.commander
            or command.sequence <= last.commands[-1].sequence
        ):
            sessions.append(Session(command.commander, [command]))
            continue
        last.missing += command.sequence - last.commands[-1].sequence - 1
        last.commands.append(command)
    starts = find_starts(statuses)
    for session in sessions:
        last_tick = session.commands[-1].tick
        mine = [
            start
            for start in starts
            if start.commander == session.commander and start.held_tick < last_tick
        ]
        starts = [start for start in starts if start not in mine]
        _place(session, mine)
    return sessions


def find_starts(statuses: Iterable[RobotStatus]) -> list[Start]:
    """Find every time a commander began to command the robot.

    A robot just enabled has no command yet; one that has only missed commands for a
    while goes on with the last one's age, and its controller knows of nothing.
    """
    starts: list[Start] = []
    held_tick = -1
    was_held, was_asked = True, False
    for status in statuses:
        if status.mode is RobotMode.ACTIVE:
            if was_held and status.command_age_s < 0.0:
                starts.append(
                    Start(
                        status.commander,
                        status.tick,
                        held_tick,
                        list(status.q_command),
                    )
                )
            was_held = False
            continue
        is_asked = status.mode is RobotMode.HOLD and status.cause is ModeCause.REQUESTED
        if not was_held or (is_asked and not was_asked):
            held_tick = status.tick
        was_held, was_asked = True, is_asked
    return starts


def _place(session: Session, starts: Sequence[Start]) -> None:
    """Find the first command after each start.

    Commands from before a hold answer ticks no later than the one it began at; so
    ticks tell which are which, whatever the clocks of the two sides say.
    """
    ticks = [command.tick for command in session.commands]
    for start in starts:
        index = bisect_right(ticks, start.held_tick)
        if index < len(ticks):
            session.starts[index] = start


class Difference(msgspec.Struct, kw_only=True, frozen=True):
    """A joint whose command was another one."""

    tick: int
    time_s: float
    """Tick times the control period [s]."""
    joint: str
    recorded: float
    """[rad]"""
    computed: float
    """[rad]"""

    @property
    def error(self) -> float:
        """Computed less recorded [rad]."""
        return self.computed - self.recorded


class SessionOutcome(msgspec.Struct, kw_only=True):
    """One stabilizer of the record."""

    commander: str
    controller: str
    first_tick: int
    last_tick: int
    compared: int = 0
    """Commands compared."""
    differing: int = 0
    """Commands that are not equal bit for bit."""
    stale: int = 0
    """Ticks compared for which the record lacks the message of a sensor."""
    first: Difference | None = None
    """The first that differs; of its joints the one that differs most."""
    largest: Difference | None = None
    """The largest difference of any joint at any tick."""


class ReplayOutcome(msgspec.Struct, kw_only=True):
    """The whole record."""

    file: str
    robot: str
    is_cut_off: bool
    is_equal: bool
    """Whether all commands compared are equal bit for bit."""
    compared: int
    sessions: list[SessionOutcome]
    notes: list[str]
    """What was other than when the record was made, or could not be compared."""


@dataclass(frozen=True)
class Inputs:
    """What a controller was given.

    Attributes:
        robot: its files.
        settings: it was made with.
        changes: of settings while it ran, in order.
        references: of a planner, in order.
        plans: steps that it took over while it ran, in order; each from its tick on.
        stop_tick: from which on it came to rest, since it was asked to stop; None for
            one that was not.
    """

    robot: Robot
    settings: ControllerSettings
    changes: Sequence[SettingsChange]
    references: Sequence[Reference]
    plans: Sequence[WalkPlan] = ()
    stop_tick: int | None = None


def recompute(
    session: Session,
    sensors: RecordedSensors,
    inputs: Inputs,
    *,
    controller: str,
    on_tick: Callable[[int], None],
) -> SessionOutcome:
    """Answer the same ticks with the present code, and compare.

    The robot does not follow the new commands: every tick has the sensors that were
    recorded, whatever was answered before.

    Args:
        session: commands and starts; index 0 must be among the starts.
        sensors: at or before the session's first tick.
        inputs: what the controller was given besides.
        controller: name of the law.
        on_tick: called with each tick.
    """
    commands = session.commands
    outcome = SessionOutcome(
        commander=session.commander,
        controller=controller,
        first_tick=commands[0].tick,
        last_tick=commands[-1].tick,
    )
    gains = _Gains(inputs)
    safety: Safety | None = None
    law: Controller | None = None
    references, plans = _Newest(inputs.references), deque(inputs.plans)
    for index, command in enumerate(commands):
        reading, start = sensors.at(command.tick), session.starts.get(index)
        if reading is None:
            if start is not None:
                safety = None  # what the controller began with is not in the record
            continue
        if start is not None and index > 0:
            gains.resume(command.tick)
        gains.advance(command.tick)
        if start is not None:
            law = make_controller(controller, inputs.robot, gains.settings)
            gains.serve_controller(law)
            safety = Safety(law, inputs.robot, inputs.settings.safety)
            safety.start(reading.snapshot, np.array(start.q_held))
        while plans and plans[0].tick <= command.tick:
            plan = plans.popleft()
            if isinstance(law, Walks):
                law.follow_plan(plan)
        if safety is None:
            continue
        stamp_ns = reading.snapshot.stamp_ns
        if command.tick == inputs.stop_tick:
            safety.request_soft_stop("")
        output = safety.step(reading.snapshot, reading.ages, references.at(stamp_ns))
        outcome.stale += any(reading.ages)
        _compare(command, output.q_command, outcome, inputs.robot)
        on_tick(command.tick)
    return outcome


def _compare(
    command: JointCommand, computed: Array, outcome: SessionOutcome, robot: Robot
) -> None:
    recorded = np.array(command.q)
    outcome.compared += 1
    if recorded.tobytes() == computed.tobytes():
        return
    outcome.differing += 1
    joint = int(np.argmax(np.abs(computed - recorded)))
    found = Difference(
        tick=command.tick,
        time_s=command.tick * robot.period_s,
        joint=robot.joint_names[joint],
        recorded=float(recorded[joint]),
        computed=float(computed[joint]),
    )
    outcome.first = outcome.first or found
    if outcome.largest is None or abs(found.error) > abs(outcome.largest.error):
        outcome.largest = found


class _Gains:
    """Leads the controller through the recorded changes of settings."""

    def __init__(self, inputs: Inputs) -> None:
        self._tunable: Tunable | None = None
        self._ramp = SettingsRamp(inputs.settings, period_s=inputs.robot.period_s)
        self._changes = list(inputs.changes)

    @property
    def settings(self) -> ControllerSettings:
        """As they are now."""
        return self._ramp.settings

    def serve_controller(self, law: Controller) -> None:
        """Give new gains to this one from now on, if it can take any."""
        self._tunable = law if isinstance(law, Tunable) else None

    def advance(self, tick: int) -> None:
        """Move the settings as the stabilizer does before it answers a tick."""
        self._begin(before=tick + 1)
        self._move()

    def resume(self, tick: int) -> None:
        """Move the settings for the tick at which a hold ended, which had no answer."""
        self._begin(before=tick)
        self._move()

    def _begin(self, *, before: int) -> None:
        while self._changes and self._changes[0].tick < before:
            change = self._changes.pop(0)
            self._ramp.begin(
                change.after,
                source=change.source,
                tick=change.tick,
                stamp_ns=change.stamp_ns,
            )

    def _move(self) -> None:
        if self._tunable is None or not self._ramp.is_moving:
            return
        settings = self._ramp.advance()
        if settings is not None:
            self._tunable.retune(settings)


class _Newest:
    """A planner's newest reference when the sensors of a tick were taken."""

    def __init__(self, messages: Sequence[Reference]) -> None:
        self._coming = list(messages)
        self._newest: Reference | None = None

    def at(self, stamp_ns: int) -> Reference | None:
        while self._coming and self._coming[0].stamp_ns <= stamp_ns:
            self._newest = self._coming.pop(0)
        return self._newest
