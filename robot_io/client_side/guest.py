"""Clients without the lease: recorders, viewers, tools and planners.

They know whether their robot is there, and have no part in its control.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import time
from abc import ABC, abstractmethod
from contextlib import ExitStack
from typing import NamedTuple, Self

from surefoot.robot_io.bus.bus import DIAL_S, Bus, dialed_bus
from surefoot.robot_io.bus.channel import Latest
from surefoot.robot_io.client_side.robot_watch import RobotWatch
from surefoot.robot_io.errors import RobotUnreachableError
from surefoot.robot_io.robot import Robot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode, RobotStatus
from surefoot.schemas.reasons import ModeCause
from surefoot.schemas.topics import ALIVE_OBSERVER, ALIVE_STABILIZER

RETURN_S = 10.0
"""Longest wait for a robot that went away without a farewell [s]."""


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


class GuestClient(ABC):
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
            # A robot that ends has no commander; one in fault stays in fault.
            self._is_over = not status.commander and (
                status.mode is RobotMode.FAULT
                or (
                    status.mode is RobotMode.OFF
                    and status.cause is not ModeCause.REQUESTED
                )
            )
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
