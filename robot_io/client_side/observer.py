"""Read-only clients of a robot's bus: recorders, viewers, tools."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import msgspec

from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.bus.channel import Channel
from surefoot.robot_io.client_side.requests import Requests, ServiceCaller
from surefoot.robot_io.client_side.robot_watch import ReadOnlyClient
from surefoot.robot_io.robot import Robot
from surefoot.schemas.codec import decode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.errors import MessageError
from surefoot.schemas.messages import (
    ImuState,
    JointState,
    RobotStatus,
    StabilizerStatus,
    Truth,
)
from surefoot.schemas.topics import ALL_CHANNELS, topic
from surefoot.schemas.walk_plan import WalkStatus

REQUEST_TIMEOUT_S = 2.0
POLL_S = 0.002
"""Polling period of a wait [s]: fine enough for viewers, cheap when idle."""


class LatestMessages(NamedTuple):
    """Newest message of each channel that a viewer shows; None before the first."""

    joints: JointState | None = None
    imu: ImuState | None = None
    status: RobotStatus | None = None
    stabilizer: StabilizerStatus | None = None
    truth: Truth | None = None
    walk_status: WalkStatus | None = None


VIEWER_CHANNELS = LatestMessages._fields
"""Their names are those of the topic table."""


class Sample(NamedTuple):
    """One received message, not decoded.

    Attributes:
        channel: its name in the topic table.
        data: MessagePack bytes.
        received_ns: this process's monotonic clock when the message was taken [ns].
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

    A recorder takes every message. A viewer looks at its own pace: with ``depth=1``
    only the newest message of each channel is kept::

        with Observer(robot, endpoints=endpoints, channels=VIEWER_CHANNELS) as observer:
            observer.connect(timeout_s=10.0)
            sight = observer.latest_messages()
            observer.requests.stop_robot()

    Attributes:
        channels: names of the channels it subscribes to.
        requests: the requests open to an observer; set once connected.
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
            robot: has the names of keys and joints.
            endpoints: where to dial.
            channels: names from the topic table, subscribed to in this order.
            depth: messages kept per channel until taken; the oldest are dropped.
            identity: name of this observer in the robot's log when it asks.
        """
        super().__init__(robot, endpoints=endpoints)
        self._identity = identity
        self.channels = tuple(channels)
        self._depth = depth
        self._kinds: dict[str, type[msgspec.Struct]] = {
            name: topic(name).message for name in self.channels
        }
        self._rings: dict[str, Channel] = {}
        self._unread: list[Sample] = []
        self._seen: dict[str, msgspec.Struct] = {}
        self._has_another = False

    def take(self, *, timeout_s: float = 0.0) -> list[Sample]:
        """Return all messages received so far, channel by channel, each in order.

        Returns:
            The messages; empty when none came in time.
        """
        end = time.monotonic() + timeout_s
        while True:
            samples = list(self._drain())
            if samples or time.monotonic() >= end:
                return samples
            time.sleep(min(POLL_S, timeout_s))  # many channels: none to wait on

    def decode(self, sample: Sample) -> msgspec.Struct:
        """Read a message.

        Raises:
            MessageError: the message is malformed.
        """
        return decode(
            sample.data, self._kinds[sample.channel], joint_count=self._robot.n_a
        )

    def latest(self) -> dict[str, msgspec.Struct]:
        """Return the newest message of each channel that has received any.

        Raises:
            MessageError: a message is malformed.
        """
        newest = {sample.channel: sample for sample in self._drain()}
        return {name: self.decode(sample) for name, sample in newest.items()}

    def latest_messages(self) -> LatestMessages:
        """Return the newest message of each channel that a viewer shows.

        It does not wait, and skips messages that cannot be read. A stabilizer's walk
        status is dropped once another stabilizer has come.
        """
        newest = {sample.channel: sample for sample in self._drain()}
        if self._has_another:
            self._has_another = False
            self._seen.pop("walk_status", None)
            newest.pop("walk_status", None)
        for name, sample in newest.items():
            with contextlib.suppress(MessageError):
                self._seen[name] = self.decode(sample)
        seen = {name: self._seen.get(name) for name in VIEWER_CHANNELS}
        return LatestMessages(**seen)  # type: ignore[arg-type]  # by the topic table

    def _on_stabilizer(self, key: str, is_there: bool) -> None:
        self._has_another |= is_there  # first: the callback below may look at once
        super()._on_stabilizer(key, is_there)

    def _keep_unread(self) -> None:
        self._unread += list(self._drain())
        self._rings.clear()

    def _drain(self) -> Iterator[Sample]:
        unread, self._unread = self._unread, []
        yield from unread
        for name, ring in self._rings.items():
            # Bounded: a fast channel must not keep the others waiting for ever.
            for _ in range(self._depth):
                data = ring.poll()
                if data is None:
                    break
                yield Sample(name, data, time.monotonic_ns())

    def _declare(self, bus: Bus) -> None:
        keys = self._robot.keys
        self._rings = {
            name: bus.channel(keys[name], depth=self._depth) for name in self.channels
        }
        caller = ServiceCaller(
            bus.session,
            joint_count=self._robot.n_a,
            timeout_s=REQUEST_TIMEOUT_S,
            robot_is_here=lambda: self._watch.is_here,
            check=self._watch.check_reply,
        )
        self.requests = Requests(caller, self._robot, source=self._identity)
