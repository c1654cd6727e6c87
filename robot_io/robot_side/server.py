"""The robot's side of the bus: publishes sensors, and passes commands to the gate."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from enum import Enum

from surefoot.robot_io.bus.channel import NEVER, Channel
from surefoot.robot_io.realtime import Pace, StopRequest
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.mode_machine import Answer, CommandResult, Refusal
from surefoot.robot_io.robot_side.services import RobotServices, RobotsSide
from surefoot.robot_io.snapshot import Snapshot, sensor_messages
from surefoot.schemas.codec import MAX_MESSAGE_BYTES, decode_fields, encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.errors import MessageError, SchemaVersionError
from surefoot.schemas.messages import JointCommand, PushRequest, RobotMode, Truth
from surefoot.schemas.reasons import ModeCause
from surefoot.schemas.topics import TICK_SENSORS

_LOG = logging.getLogger(__name__)

COMMANDS_KEPT = 256
STATUS_PERIOD_S = 0.02
IDLE_POLL_S = 0.01
SEE_OFF_S = 1.0
"""Longest wait for a commander to leave after the end of a run [s]."""
FLUSHED_TICKS = 4
"""Ticks are flushed while the newest answer is at most this many ticks old. A missing
answer means that Zenoh's sender may have no processor. Until it has one, each flush
uses up one of its few batches; without flushes these hold some hundred ticks."""


class NoAnswer(Enum):
    """Reasons why a wait brought no answer."""

    YET = "yet"
    """The time is up, or the wait was interrupted: something else needs attention."""
    OVERTAKEN = "overtaken"
    """The answer is lost: one to a later tick has come."""


def read_command(data: bytes, gate: CommandGate) -> JointCommand | None:
    """Read a command; the gate counts an unreadable one as refused.

    The gate judges the numbers: even a command without a posture is an answer.
    """
    try:
        return decode_fields(data, JointCommand)
    except SchemaVersionError as error:
        gate.refuse(Refusal.SCHEMA, str(error))
    except MessageError as error:
        gate.refuse(Refusal.MALFORMED, str(error))
    return None


class CommandInbox:
    """Reads joint commands and passes each to the gate.

    Attributes:
        newest_tick: tick answered by the command read last; -1 before any.
    """

    def __init__(self, channel: Channel, gate: CommandGate) -> None:
        """Read from a channel.

        Args:
            channel: source of the bytes.
            gate: judges commands, and counts unreadable ones.
        """
        self.newest_tick = NEVER
        self._channel = channel
        self._gate = gate
        self._early: JointCommand | None = None

    def newest(self, tick: int, *, now_s: float) -> CommandResult | None:
        """Judge all commands that have come; for real time.

        Args:
            tick: the newest tick that can have been answered.
            now_s: the robot's time [s].

        Returns:
            The last accepted one; None when none was.
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
        """Wait for the commander's answer to a tick; for lockstep.

        Args:
            tick: the tick whose answer is wanted.
            newest_tick: the newest tick that can have been answered.
            now_s: the robot's time [s].
            deadline: end of the wait, on ``time.monotonic`` [s].

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
        command = read_command(data, self._gate)
        if command is not None:
            self.newest_tick = command.tick
        return command


class RobotServer(RobotsSide):
    """Publishes a robot's sensors and passes commands through its gate.

    A context manager, used by one thread, the robot's loop. The simulator and all
    hardware drivers use it::

        with RobotServer(robot, gate, endpoints=endpoints, stop=stop) as server:
            server.wait_until_active(...)
            while running:
                server.publish_sensors(snapshot, stamp_ns=now)
                result = server.answer(...)     # or take_newest(...)

    Attributes:
        deadline_misses: ticks without their command, counted by the robot's loop.
    """

    def __init__(
        self,
        robot: Robot,
        gate: CommandGate,
        *,
        endpoints: Endpoints,
        stop: StopRequest,
        push: Callable[[PushRequest], Answer] | None = None,
        pace: Pace = Pace.REALTIME,
    ) -> None:
        """Prepare; entering the context opens the bus.

        Args:
            robot: has the names of keys and joints.
            gate: judges commands and answers requests.
            endpoints: where to listen.
            stop: ends the waits.
            push: answers pushes; None on a robot that is not simulated.
            pace: sent with each answer of a service; real time on hardware.
        """
        super().__init__(robot, endpoints=endpoints, stop=stop, pace=pace)
        self._push = push
        self._gate = gate
        self._tick = 0
        self._status_due_s = 0.0
        self._told: tuple[RobotMode, ModeCause, str] | None = None
        is_checked = bool(endpoints.router)
        self._largest_truth = endpoints.max_bytes if is_checked else MAX_MESSAGE_BYTES
        self._truth_is_missed = False
        self.deadline_misses = 0

    def wait_until_active(self, *, timeout_s: float | None) -> bool:
        """Serve requests until a commander has enabled the robot, whose time is 0.

        Args:
            timeout_s: longest wait; None: no limit [s].

        Returns:
            Whether it is ACTIVE; False after the time limit or a stop request.
        """
        end = None if timeout_s is None else time.monotonic() + timeout_s
        while not self._stop.is_set:
            self._services.serve(now_s=0.0)
            self.publish_status(now_s=0.0)
            if self._gate.mode is RobotMode.ACTIVE:
                return True
            if end is not None and time.monotonic() >= end:
                return False
            self._services.wait(IDLE_POLL_S)
        return False

    def see_off(self, commander: str, *, now_s: float) -> None:
        """Publish the last status, and wait until the commander has left the bus.

        Its last messages have then been forwarded to observers.

        Args:
            commander: name of the commander; empty for nobody.
            now_s: the robot's time [s].
        """
        self._say_farewell(self._status_now(now_s))
        end_s = time.monotonic() + SEE_OFF_S
        while self._services.is_present(commander) and time.monotonic() < end_s:
            self._services.wait(IDLE_POLL_S)
            self._services.serve(now_s=0.0)

    def serve_requests(self, *, now_s: float) -> None:
        """Answer new requests; costs nothing when there are none.

        Args:
            now_s: the robot's time [s].
        """
        if self._services.serve(now_s=now_s):
            self.publish_status(now_s=now_s)

    def publish_sensors(
        self, snapshot: Snapshot, *, stamp_ns: int, missing: tuple[str, ...] = ()
    ) -> None:
        """Send the sensor messages of a tick, in the order of the sensor table.

        Args:
            snapshot: sensors of the tick.
            stamp_ns: the robot's monotonic clock when the sensors were read [ns].
            missing: channels without a message in this tick.
        """
        self._tick = snapshot.tick
        # All are encoded first, so that they are likely to leave in one batch.
        encoded = [
            encode(message) for message in sensor_messages(snapshot, stamp_ns=stamp_ns)
        ]
        is_answered = snapshot.tick - self._commands.newest_tick <= FLUSHED_TICKS
        publishers = self._flushing if is_answered else self._gathering
        for name, publisher, data in zip(
            TICK_SENSORS, publishers, encoded, strict=True
        ):
            if name not in missing:
                publisher.put(data)

    def answer(
        self, tick: int, *, now_s: float, deadline: float
    ) -> CommandResult | NoAnswer:
        """Wait for the command that answers a tick.

        The wait is interrupted when a request comes, the commander goes or the robot is
        stopped. The caller then serves requests, and asks again if it still waits.

        Args:
            tick: a tick whose sensors were published.
            now_s: the robot's time [s].
            deadline: end of the wait, on ``time.monotonic`` [s].

        Returns:
            The outcome of the command, or why there is none.
        """
        return self._commands.answer(
            tick, newest_tick=self._tick, now_s=now_s, deadline=deadline
        )

    def take_newest(self, *, now_s: float) -> CommandResult | None:
        """Judge the commands that came since the last call, without waiting.

        Args:
            now_s: the robot's time [s].

        Returns:
            The last accepted one; None when none was.
        """
        return self._commands.newest(self._tick, now_s=now_s)

    def publish_status(self, *, now_s: float) -> None:
        """Publish the gate's status on a change, and 50 times a second.

        Args:
            now_s: the robot's time [s].
        """
        modes = self._gate.modes
        tell = (modes.mode, modes.cause, modes.lease.holder)
        clock_s = time.monotonic()
        if tell == self._told and clock_s < self._status_due_s:
            return
        self._told = tell
        self._status_due_s = clock_s + STATUS_PERIOD_S
        self._status.put(self._status_now(now_s))

    def _status_now(self, now_s: float) -> bytes:
        status = self._gate.status(
            tick=self._tick,
            stamp_ns=time.monotonic_ns(),
            now_s=now_s,
            deadline_misses=self.deadline_misses,
        )
        return encode(status)

    def publish_truth(self, truth: Truth) -> None:
        """Send the simulator's true state, unless it is too large for the bus."""
        data = encode(truth)
        if len(data) <= self._largest_truth:
            self._truth.put(data)
        elif not self._truth_is_missed:
            self._truth_is_missed = True
            _LOG.warning(
                "nobody is told the true state: with %d blocks of ground it is %d "
                "bytes, and the bus takes %d; have fewer or larger tiles",
                *(len(truth.ground), len(data), self._largest_truth),
            )

    def _declare(self) -> None:
        keys = self._robot.keys
        self._gathering = tuple(
            self._bus.publisher(keys[name], urgent=True) for name in TICK_SENSORS
        )
        last = self._bus.publisher(keys[TICK_SENSORS[-1]], urgent=True, flush=True)
        self._flushing = (*self._gathering[:-1], last)
        self._status = self._bus.publisher(keys["status"], urgent=False)
        self._truth = self._bus.publisher(keys["truth"], urgent=False)
        self._commands = CommandInbox(
            self._bus.channel(keys["joint_command"], depth=COMMANDS_KEPT),
            self._gate,
        )
        self._services = RobotServices(
            self._bus,
            self._robot,
            self._gate,
            identity=self.identity,
            push=self._push,
            pace=self._pace,
        )
