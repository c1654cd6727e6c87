"""Computes the commands of a record again, stabilizer by stabilizer."""

from __future__ import annotations

import logging
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
from surefoot.stabilizer.factory import make_controller
from surefoot.stabilizer.requests import SettingsRamp
from surefoot.stabilizer.safety.safety import Safety

_LOG = logging.getLogger(__name__)


class Start(NamedTuple):
    """A start of the controller: at the beginning, or again after a hold.

    Attributes:
        commander: identity of the stabilizer.
        tick: tick at which the robot was enabled.
        held_tick: tick at which the hold before it began; -1 at the beginning.
        q_held: (n_a,) joint positions held until then [rad].
    """

    commander: str
    tick: int
    held_tick: int
    q_held: list[float]


@dataclass
class Session:
    """One stabilizer, from its first command to its last.

    Attributes:
        commander: identity of the stabilizer.
        commands: its commands by sequence number.
        starts: start by index of the first command after it; index 0 is missing when
            the record begins later than the stabilizer.
        missing: number of commands between the first and the last that the record
            lacks.
    """

    commander: str
    commands: list[JointCommand]
    starts: dict[int, Start] = field(default_factory=dict)
    missing: int = 0


def find_sessions(
    commands: Iterable[JointCommand], statuses: Iterable[RobotStatus]
) -> list[Session]:
    """Split the commands of a record by stabilizer, with the starts of each."""
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

    A robot that was just enabled has no command yet. If commands were only missing for
    a while, ``command_age_s`` continues, and the controller did not start anew.
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
    """Assign each start to the first command after it.

    Commands from before a hold answer ticks up to the tick at which it began. So ticks
    separate them, whatever the clocks of the two sides show.
    """
    ticks = [command.tick for command in session.commands]
    for start in starts:
        index = bisect_right(ticks, start.held_tick)
        if index < len(ticks):
            session.starts[index] = start


class Difference(msgspec.Struct, kw_only=True, frozen=True):
    """A joint whose computed command differs from the recorded one."""

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
        """Computed minus recorded [rad]."""
        return self.computed - self.recorded


class SessionOutcome(msgspec.Struct, kw_only=True):
    """Comparison for one stabilizer of the record."""

    commander: str
    controller: str
    first_tick: int
    last_tick: int
    compared: int = 0
    """Number of commands compared."""
    differing: int = 0
    """Number of commands that are not equal bit for bit."""
    stale: int = 0
    """Ticks compared for which the record lacks a sensor's message."""
    first: Difference | None = None
    """First differing command, with its joint that differs most."""
    largest: Difference | None = None
    """Largest difference of any joint at any tick."""


class ReplayOutcome(msgspec.Struct, kw_only=True):
    """Comparison for the whole record."""

    file: str
    robot: str
    is_cut_off: bool
    is_equal: bool
    """Whether all compared commands are equal bit for bit."""
    compared: int
    sessions: list[SessionOutcome]
    notes: list[str]
    """Differences from the recorded versions, and what could not be compared."""


@dataclass(frozen=True)
class Inputs:
    """Inputs of a controller besides its sensors.

    Attributes:
        robot: the robot's files.
        settings: settings at the start.
        changes: changes of settings while it ran, in order.
        references: references of a planner, in order.
        plans: accepted plans of steps, in order; each counts from its tick on.
        stop_tick: first tick of the soft stop; None without one.
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
    """Answer the recorded ticks with the present code, and compare the commands.

    The robot does not follow the new commands: each tick has the recorded sensors.

    Args:
        session: commands and starts; index 0 must be among the starts.
        sensors: at or before the session's first tick.
        inputs: other inputs of the controller.
        controller: name of the control law.
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
    references, plans = _Newest(inputs.references), deque(inputs.plans)
    for index, command in enumerate(commands):
        reading, start = sensors.at(command.tick), session.starts.get(index)
        if reading is None:
            if start is not None:
                safety = None  # the record lacks the sensors of this start
            continue
        if start is not None and index > 0:
            gains.resume(command.tick)
        gains.advance(command.tick)
        if start is not None:
            law = make_controller(controller, inputs.robot, gains.settings)
            safety = Safety(law, inputs.robot, inputs.settings.safety)
            gains.serve_controller(safety)
            safety.start(reading.snapshot, np.array(start.q_held))
        if safety is not None:
            if command.tick == inputs.stop_tick:
                safety.request_soft_stop("")
            for snapshot in reading.overtaken:
                safety.pass_over(snapshot)
        while plans and plans[0].tick <= command.tick:
            plan = plans.popleft()
            if safety is not None:
                safety.follow_plan(plan)
        if safety is None:
            continue
        stamp_ns = reading.snapshot.stamp_ns
        output = safety.step(reading.snapshot, reading.ages, references.at(stamp_ns))
        outcome.stale += any(reading.ages)
        _compare(command, output.q_command, outcome, inputs.robot)
        on_tick(command.tick)
    if safety is not None and safety.error is not None:
        _LOG.error("%s", safety.detail, exc_info=safety.error)
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
    """Applies the recorded changes of settings to the controller."""

    def __init__(self, inputs: Inputs) -> None:
        self._safety: Safety | None = None
        self._ramp = SettingsRamp(inputs.settings, period_s=inputs.robot.period_s)
        self._changes = list(inputs.changes)

    @property
    def settings(self) -> ControllerSettings:
        """The settings at this tick."""
        return self._ramp.settings

    def serve_controller(self, safety: Safety) -> None:
        """Send changed settings to this controller from now on, if it takes them."""
        self._safety = safety

    def advance(self, tick: int) -> None:
        """Move the settings as the stabilizer does before it answers a tick."""
        self._begin(before=tick + 1)
        self._move()

    def resume(self, tick: int) -> None:
        """Move the settings for the tick that ended a hold, which had no answer."""
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
        if self._safety is None or not self._ramp.is_moving:
            return
        settings = self._ramp.advance()
        if settings is not None:
            self._safety.retune(settings)


class _Newest:
    """The newest reference of a planner at the stamp of a tick's sensors."""

    def __init__(self, messages: Sequence[Reference]) -> None:
        self._coming = list(messages)
        self._newest: Reference | None = None

    def at(self, stamp_ns: int) -> Reference | None:
        while self._coming and self._coming[0].stamp_ns <= stamp_ns:
            self._newest = self._coming.pop(0)
        return self._newest
