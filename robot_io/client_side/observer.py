"""Read-only clients of a robot's bus: recorders, viewers, tools."""

from __future__ import annotations

import contextlib
import os
import secrets
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from types import TracebackType
from typing import NamedTuple, Self

import msgspec

from surefoot.robot_io.bus.bus import Bus, dialed_bus
from surefoot.robot_io.bus.channel import Channel
from surefoot.robot_io.bus.inbox import Latest
from surefoot.robot_io.bus.session import unreachable
from surefoot.robot_io.client_side.requests import Requests, ServiceCaller
from surefoot.robot_io.errors import RobotUnreachableError
from surefoot.robot_io.robot import Robot
from surefoot.schemas.codec import decode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.errors import MessageError
from surefoot.schemas.messages import (
    ImuState,
    JointState,
    RobotMode,
    RobotStatus,
    StabilizerStatus,
    Truth,
)
from surefoot.schemas.topics import (
    ALIVE_OBSERVER,
    ALIVE_ROBOT,
    ALIVE_STABILIZER,
    TOPICS,
    Direction,
    topic,
)

ALL_CHANNELS = tuple(
    entry.name
    for entry in TOPICS
    if entry.direction not in (Direction.SERVICE, Direction.STABILIZER_SERVICE)
)
"""Every channel that can be subscribed to."""
REQUEST_TIMEOUT_S = 2.0
RETURN_S = 10.0
"""A robot that is away without having said that it ends is waited for so long [s]."""
POLL_S = 0.002
"""Polling period of a wait [s]: fine enough for viewers, cheap when idle."""


class LatestMessages(NamedTuple):
    """Newest message of each channel that a viewer shows; None before the first."""

    joints: JointState | None = None
    imu: ImuState | None = None
    status: RobotStatus | None = None
    stabilizer: StabilizerStatus | None = None
    truth: Truth | None = None


VIEWER_CHANNELS = LatestMessages._fields
"""They are called as in the topic table."""


class Absences(NamedTuple):
    """Times the robot was away without having said that it ends.

    Attributes:
        times: how often.
        total_s: how long in all [s].
        is_lasting: it did not come back from the last one.
    """

    times: int
    total_s: float
    is_lasting: bool

    def __str__(self) -> str:
        """In words; empty when it was there all the time."""
        if not self.times:
            return ""
        times = "" if self.times == 1 else f" in {self.times} places"
        gone = " and did not come back" if self.is_lasting else ""
        return f"the link to the robot was lost for {self.total_s:.1f} s{times}{gone}"


class ReadOnlyClient(ABC):
    """Dials a robot and knows whether it is there; has no part in its control.

    A robot that has gone has either ended, which its last status says (OFF, or a fault,
    with nobody in command), or is only not to be reached for a while.
    """

    def __init__(self, robot: Robot, *, endpoints: Endpoints) -> None:
        """Prepare; :meth:`connect` dials.

        Args:
            robot: whose presence counts.
            endpoints: where to dial.
        """
        self._namespace = robot.file.namespace
        self._endpoints = endpoints
        self._joint_count = robot.n_a
        self._robot_is_here = threading.Event()
        self._farewell: Latest[RobotStatus] | None = None
        self._lost_s: float | None = None
        self._absences: list[float] = []
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        """Do nothing yet; see :meth:`connect`."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the bus."""
        self._stack.close()

    def connect(self, *, timeout_s: float) -> None:
        """Dial until the robot is alive there.

        Args:
            timeout_s: how long in all [s].

        Raises:
            EndpointError: a locator is malformed.
            RobotUnreachableError: no robot was ready in time.
        """
        end = time.monotonic() + timeout_s
        with ExitStack() as stack:
            self._open(stack, timeout_s)
            self._stack = stack.pop_all()
        if not self._robot_is_here.wait(max(0.0, end - time.monotonic())):
            what = f"no robot {self._namespace!r} is ready"
            raise RobotUnreachableError(unreachable(self._endpoints, what, timeout_s))

    @property
    def robot_is_here(self) -> bool:
        """Whether the robot's process is alive, as far as the bus knows."""
        return self._robot_is_here.is_set()

    def has_left(self) -> bool:
        """Whether the robot has ended, or has been away for too long to wait on."""
        lost_s = self._lost_s
        if self.robot_is_here or lost_s is None:
            return False
        return self._said_farewell() or time.monotonic() - lost_s > RETURN_S

    @property
    def absences(self) -> Absences:
        """When the robot was away; an end in order is none."""
        spans, lost_s = list(self._absences), self._lost_s
        is_lasting = lost_s is not None and not self._said_farewell()
        if is_lasting and lost_s is not None:
            spans.append(time.monotonic() - lost_s)
        return Absences(len(spans), sum(spans), is_lasting)

    def _said_farewell(self) -> bool:
        status = None if self._farewell is None else self._farewell.poll()
        if status is None or status.commander:
            return False
        return status.mode in (RobotMode.OFF, RobotMode.FAULT)

    def _watch_robot(self, bus: Bus, status_key: str, alive_key: str) -> None:
        """Keep the newest status, and whether the robot is there.

        Args:
            bus: open.
            status_key: of the robot's status, on this bus.
            alive_key: of its liveliness token.
        """
        status = bus.channel(status_key, depth=1)
        self._farewell = Latest(status, RobotStatus, joint_count=self._joint_count)
        bus.watch_presence(alive_key, self._on_robot)

    @abstractmethod
    def _open(self, stack: ExitStack, timeout_s: float) -> None:
        """Open the bus and declare everything, :meth:`_token` last.

        Args:
            stack: closes what is opened, now or at the end.
            timeout_s: how long to dial [s].
        """

    @staticmethod
    def _token() -> str:
        """Return the key of its own liveliness token."""
        return f"{ALIVE_OBSERVER}/{os.getpid()}-{secrets.token_hex(4)}"

    def _on_robot(self, key: str, is_there: bool) -> None:
        """Take in that the robot has come or gone; for ``Bus.watch_presence``."""
        del key
        if is_there:
            if self._lost_s is not None:
                self._absences.append(time.monotonic() - self._lost_s)
            self._lost_s = None
            self._robot_is_here.set()
        elif self._robot_is_here.is_set():
            self._lost_s = time.monotonic()
            self._robot_is_here.clear()


class Sample(NamedTuple):
    """One message as it came.

    Attributes:
        channel: its name in the topic table.
        data: MessagePack bytes.
        received_ns: this process's monotonic clock when it was taken in [ns].
    """

    channel: str
    data: bytes
    received_ns: int


class Observer(ReadOnlyClient):
    """Receives channels of a robot and commands nothing.

    A context manager, used by one thread. Zenoh keeps the messages in rings until
    they are taken, so a slow reader never holds up the robot::

        with Observer(robot, endpoints=endpoints, channels=("joints",)) as observer:
            observer.connect(timeout_s=10.0)
            while not observer.has_left():
                for sample in observer.take(timeout_s=0.1):
                    message = observer.decode(sample)

    A recorder takes all that comes. A viewer looks, at its own pace: with ``depth=1``
    only the newest message of each channel is kept::

        with Observer(robot, endpoints=endpoints, channels=VIEWER_CHANNELS) as observer:
            observer.connect(timeout_s=10.0)
            sight = observer.latest_messages()
            observer.requests.stop_robot()

    Attributes:
        channels: what it subscribes to.
        requests: what an onlooker may ask; once connected.
    """

    requests: Requests

    def __init__(
        self,
        robot: Robot,
        *,
        endpoints: Endpoints,
        channels: Iterable[str] = ALL_CHANNELS,
        depth: int = 1,
        identity: str = "an observer",
    ) -> None:
        """Prepare; :meth:`connect` dials.

        Args:
            robot: names keys and joints.
            endpoints: where to dial.
            channels: names from the topic table, subscribed to in this order.
            depth: messages kept per channel until taken; older ones give way.
            identity: named in the robot's log when something is asked.
        """
        super().__init__(robot, endpoints=endpoints)
        self._identity = identity
        self.channels = tuple(channels)
        self._robot, self._depth = robot, depth
        self._kinds: dict[str, type[msgspec.Struct]] = {
            name: topic(name).message for name in self.channels
        }
        self._rings: dict[str, Channel] = {}
        self._seen: dict[str, msgspec.Struct] = {}
        self._stabilizers: set[str] = set()

    @property
    def stabilizers(self) -> tuple[str, ...]:
        """Identities of the stabilizers on the bus."""
        return tuple(sorted(self._stabilizers))

    def take(self, *, timeout_s: float = 0.0) -> list[Sample]:
        """Return all messages that have come, channel by channel, each in its order.

        Args:
            timeout_s: how long to wait for the first one [s].

        Returns:
            Nothing when none came in time.
        """
        end = time.monotonic() + timeout_s
        while True:
            samples = list(self._drain())
            if samples or time.monotonic() >= end:
                return samples
            time.sleep(min(POLL_S, timeout_s))  # many channels: no one to block on

    def decode(self, sample: Sample) -> msgspec.Struct:
        """Read a message.

        Raises:
            MessageError: it is malformed.
        """
        return decode(
            sample.data, self._kinds[sample.channel], joint_count=self._robot.n_a
        )

    def latest(self) -> dict[str, msgspec.Struct]:
        """Return the newest message of each channel that has had any.

        Raises:
            MessageError: one is malformed.
        """
        newest = {sample.channel: sample for sample in self._drain()}
        return {name: self.decode(sample) for name, sample in newest.items()}

    def latest_messages(self) -> LatestMessages:
        """Return the newest message of each channel that a viewer shows.

        Without waiting; a message that cannot be read is passed over.
        """
        newest = {sample.channel: sample for sample in self._drain()}
        for name, sample in newest.items():
            with contextlib.suppress(MessageError):
                self._seen[name] = self.decode(sample)
        seen = {name: self._seen.get(name) for name in VIEWER_CHANNELS}
        return LatestMessages(**seen)  # type: ignore[arg-type]  # by the topic table

    def _drain(self) -> Iterator[Sample]:
        for name, ring in self._rings.items():
            # Bounded: a fast channel must not keep the others waiting for ever.
            for _ in range(self._depth):
                data = ring.poll()
                if data is None:
                    break
                yield Sample(name, data, time.monotonic_ns())

    def _open(self, stack: ExitStack, timeout_s: float) -> None:
        """Open the bus and declare everything, the liveliness token last.

        Declarations reach the robot in this order: a process that sees the token, or
        receives something on the last channel, knows that the robot sends the others.
        """
        bus = stack.enter_context(
            dialed_bus(self._endpoints, namespace=self._namespace, timeout_s=timeout_s)
        )
        keys = self._robot.keys
        self._rings = {
            name: bus.channel(keys[name], depth=self._depth) for name in self.channels
        }
        caller = ServiceCaller(
            bus.session,
            joint_count=self._robot.n_a,
            timeout_s=REQUEST_TIMEOUT_S,
            robot_is_here=self._robot_is_here.is_set,
        )
        self.requests = Requests(caller, self._robot, source=self._identity)
        bus.announce(self._token())
        self._watch_robot(bus, keys["status"], ALIVE_ROBOT)
        bus.watch_presence(f"{ALIVE_STABILIZER}/*", self._on_stabilizer)

    def _on_stabilizer(self, key: str, is_there: bool) -> None:
        identity = key.rsplit("/", 1)[-1]
        if is_there:
            self._stabilizers.add(identity)
        else:
            self._stabilizers.discard(identity)
