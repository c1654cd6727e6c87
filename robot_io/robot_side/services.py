"""The robot's services, answered between ticks, and its unique place on the bus."""

from __future__ import annotations

import logging
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from typing import NamedTuple, Self

import zenoh

from surefoot.robot_io.bus.bus import Bus, bytes_of
from surefoot.robot_io.bus.session import Role
from surefoot.robot_io.errors import SecondRobotError
from surefoot.robot_io.identity import (
    SAME_FILE,
    RobotIdentity,
    differing,
    new_identity,
    parse_token,
)
from surefoot.robot_io.realtime import Pace, StopRequest
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.mode_machine import Answer
from surefoot.schemas.codec import decode, encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.errors import MessageError
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    EstopRequest,
    LeaseRequest,
    ModeRequest,
    PushRequest,
    ServiceReply,
)
from surefoot.schemas.reasons import ModeCause, RequestRefusal
from surefoot.schemas.topics import ALIVE_ROBOT, ALIVE_STABILIZER

_LOG = logging.getLogger(__name__)

PATIENCE_S = 3.0
"""Least wait for a dead robot's token to vanish: the bus must give its host up [s]."""
LEASES = 2
"""The wait is at least this many leases of the bus."""
YIELD_S = 2.0
"""Time within which another robot that must give way has done so [s]."""
POLL_S = 0.02
Instance = str
Instances = list[Instance]
MODE_ACTIONS = ("enable", "hold", "disable", "reset")
LEASE_ACTIONS = ("take", "release")


class RobotsSide(ABC):
    """Base of the robot's side of the bus: listens, and takes the robot's place.

    A context manager, used by one thread.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        endpoints: Endpoints,
        stop: StopRequest,
        pace: Pace = Pace.REALTIME,
    ) -> None:
        """Prepare; entering the context opens the bus."""
        self._robot, self._stop, self._pace = robot, stop, pace
        self.identity = new_identity(robot)
        self._lease_ms = endpoints.lease_ms
        self._bus = Bus(
            endpoints,
            Role.ROBOT,
            namespace=robot.file.namespace,
            keys=robot.keys,
            pace=pace,
        )
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        """Open the bus; on return the robot's liveliness token is visible.

        Raises:
            EndpointError: Zenoh cannot listen there.
            SecondRobotError: another robot of its namespace is on the bus.
        """
        with ExitStack() as stack:
            stack.enter_context(self._bus)
            self._declare()
            take_place(
                self._bus,
                self._robot,
                self.identity,
                lease_ms=self._lease_ms,
                stop=self._stop,
            )
            self._stack = stack.pop_all()
        self._stop.waking(self._bus.waker.interrupt)
        return self

    def __exit__(self, *why: object) -> None:
        """Close the bus."""
        self._stack.close()

    def _say_farewell(self, status: bytes) -> None:
        """Publish the last status; who misses it waits for the robot to come back."""
        self._bus.deliver(self._robot.keys["status"], status)

    @abstractmethod
    def _declare(self) -> None:
        """Declare everything but the liveliness token."""


def take_place(
    bus: Bus,
    robot: Robot,
    identity: RobotIdentity,
    *,
    lease_ms: int,
    stop: StopRequest,
) -> None:
    """Declare the robot's liveliness token, unless another robot has one.

    It looks for others before, patiently, since a dead robot's token may remain, and
    after. Of two robots that start at once at least one sees the other, and the one
    with the greater instance gives way.

    Args:
        bus: open, with everything else declared.
        robot: has the namespace.
        identity: identity of this process.
        lease_ms: silence after which the bus gives a peer up [ms].
        stop: ends the wait; then nothing is declared.

    Raises:
        SecondRobotError: there is another robot, and it stays.
    """
    there: set[str] = set()

    def on_token(key: str, is_there: bool) -> None:
        (there.add if is_there else there.discard)(parse_token(key).instance)

    def others() -> Instances:
        return sorted(there.copy() - {identity.instance})

    bus.watch_presence(f"{ALIVE_ROBOT}/**", on_token)
    bus.settle()
    if others():
        _LOG.warning(
            "a robot %r is on the bus (instance %s); waiting for it to go",
            *(robot.file.namespace, ", ".join(others())),
        )
    patience_s = max(PATIENCE_S, LEASES * lease_ms / 1e3)
    _refuse_beside(_who_stays(others, patience_s, stop), robot, identity)
    if stop.is_set:
        return
    bus.announce(identity.token)
    bus.settle()
    # A robot that sees a lesser instance goes at once, even while it waits for greater
    # ones. Otherwise the least could lose patience together with them: none would stay.
    came = _who_stays(others, YIELD_S, stop, before=identity.instance)
    _refuse_beside(came, robot, identity)


def _who_stays(
    others: Callable[[], Instances],
    patience_s: float,
    stop: StopRequest,
    *,
    before: Instance = "",
) -> Instances:
    """Return who is there when patience ends, or when a lesser instance is there."""
    pause = threading.Event()  # never set: no event tells that another has left
    end_s = time.monotonic() + patience_s
    while there := others():
        is_less = any(instance < before for instance in there)
        if is_less or stop.is_set or time.monotonic() >= end_s:
            break
        pause.wait(POLL_S)
    return there


def _refuse_beside(others: Instances, robot: Robot, identity: RobotIdentity) -> None:
    if not others:
        return
    namespace, names = robot.file.namespace, " and ".join(others)
    raise SecondRobotError(
        f"a robot {namespace!r} is on this bus already (instance {names or 'unknown'}; "
        f"this one would be {identity.instance}), and both would obey the same "
        "commands; stop that one, or give this one a `namespace` of its own in its "
        "robot file"
    )


class _Asked(NamedTuple):
    """A query and the function that answers it."""

    query: zenoh.Query
    answer: Callable[[bytes, float], Answer]


class RobotServices:
    """Queues requests from Zenoh's threads; the robot's loop answers them.

    So only one thread ever touches the gate. Stabilizers that go are queued the same
    way: one that dies loses the lease at once.
    """

    def __init__(
        self,
        bus: Bus,
        robot: Robot,
        gate: CommandGate,
        *,
        identity: RobotIdentity,
        push: Callable[[PushRequest], Answer] | None = None,
        pace: Pace,
    ) -> None:
        """Declare the services.

        Args:
            bus: the robot's bus.
            robot: has the names of the keys.
            gate: answers requests.
            identity: this robot's identity, sent with every answer; a request to take
                the lease must name it.
            push: answers pushes; None on a robot that is not simulated.
            pace: sent with every answer.
        """
        self._identity = identity
        self._push = push
        self._pace = pace
        self._bus = bus
        self._gate = gate
        self._asked: deque[_Asked] = deque()
        self._gone: deque[str] = deque()
        self._present: set[str] = set()
        self._something_came = threading.Event()
        for name, answer in (
            ("mode", self._answer_mode),
            ("lease", self._answer_lease),
            ("estop", self._answer_estop),
        ):
            bus.queryable(robot.keys[name], self._queue_for(answer))
        if push is not None:
            bus.queryable(robot.keys["push"], self._queue_for(self._answer_push))
        bus.watch_presence(f"{ALIVE_STABILIZER}/*", self._on_presence)

    def wait(self, timeout_s: float) -> None:
        """Wait until something comes in, at most this long [s]."""
        self._something_came.wait(timeout_s)

    def is_present(self, who: str) -> bool:
        """Return whether a stabilizer of this name is on the bus."""
        return who in self._present

    def serve(self, *, now_s: float) -> bool:
        """Answer everything that has come in.

        Args:
            now_s: the robot's time [s].

        Returns:
            Whether anything had come in.
        """
        if not self._asked and not self._gone:
            return False
        self._something_came.clear()
        while self._gone:
            who = self._gone.popleft()
            if self._gate.modes.holds_lease(who):
                self._gate.modes.lose(ModeCause.COMMANDER_GONE, f"{who} is gone")
        while self._asked:
            asked = self._asked.popleft()
            with asked.query as query:
                try:
                    answer = asked.answer(bytes_of(query), now_s)
                except MessageError as error:
                    answer = Answer(RequestRefusal.MALFORMED, str(error))
                self._reply(query, answer)
        return True

    def _queue_for(
        self, answer: Callable[[bytes, float], Answer]
    ) -> Callable[[zenoh.Query], None]:
        def on_query(query: zenoh.Query) -> None:
            self._asked.append(_Asked(query, answer))
            self._notice()

        return on_query

    def _on_presence(self, key: str, is_there: bool) -> None:
        who = key.rsplit("/", 1)[-1]
        if is_there:
            self._present.add(who)
        else:
            self._present.discard(who)
            self._gone.append(who)
            self._notice()

    def _notice(self) -> None:
        self._something_came.set()
        self._bus.waker.interrupt()

    def _answer_mode(self, data: bytes, now_s: float) -> Answer:
        asked = decode(data, ModeRequest)
        if asked.action not in MODE_ACTIONS:
            return _unknown(asked.action, MODE_ACTIONS)
        return self._gate.request(asked.action, asked.commander, now_s=now_s)

    def _answer_lease(self, data: bytes, now_s: float) -> Answer:
        asked = decode(data, LeaseRequest)
        if asked.action not in LEASE_ACTIONS:
            return _unknown(asked.action, LEASE_ACTIONS)
        if asked.action == "take" and (why := self._why_not_meant(asked)):
            return self._gate.modes.decline(RequestRefusal.WRONG_ROBOT, why)
        return self._gate.request(asked.action, asked.commander, now_s=now_s)

    def _why_not_meant(self, asked: LeaseRequest) -> str:
        """Return why a would-be commander means another robot; empty if this one."""
        parts = differing(self._identity.description, asked.description)
        who = asked.commander or "a commander without a name"
        if parts:
            words = ", ".join(parts)
            return f"{who}: its robot description differs in: {words}; {SAME_FILE}"
        if asked.robot != self._identity.instance:
            return (
                f"{who} means the robot of instance {asked.robot or 'unknown'}, this "
                f"one is {self._identity.instance}; stop one of the two, or start "
                "the commander again if this one was started anew"
            )
        return ""

    def _answer_estop(self, data: bytes, now_s: float) -> Answer:
        """Stop even if the request cannot be read: its sender meant a stop."""
        del now_s
        try:
            source = decode(data, EstopRequest).source
        except MessageError:
            source = "an unreadable request"
        return self._gate.modes.stop(source)

    def _answer_push(self, data: bytes, now_s: float) -> Answer:
        del now_s
        if self._push is None:
            return Answer(RequestRefusal.NOT_SUPPORTED, "this robot is not simulated")
        return self._push(decode(data, PushRequest))

    def _reply(self, query: zenoh.Query, answer: Answer) -> None:
        modes = self._gate.modes
        reply = ServiceReply(
            schema=SCHEMA_VERSION,
            accepted=answer.accepted,
            refusal=answer.refusal,
            detail=answer.detail,
            mode=modes.mode,
            commander=modes.lease.holder,
            q_command=self._gate.posture.tolist(),
            instance=self._identity.instance,
            description=self._identity.description,
            pace=self._pace,
        )
        query.reply(query.key_expr, encode(reply))


def _unknown(action: str, known: tuple[str, ...]) -> Answer:
    return Answer(
        RequestRefusal.UNKNOWN_ACTION,
        f"got action {action!r}, expected {', '.join(known)}",
    )
