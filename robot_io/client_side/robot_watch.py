"""Which robot is on the bus, and whether it is the one that is meant."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable
from functools import partial

from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.errors import SecondRobotError
from surefoot.robot_io.identity import (
    RobotIdentity,
    check_description,
    describe,
    parse_token,
)
from surefoot.robot_io.robot import Robot
from surefoot.schemas.messages import ServiceReply
from surefoot.schemas.topics import ALIVE_ROBOT

CROWD_S = 2.0
"""Of two robots that start at once, one has given way by then."""
_POLL_S = 0.02


class RobotWatch:
    """Follows the liveliness tokens of a namespace's robot.

    There must be one, with the description that this process goes by. Whoever has a
    part in the bus holds what it finds against that: at the start (:meth:`find`), now
    and then (:meth:`check`), and at every answer (:meth:`check_reply`).

    Attributes:
        description: digest of our robot's description.
        found: who the robot is; None until it was found.
    """

    def __init__(
        self, robot: Robot, *, on_change: Callable[[], None] = lambda: None
    ) -> None:
        """Begin with nobody there.

        Args:
            robot: the one that is meant.
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
        """Watch on a bus from now on; what was seen on a former one is forgotten.

        Args:
            bus: open.
            prefix: the namespace and a slash on a bus without one.
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
        """Whether the robot that was found is there: the process, not its like."""
        return self.found is not None and self.found.instance in self._there

    def wait(self, timeout_s: float) -> bool:
        """Wait until a robot is there, at most so long [s]."""
        return self._is_somebody.wait(timeout_s)

    def find(self) -> RobotIdentity | None:
        """Wait until it is known who the robot is, and hold it against ours.

        Returns:
            Its identity; None when nobody is there any more.

        Raises:
            RobotMismatchError: its description is another one.
            SecondRobotError: there are two, and both stay.
        """
        self._bus.settle()
        pause = threading.Event()  # never set: what is waited for is that one leaves
        end_s = time.monotonic() + CROWD_S
        while len(self._there) > 1 and time.monotonic() < end_s:
            pause.wait(_POLL_S)
        there = tuple(self._there.values())
        self._hold_against_ours(there)
        self.found = there[0] if there else None
        return self.found

    def check(self) -> None:
        """Hold who is there now against ours, as far as tokens have come.

        Raises:
            RobotMismatchError: its description is another one.
            SecondRobotError: there have been two for a while.
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
        """Hold the answer of a robot's service against who was found.

        Raises:
            RobotMismatchError: its description is another one.
            SecondRobotError: another robot answers.
        """
        check_description(self._robot, self.description, reply.description)
        found = self.found
        if found is None or found.instance not in self._there:
            return  # started anew since: any robot of our description will do
        if reply.instance != found.instance:
            raise self._crowded((found.instance, reply.instance))

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
        """Take in that a robot has come or gone; on Zenoh's thread."""
        identity = parse_token(key)
        if is_there:
            there[identity.instance] = identity
        else:
            there.pop(identity.instance, None)
        if there is not self._there:
            return  # the last words of a bus that was left
        if there:
            self._is_somebody.set()
        else:
            self._is_somebody.clear()
        self._on_change()
