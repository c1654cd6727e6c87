"""Commands on their way from the bus through the gate."""

from __future__ import annotations

from enum import Enum

from surefoot.robot_io.bus.channel import Channel
from surefoot.robot_io.bus.inbox import NEVER
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.mode_machine import CommandResult, Refusal
from surefoot.schemas.codec import decode
from surefoot.schemas.errors import MessageError, SchemaVersionError
from surefoot.schemas.messages import JointCommand


class NoAnswer(Enum):
    """Why a wait for an answer brought none."""

    YET = "yet"
    """Its time is up, or it was broken off: something else wants to be looked at."""
    OVERTAKEN = "overtaken"
    """It is lost: the answer to a later tick has come."""


class CommandInbox:
    """Reads joint commands and has the gate check each of them.

    Attributes:
        newest_tick: the tick answered by the command read last; -1 before any.
    """

    def __init__(
        self, channel: Channel, gate: CommandGate, *, joint_count: int
    ) -> None:
        """Read from a channel.

        Args:
            channel: where the bytes come from.
            gate: judges, and counts what cannot be read.
            joint_count: n_a.
        """
        self.newest_tick = NEVER
        self._channel = channel
        self._gate = gate
        self._joint_count = joint_count
        self._early: JointCommand | None = None

    def newest(self, tick: int, *, now_s: float) -> CommandResult | None:
        """Judge all that has come; real time.

        Args:
            tick: the newest tick that can have been answered.
            now_s: the robot's time [s].

        Returns:
            The last one accepted, None when none was.
        """
        accepted = None
        while (data := self._channel.poll()) is not None:
            command = self._read(data)
            if command is None:
                continue
            result = self._gate.accept(command, tick=tick, now_s=now_s)
            if result.accepted:
                accepted = result
        return accepted

    def answer(
        self, tick: int, *, newest_tick: int, now_s: float, deadline: float
    ) -> CommandResult | NoAnswer:
        """Wait for the commander's answer to a tick; lockstep.

        Args:
            tick: the tick whose answer is wanted.
            newest_tick: the newest tick that can have been answered.
            now_s: the robot's time [s].
            deadline: until when, on ``time.monotonic`` [s].

        Returns:
            The answer, accepted or not, or why there is none.
        """
        while (command := self._next(deadline)) is not None:
            is_commander = self._gate.modes.holds_lease(command.commander)
            if is_commander and tick < command.tick <= newest_tick:
                self._early = command
                return NoAnswer.OVERTAKEN
            result = self._gate.accept(command, tick=tick, now_s=now_s)
            is_replay = result.refusal is Refusal.SEQUENCE
            if is_commander and command.tick == tick and not is_replay:
                return result
        return NoAnswer.YET

    def _next(self, deadline: float) -> JointCommand | None:
        if self._early is not None:
            early, self._early = self._early, None
            return early
        while (data := self._channel.wait(deadline)) is not None:
            command = self._read(data)
            if command is not None:
                return command
        return None

    def _read(self, data: bytes) -> JointCommand | None:
        try:
            command = decode(data, JointCommand, joint_count=self._joint_count)
        except SchemaVersionError as error:
            self._gate.refuse(Refusal.SCHEMA, str(error))
        except MessageError as error:
            self._gate.refuse(Refusal.MALFORMED, str(error))
        else:
            self.newest_tick = command.tick
            return command
        return None
