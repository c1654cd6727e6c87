"""Watches which robot is on the bus."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Iterable
from functools import partial

from surefoot.robot_io.bus.bus import TELL_S, Bus
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
from surefoot.schemas.messages import SCHEMA_VERSION, LeaseRequest, ServiceReply
from surefoot.schemas.topics import ALIVE_ROBOT

_LOG = logging.getLogger(__name__)
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
            "its robot file",
            namespace=namespace,
            instances=names,
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
