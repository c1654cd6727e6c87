"""Watches which robot is on the bus, and is the base of clients that only read."""

from __future__ import annotations

import contextlib
import logging
import math
import os
import secrets
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from functools import partial
from typing import NamedTuple, Self

from surefoot.robot_io.bus.bus import DIAL_S, TELL_S, Bus, dialed_bus
from surefoot.robot_io.bus.channel import Latest
from surefoot.robot_io.bus.session import unreachable
from surefoot.robot_io.errors import RobotUnreachableError, SecondRobotError
from surefoot.robot_io.identity import (
    RobotIdentity,
    check_description,
    describe,
    parse_token,
)
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot import Robot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    LeaseRequest,
    RobotStatus,
    ServiceReply,
)
from surefoot.schemas.topics import ALIVE_OBSERVER, ALIVE_ROBOT, ALIVE_STABILIZER

_LOG = logging.getLogger(__name__)
RETURN_S = 10.0
"""Longest wait for a robot that went away without a farewell [s]."""
CROWD_S = 2.0
"""Time after which one of two robots that start at once has given way [s]."""
_POLL_S = 0.02
STOP_POLL_S = 0.05
"""Period of checks for a stop request during a wait [s]."""


class RobotWatch:
    """Follows the liveliness tokens of a namespace's robot.

    There must be exactly one robot, with the description that this process uses. Each
    client compares the robot with its own description: at the start (:meth:`find`), now
    and then (:meth:`check`), and at every answer (:meth:`check_reply`).
    """

    def __init__(
        self, robot: Robot, *, on_change: Callable[[], None] = lambda: None
    ) -> None:
        """Begin with nobody there.

        Args:
            robot: the expected robot.
            on_change: called on Zenoh's thread when a robot comes or goes; must be
                quick.
        """
        self.description = describe(robot)
        self.found: RobotIdentity | None = None
        self._robot, self._on_change = robot, on_change
        self._there: dict[str, RobotIdentity] = {}
        self._is_somebody = threading.Event()
        self._crowd_since_s = math.inf

    def follow(self, bus: Bus, *, prefix: str = "") -> None:
        """Watch a bus from now on; forget what was seen on a former one.

        Args:
            bus: the open bus.
            prefix: the namespace and a slash, for a bus without a namespace.
        """
        self._bus = bus
        self._there = {}
        self._is_somebody.clear()
        bus.watch_presence(
            f"{prefix}{ALIVE_ROBOT}/**", partial(self._on_token, self._there)
        )

    @property
    def is_here(self) -> bool:
        """Whether there is a robot: the one that was found, or any before that."""
        return bool(self._there)

    @property
    def is_same(self) -> bool:
        """Whether the robot that was found is there: that process, not a restart."""
        return self.found is not None and self.found.instance in self._there

    def wait(self, timeout_s: float) -> bool:
        """Wait at most this time until a robot is there [s]."""
        return self._is_somebody.wait(timeout_s)

    def find(self) -> RobotIdentity | None:
        """Wait until the robot's identity is known, and compare it with ours.

        Returns:
            Its identity; None when no robot is there any more.

        Raises:
            RobotMismatchError: its description differs from ours.
            SecondRobotError: there are two robots, and both stay.
        """
        self._bus.settle()
        pause = threading.Event()  # never set: the wait is for one robot to leave
        end_s = time.monotonic() + CROWD_S
        while len(self._there) > 1 and time.monotonic() < end_s:
            pause.wait(_POLL_S)
        there = tuple(self._there.values())
        self._hold_against_ours(there)
        self.found = there[0] if there else None
        return self.found

    def find_within(
        self,
        end_s: float,
        *,
        endpoints: Endpoints,
        timeout_s: float,
        stop: StopRequest | None = None,
    ) -> RobotIdentity | None:
        """Wait until a robot is ready, and return its identity.

        Args:
            end_s: end of the wait on the monotonic clock [s].
            endpoints: where this process dialed, for the error.
            timeout_s: length of the whole wait, for the error [s].
            stop: ends the wait.

        Returns:
            Its identity; None when the wait was stopped.

        Raises:
            RobotUnreachableError: no robot was ready in time.
            RobotMismatchError: see :meth:`find`.
        """
        what = f"no robot {self._robot.file.namespace!r} is ready"
        begin_s, is_told = time.monotonic(), False
        while stop is None or not stop.is_set:
            now_s = time.monotonic()
            left_s = max(0.0, end_s - now_s)
            if self.wait(min(STOP_POLL_S, left_s)) and (found := self.find()):
                return found
            if left_s == 0.0:
                raise RobotUnreachableError(unreachable(endpoints, what, timeout_s))
            if now_s - begin_s >= TELL_S and not is_told:
                is_told = True
                words = unreachable(endpoints, what, round(now_s - begin_s))
                _LOG.warning("%s; still waiting", words)
        return None

    def check(self) -> None:
        """Compare the robots there now with ours, by the tokens received so far.

        Raises:
            RobotMismatchError: a robot's description differs from ours.
            SecondRobotError: there have been two robots for a while.
        """
        there = tuple(self._there.values())
        if len(there) > 1:
            now_s = time.monotonic()
            self._crowd_since_s = min(self._crowd_since_s, now_s)
            if now_s < self._crowd_since_s + CROWD_S:
                return
        else:
            self._crowd_since_s = math.inf
        self._hold_against_ours(there)

    def check_reply(self, reply: ServiceReply) -> None:
        """Compare the answer of a robot's service with the robot that was found.

        Raises:
            RobotMismatchError: its description differs from ours.
            SecondRobotError: another robot answers.
        """
        check_description(self._robot, self.description, reply.description)
        found = self.found
        if found is None or found.instance not in self._there:
            return  # started anew since: any robot with our description will do
        if reply.instance != found.instance:
            raise self._crowded((found.instance, reply.instance))

    def lease_request(
        self, action: str, commander: str, *, description: str = ""
    ) -> LeaseRequest:
        """Make a request for the lease of the robot that was found.

        Args:
            action: ``take`` or ``release``.
            commander: name of the process that asks.
            description: the robot description to send; ours when empty.
        """
        return LeaseRequest(
            schema=SCHEMA_VERSION,
            action=action,
            commander=commander,
            robot="" if self.found is None else self.found.instance,
            description=description or self.description,
        )

    def _hold_against_ours(self, there: Iterable[RobotIdentity]) -> None:
        who = tuple(there)
        if len(who) > 1:
            raise self._crowded(identity.instance for identity in who)
        for identity in who:
            check_description(self._robot, self.description, identity.description)

    def _crowded(self, instances: Iterable[str]) -> SecondRobotError:
        namespace, names = self._robot.file.namespace, sorted(instances)
        return SecondRobotError(
            f"{len(names)} robots {namespace!r} are on the bus (instances "
            f"{' and '.join(name or 'unknown' for name in names)}), and which one is "
            "meant cannot be told; stop one, or give it a `namespace` of its own in "
            "its robot file"
        )

    def _on_token(
        self, there: dict[str, RobotIdentity], key: str, is_there: bool
    ) -> None:
        """Record that a robot has come or gone; runs on Zenoh's thread."""
        identity = parse_token(key)
        if is_there:
            there[identity.instance] = identity
        else:
            there.pop(identity.instance, None)
        if there is not self._there:
            return  # a late report from a bus that was left
        if there:
            self._is_somebody.set()
        else:
            self._is_somebody.clear()
        self._on_change()


class Absences(NamedTuple):
    """Times when the robot was away without a farewell.

    Attributes:
        times: number of absences.
        total_s: their total length [s].
        is_lasting: whether the robot has not come back from the last one.
    """

    times: int
    total_s: float
    is_lasting: bool

    def __str__(self) -> str:
        """Return the absences in words; empty when there were none."""
        if not self.times:
            return ""
        times = "" if self.times == 1 else f" in {self.times} places"
        gone = " and did not come back" if self.is_lasting else ""
        span = f"{self.total_s:.1f} s or longer"  # noticed only after the lease
        return f"the link to the robot was lost for {span}{times}{gone}"


class ReadOnlyClient(ABC):
    """Dials a robot and knows whether it is there; has no part in its control.

    A robot that has gone has either ended or is unreachable for a while. After an end
    its last status says OFF or a fault, with nobody in command. Nothing is read from a
    robot whose description differs from ours.
    """

    _hears_all = False
    """Whether keys are as on the wire, with those of other namespaces."""

    def __init__(self, robot: Robot, *, endpoints: Endpoints) -> None:
        """Prepare; :meth:`connect` dials the robot."""
        self._robot, self._endpoints = robot, endpoints
        self._namespace = robot.file.namespace
        self._watch = RobotWatch(robot, on_change=self._on_change)
        self._was_here = False
        self._farewell: Latest[RobotStatus] | None = None
        self._is_over = self._is_cut_off = False
        self._lost_s: float | None = None
        self._absences: list[float] = []
        self._stabilizers: set[str] = set()
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        """Do nothing yet; see :meth:`connect`."""
        return self

    def __exit__(self, *why: object) -> None:
        """Close the bus; the robot's last status stays known."""
        self._hear_farewell()
        self._stack.close()

    def connect(self, *, timeout_s: float) -> None:
        """Dial until the robot is there and ready.

        Raises:
            EndpointError: a locator is malformed.
            RobotUnreachableError: no robot was ready in time.
            RobotMismatchError: the robot has another description, or there are two
                robots.
        """
        end = time.monotonic() + timeout_s
        with ExitStack() as stack:
            self._open(stack, timeout_s)
            self._stack = stack.pop_all()
        self._watch.find_within(end, endpoints=self._endpoints, timeout_s=timeout_s)

    @property
    def stabilizers(self) -> tuple[str, ...]:
        """Identities of the stabilizers on the bus."""
        return tuple(sorted(self._stabilizers))

    @property
    def robot_instance(self) -> str:
        """Name of the robot's process, once connected; a restart has another one."""
        return "" if self._watch.found is None else self._watch.found.instance

    @property
    def robot_is_here(self) -> bool:
        """Whether the robot's process is alive, according to the bus.

        Raises:
            RobotMismatchError: a robot with another description is there now, or a
                second robot, and stays.
        """
        self._watch.check()
        return self._watch.is_here

    def has_left(self) -> bool:
        """Return whether the robot has ended, or been away for too long to wait.

        While the robot is away, each call dials it anew.

        Raises:
            RobotMismatchError: see :attr:`robot_is_here`.
        """
        lost_s = self._lost_s
        if self.robot_is_here or lost_s is None:
            return False
        if self._said_farewell() or time.monotonic() - lost_s > RETURN_S:
            return True
        if self._is_cut_off:
            self._dial_anew()
        return False

    def _dial_anew(self) -> None:
        """Open another session.

        A session that was cut off would dial by itself. But on a link keys are numbers,
        and a robot that has not noticed the loss keeps the old ones. Its messages on
        one key would then arrive under another.
        """
        self._keep_unread()
        self._hear_farewell()
        self._stack.close()
        with contextlib.suppress(RobotUnreachableError), ExitStack() as stack:
            self._open(stack, DIAL_S)
            self._is_cut_off = False
            self._stack = stack.pop_all()

    def _keep_unread(self) -> None:  # noqa: B027  nothing to keep, for most
        """Take over unread messages before the session is closed."""

    @property
    def absences(self) -> Absences:
        """The robot's absences; an orderly end is none."""
        spans, lost_s = list(self._absences), self._lost_s
        is_lasting = lost_s is not None and not self._said_farewell()
        if is_lasting and lost_s is not None:
            spans.append(time.monotonic() - lost_s)
        return Absences(len(spans), sum(spans), is_lasting)

    def _hear_farewell(self) -> None:
        """Take over the robot's last status before the session is closed."""
        self._said_farewell()
        self._farewell = None

    def _said_farewell(self) -> bool:
        status = None if self._farewell is None else self._farewell.poll()
        if status is not None:
            self._is_over = status.is_farewell
        return self._is_over

    def _on_stabilizer(self, key: str, is_there: bool) -> None:
        identity = key.rsplit("/", 1)[-1]
        if is_there:
            self._stabilizers.add(identity)
        else:
            self._stabilizers.discard(identity)

    def _open(self, stack: ExitStack, timeout_s: float) -> None:
        """Open the bus and declare everything; our own liveliness token comes last.

        Declarations reach the robot in this order: a process that sees the token, or
        receives a message on the last channel, knows that the robot sends the others.
        The presence of the robot and of stabilizers is watched from then on.
        """
        prefix = f"{self._namespace}/" if self._hears_all else ""
        bus = stack.enter_context(
            dialed_bus(
                self._endpoints,
                namespace="" if self._hears_all else self._namespace,
                timeout_s=timeout_s,
            )
        )
        self._declare(bus)
        token = f"{os.getpid()}-{secrets.token_hex(4)}"
        bus.announce(f"{prefix}{ALIVE_OBSERVER}/{token}")
        status = bus.channel(f"{prefix}{self._robot.keys['status']}", depth=1)
        self._farewell = Latest(status, RobotStatus, joint_count=self._robot.n_a)
        self._watch.follow(bus, prefix=prefix)
        bus.watch_presence(f"{prefix}{ALIVE_STABILIZER}/*", self._on_stabilizer)

    @abstractmethod
    def _declare(self, bus: Bus) -> None:
        """Declare publishers and channels on an open bus."""

    def _on_change(self) -> None:
        """Record that a robot has come or gone; runs on Zenoh's thread."""
        if self._watch.is_here:
            if self._lost_s is not None:
                self._absences.append(time.monotonic() - self._lost_s)
            self._lost_s = None
            self._was_here = True
        elif self._was_here:
            self._is_cut_off = True
            self._lost_s = time.monotonic()
            self._was_here = False
