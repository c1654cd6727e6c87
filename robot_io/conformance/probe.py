"""The commander of the conformance checks: records everything, can misbehave."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

import msgspec
import numpy as np

from surefoot.robot_io.bus.bus import Bus, dialed_bus
from surefoot.robot_io.bus.session import unreachable
from surefoot.robot_io.client_side.requests import ServiceCaller
from surefoot.robot_io.client_side.robot_watch import RobotWatch
from surefoot.robot_io.conformance.evidence import Recording
from surefoot.robot_io.errors import (
    RequestRefusedError,
    RobotMismatchError,
    RobotUnreachableError,
)
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.robot_side.mode_machine import DONE, Answer
from surefoot.schemas.arrays import Array
from surefoot.schemas.codec import decode, encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.errors import MessageError
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    EstopRequest,
    JointCommand,
    JointState,
    ModeRequest,
    RobotMode,
    RobotStatus,
)
from surefoot.schemas.reasons import ModeCause, RequestRefusal
from surefoot.schemas.topics import ALIVE_STABILIZER, TICK_SENSORS

KEPT = 512
ANSWER_S = 2.0
STREAM_S = 0.1
GAP_S = 0.2
"""Lateness of a tick after which streaming stops for this time [s]."""
TOO_LATE = (ModeCause.SILENCE, ModeCause.LOOP_TOO_SLOW)
"""Causes for which a robot gives up a commander that answers late."""
Offset = Callable[[float], Array]
"""Maps the time since the stream began [s] to (n_a,) offsets from ``q_held`` [rad]."""


class Instant(NamedTuple):
    """A moment on both clocks.

    Attributes:
        clock_s: time on our clock [s].
        tick: newest tick received from the robot by then.
    """

    clock_s: float
    tick: int


class Probe:
    """Holds the robot's posture as a commander would.

    Attributes:
        identity: name of this commander.
        robot: the robot of the files.
        q_held: (n_a,) posture that is held [rad].
        q_first: (n_a,) first measured posture; None before it [rad].
        moved_rad: largest distance of any joint from there so far [rad].
        tick: newest tick received.
        status: newest status.
        status_errors: number of unreadable statuses.
        status_error: what was wrong with the last unreadable one.
    """

    def __init__(
        self, robot: Robot, bus: Bus, watch: RobotWatch, *, identity: str
    ) -> None:
        """Declare everything; :func:`probing` opens the bus and finds the robot."""
        self.identity, self.robot = identity, robot
        self._watch = watch
        self.q_held: Array = robot.nominal
        self.q_first: Array | None = None
        self.moved_rad = 0.0
        self.tick = 0
        self.status: RobotStatus | None = None
        self.status_errors, self.status_error = 0, ""
        self._sequence = 0
        keys = robot.keys
        self._sensors = {
            name: bus.channel(keys[name], depth=KEPT) for name in TICK_SENSORS
        }
        self._statuses = bus.channel(keys["status"], depth=KEPT)
        self._command = bus.publisher(keys["joint_command"], urgent=True)
        self._services = ServiceCaller(
            bus.session,
            joint_count=robot.n_a,
            timeout_s=ANSWER_S,
            robot_is_here=lambda: True,  # one that has gone just does not answer
            check=watch.check_reply,
        )
        bus.announce(f"{ALIVE_STABILIZER}/{identity}")

    @property
    def was_too_late(self) -> str:
        """Why the robot gave us up, if it is in fault for late answers; else empty."""
        status = self.status
        if status is None or status.mode is not RobotMode.FAULT:
            return ""
        return status.detail if status.cause in TOO_LATE else ""

    def ask(
        self,
        service: str,
        action: str,
        *,
        who: str | None = None,
        description: str | None = None,
    ) -> Answer:
        """Ask for a lease or a mode, or press the e-stop.

        Args:
            service: ``lease``, ``mode`` or ``estop``.
            action: the action of the service; not used by the e-stop.
            who: name to ask in; our own when None.
            description: robot description to send; our own when None.
        """
        name = self.identity if who is None else who
        request = self._request(service, action, name, description or "")
        try:
            reply = self._services.ask(self.robot.keys[service], request)
        except RequestRefusedError as error:
            return Answer(error.refusal, error.detail)
        except (RobotMismatchError, RobotUnreachableError, MessageError) as error:
            return Answer(RequestRefusal.NO_ANSWER, f"no valid answer: {error}")
        self.q_held = np.array(reply.q_command)
        return DONE

    def _request(
        self, service: str, action: str, name: str, description: str
    ) -> msgspec.Struct:
        if service == "estop":
            return EstopRequest(schema=SCHEMA_VERSION, source=name)
        if service == "mode":
            return ModeRequest(schema=SCHEMA_VERSION, action=action, commander=name)
        return self._watch.lease_request(action, name, description=description)

    def start(self) -> Answer:
        """Enable the robot; from then on commands must be streamed."""
        answer = self.ask("mode", "enable")
        for channel in self._sensors.values():
            channel.discard()
        return answer

    def command(self, **changes: Any) -> bytes:
        """Make a command that holds the posture, with some fields replaced."""
        self._sequence += 1
        fields: dict[str, Any] = {
            "schema": SCHEMA_VERSION,
            "tick": self.tick,
            "stamp_ns": time.monotonic_ns(),
            "q": self.q_held.tolist(),
            "commander": self.identity,
            "sequence": self._sequence,
            **changes,
        }
        return encode(JointCommand(**fields))

    def put(self, data: bytes) -> None:
        """Send bytes as a command."""
        self._command.put(data)

    def stream(
        self,
        duration_s: float,
        *,
        offset: Offset | None = None,
        extra: Callable[[int], bytes | None] = lambda count: None,
    ) -> Recording:
        """Answer each new tick with the held posture, and record the sensors.

        Args:
            duration_s: duration, both on this clock and in the robot's ticks [s].
            offset: offset from the held posture, as a function of the robot's time.
            extra: called at each answer with its number in this stream; returns bytes
                to send before the answer, or None.
        """
        recording = Recording(joint_count=self.robot.n_a)
        begin = counted = time.monotonic()
        first: int | None = None
        newest, count, passed_s = -1, 0, 0.0
        while (now := time.monotonic()) < begin + duration_s or (
            # A robot on a busy machine is slow; its servos need the robot's time.
            passed_s < duration_s and now < counted + GAP_S
        ):
            if not self._hear(recording, deadline=now + GAP_S):
                continue
            if self.tick > newest:
                newest, counted = self.tick, now
            first = self.tick if first is None else first
            passed_s = (self.tick - first) * self.robot.period_s
            more = extra(count)
            if more is not None:
                self.put(more)
            if offset is None:
                self.put(self.command())
            else:
                self.put(self.command(q=(self.q_held + offset(passed_s)).tolist()))
            count += 1
            while (data := self._statuses.poll()) is not None:
                self._read_status(data)
        return recording

    def stream_until_active(self) -> bool:
        """Answer ticks until the robot reports ACTIVE; return whether it does in time.

        On a busy machine it may hold briefly for silence, and resume by itself.
        """
        end = time.monotonic() + ANSWER_S
        while time.monotonic() < end:
            self.stream(STREAM_S)
            if self.status is not None and self.status.mode is RobotMode.ACTIVE:
                return True
        return False

    def wait_status(
        self, condition: Callable[[RobotStatus], bool], *, timeout_s: float
    ) -> float | None:
        """Wait for a status without commanding.

        Returns:
            Time it took, measured by :meth:`since` [s]; None when no such status came.
        """
        begin = newest = self.now()
        while self.since(begin) < timeout_s:
            # Statuses that came while we could not run are read before giving up.
            give_up_s = newest.clock_s + max(timeout_s, ANSWER_S)
            data = self._statuses.wait(give_up_s)
            if data is not None and self._read_status(data):
                assert self.status is not None
                if condition(self.status):
                    return self.since(begin)
                if self.status.tick > newest.tick:
                    newest = self.now()
                    continue
            if time.monotonic() >= give_up_s:
                break  # the robot's time stands still
        return None

    def now(self) -> Instant:
        """Return the present moment, as a start for :meth:`since`."""
        told = self.tick if self.status is None else self.status.tick
        return Instant(time.monotonic(), max(self.tick, told))

    def since(self, begin: Instant) -> float:
        """Return the time since ``begin``: clock or robot ticks, the shorter one [s].

        A watchdog that counts the robot's own time may be slower than our clock.
        """
        now = self.now()
        ticks_s = (now.tick - begin.tick) * self.robot.period_s
        return min(now.clock_s - begin.clock_s, ticks_s)

    def count_statuses(self, duration_s: float) -> int:
        """Count the readable status messages within a time [s]."""
        self._statuses.discard()
        end, count = time.monotonic() + duration_s, 0
        while time.monotonic() < end:
            data = self._statuses.wait(end)
            count += data is not None and self._read_status(data)
        return count

    def is_mode(self, mode: RobotMode, *, timeout_s: float = ANSWER_S) -> bool:
        """Return whether the robot reaches a mode in time."""
        return (
            self.wait_status(lambda s: s.mode is mode, timeout_s=timeout_s) is not None
        )

    def _hear(self, recording: Recording, *, deadline: float) -> bool:
        """Take all ticks received so far; wait for one when there is none."""
        data = self._sensors["joints"].wait(deadline)
        newest = data
        while data is not None:  # catch up
            newest = data
            recording.add("joints", data)
            data = self._sensors["joints"].poll()
        for name in TICK_SENSORS[1:]:
            while (data := self._sensors[name].poll()) is not None:
                recording.add(name, data)
        if newest is None:
            return False
        with suppress(MessageError):  # reported when the recording is read
            joints = decode(newest, JointState, joint_count=self.robot.n_a)
            self.tick = joints.tick
            q = np.array(joints.q)
            self.q_first = q if self.q_first is None else self.q_first
            self.moved_rad = max(self.moved_rad, float(np.abs(q - self.q_first).max()))
        return True

    def _read_status(self, data: bytes) -> bool:
        try:
            self.status = decode(data, RobotStatus, joint_count=self.robot.n_a)
        except MessageError as error:
            self.status_errors += 1
            self.status_error = str(error)
            return False
        return True


@contextmanager
def probing(
    robot: Robot, *, endpoints: Endpoints, identity: str, timeout_s: float
) -> Iterator[Probe]:
    """Dial a robot and wait for its first status.

    Raises:
        EndpointError: a locator is malformed.
        RobotUnreachableError: no robot is there, or no status came in time.
        RobotMismatchError: the robot has another description, or there are two robots.
    """
    with dialed_bus(
        endpoints, namespace=robot.file.namespace, timeout_s=timeout_s
    ) as bus:
        watch = RobotWatch(robot)
        watch.follow(bus)
        end_s = time.monotonic() + timeout_s
        watch.find_within(end_s, endpoints=endpoints, timeout_s=timeout_s)
        probe = Probe(robot, bus, watch, identity=identity)
        if probe.wait_status(lambda s: True, timeout_s=timeout_s) is None:
            what = f"no status of a robot {robot.file.namespace!r}"
            if probe.status_errors:
                what += f" that can be read ({probe.status_error})"
            raise RobotUnreachableError(unreachable(endpoints, what, timeout_s))
        yield probe
