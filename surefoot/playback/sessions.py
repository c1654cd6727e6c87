"""Who commanded in a record, from where, and which ticks were answered."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from surefoot.schemas.messages import JointCommand, RobotMode, RobotStatus
from surefoot.schemas.reasons import ModeCause


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
    """Tell the stabilizers of a record apart.

    Args:
        commands: as recorded.
        statuses: of the robot, as recorded.
    """
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
