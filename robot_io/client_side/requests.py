"""Requests to a robot and its stabilizer: their callers, and the stabilizer's queue."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import msgspec
import zenoh

from surefoot.robot_io.bus.bus import Bus, bytes_of
from surefoot.robot_io.bus.channel import Latest
from surefoot.robot_io.bus.session import cause_of
from surefoot.robot_io.client_side.robot_watch import ReadOnlyClient
from surefoot.robot_io.errors import RequestRefusedError, RobotUnreachableError
from surefoot.robot_io.robot import Robot
from surefoot.schemas.codec import decode, encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.errors import MessageError
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    ControlRequest,
    EstopRequest,
    PushRequest,
    RobotStatus,
    ServiceReply,
    SettingsRequest,
    StabilizerReply,
)
from surefoot.schemas.reasons import RequestRefusal
from surefoot.schemas.walk_plan import WalkPlan, WalkStatus

RETRY_PAUSE_S = 0.01
R = TypeVar("R", ServiceReply, StabilizerReply)
REQUESTS_KEPT = 64
"""Requests that may wait; beyond that the oldest are dropped, unanswered."""
Request = SettingsRequest | ControlRequest


class ServiceCaller:
    """Calls the robot's services; every call has a time limit."""

    def __init__(
        self,
        session: zenoh.Session,
        *,
        joint_count: int,
        timeout_s: float,
        robot_is_here: Callable[[], bool],
        check: Callable[[ServiceReply], None],
    ) -> None:
        """Call through a session.

        Args:
            session: an open session.
            joint_count: number of joints n_a.
            timeout_s: longest time of a call [s].
            robot_is_here: asked before a call is repeated.
            check: raises when another robot than the expected one answers. It is not
                used for an e-stop, which any robot that hears it obeys.
        """
        self._session = session
        self._joint_count = joint_count
        self._timeout_s = timeout_s
        self._robot_is_here = robot_is_here
        self._check = check
        self._pause = threading.Event()

    def ask(
        self, key: str, request: msgspec.Struct, *, timeout_s: float | None = None
    ) -> ServiceReply:
        """Send a request; repeat it while the service is not known yet.

        Args:
            key: key of the service, relative to the namespace.
            request: the request to send.
            timeout_s: limit of this call; the usual one when None [s].

        Returns:
            The robot's answer; it accepted the request.

        Raises:
            RequestRefusedError: the robot refuses.
            RobotMismatchError: another robot than the expected one answers.
            RobotUnreachableError: nobody answered in time.
            MessageError: the answer cannot be read.
        """
        return self.ask_for(key, request, ServiceReply, timeout_s=timeout_s)

    def ask_for(
        self,
        key: str,
        request: msgspec.Struct,
        kind: type[R],
        *,
        timeout_s: float | None = None,
    ) -> R:
        """Call a service whose answer has another type; see :meth:`ask`."""
        limit_s = self._timeout_s if timeout_s is None else timeout_s
        end = time.monotonic() + limit_s
        while (remaining_s := end - time.monotonic()) > 0:
            data = self._ask_once(key, encode(request), remaining_s)
            if data is not None:
                reply = decode(data, kind, joint_count=self._joint_count)
                if isinstance(reply, ServiceReply) and not isinstance(
                    request, EstopRequest
                ):
                    self._check(reply)
                if not reply.accepted:
                    what = getattr(request, "action", type(request).__name__)
                    raise RequestRefusedError(
                        f"{key}: {what} refused: {reply.detail}",
                        refusal=reply.refusal,
                        detail=reply.detail,
                    )
                return reply
            if not self._robot_is_here():
                raise RobotUnreachableError(f"{key}: the robot went away, unanswered")
            self._pause.wait(RETRY_PAUSE_S)
        raise RobotUnreachableError(
            f"{key}: no answer within {limit_s:g} s; who would answer may hang, or be "
            "about to end; on a bus with certificates, ours may not be one that may ask"
        )

    def _ask_once(self, key: str, data: bytes, timeout_s: float) -> bytes | None:
        try:
            for reply in self._session.get(key, payload=data, timeout=timeout_s):
                if reply.ok is not None:
                    return reply.ok.payload.to_bytes()
        except zenoh.ZError as error:
            why = f"{key}: not asked: {cause_of(error)}"
            raise RobotUnreachableError(why) from error
        return None


class Requests:
    """Requests that need no lease; with TLS, the certificate decides who may send them.

    The e-stop is open to everyone; the others need an operator's certificate.
    """

    def __init__(self, caller: ServiceCaller, robot: Robot, *, source: str) -> None:
        """Send requests through a caller."""
        self._caller, self._robot, self._source = caller, robot, source

    def stop_robot(self) -> ServiceReply:
        """Press the e-stop; open to everyone.

        Raises:
            RobotUnreachableError: no answer.
        """
        request = EstopRequest(schema=SCHEMA_VERSION, source=self._source)
        return self._ask("estop", request, ServiceReply)

    def push(
        self, body: str, force_n: list[float], *, duration_s: float
    ) -> ServiceReply:
        """Push a simulated robot.

        Args:
            body: link of the URDF that is pushed.
            force_n: (3,) force in world axes [N].
            duration_s: duration of the push [s].

        Raises:
            RequestRefusedError: no such body, or the push is too strong.
            RobotUnreachableError: no reply; only simulated robots accept pushes.
        """
        request = PushRequest(
            schema=SCHEMA_VERSION,
            source=self._source,
            body=body,
            force_n=force_n,
            duration_s=duration_s,
        )
        return self._ask("push", request, ServiceReply)

    def control(self, action: str) -> StabilizerReply:
        """Ask the stabilizer to ``hold`` or ``resume``.

        Raises:
            RequestRefusedError: the stabilizer refuses; the message has its reason.
            RobotUnreachableError: no answer.
        """
        request = ControlRequest(
            schema=SCHEMA_VERSION, source=self._source, action=action
        )
        return self._ask("control", request, StabilizerReply)

    def change_settings(self, changes: dict[str, list[float]]) -> StabilizerReply:
        """Ask the stabilizer for other gains; without changes, for the present ones.

        Raises:
            RequestRefusedError: a value cannot be used, or none can be changed.
            RobotUnreachableError: no answer.
        """
        request = SettingsRequest(
            schema=SCHEMA_VERSION, source=self._source, changes=changes
        )
        return self._ask("settings", request, StabilizerReply)

    def _ask(self, name: str, request: msgspec.Struct, kind: type[R]) -> R:
        return self._caller.ask_for(self._robot.keys[name], request, kind)


class Asked(NamedTuple):
    """A request that waits for its answer."""

    request: Request
    query: zenoh.Query

    def reply(
        self,
        *,
        tick: int,
        settings: dict[str, list[float]],
        refusal: RequestRefusal = RequestRefusal.NONE,
        detail: str = "",
    ) -> None:
        """Send the answer, once.

        Args:
            tick: first tick at which the change counts.
            settings: settings that may change during a run, with their values.
            refusal: reason of a refusal; ``none`` when the request was carried out.
            detail: the same in words.
        """
        _reply(self.query, refusal=refusal, detail=detail, tick=tick, settings=settings)


class StabilizerServices:
    """Queues requests from Zenoh's threads; the stabilizer's loop answers them.

    So only one thread ever touches the controller, between two ticks.
    """

    def __init__(self, bus: Bus, robot: Robot) -> None:
        """Declare the services."""
        self._queue: deque[tuple[type[Request], zenoh.Query]]
        self._queue = deque(maxlen=REQUESTS_KEPT)
        bus.queryable(
            robot.keys["settings"], lambda q: self._queue.append((SettingsRequest, q))
        )
        bus.queryable(
            robot.keys["control"], lambda q: self._queue.append((ControlRequest, q))
        )

    def next(self) -> Asked | None:
        """Return the next request; None, at no cost, when there is none."""
        while self._queue:
            kind, query = self._queue.popleft()
            try:
                return Asked(decode(bytes_of(query), kind), query)
            except MessageError as error:
                refusal = RequestRefusal.MALFORMED
                _reply(query, refusal=refusal, detail=str(error), tick=0, settings={})
        return None


def _reply(
    query: zenoh.Query,
    *,
    refusal: RequestRefusal,
    detail: str,
    tick: int,
    settings: dict[str, list[float]],
) -> None:
    reply = StabilizerReply(
        schema=SCHEMA_VERSION,
        accepted=refusal is RequestRefusal.NONE,
        refusal=refusal,
        detail=detail,
        tick=tick,
        settings=settings,
    )
    with query:
        query.reply(query.key_expr, encode(reply))


class PlannerClient(ReadOnlyClient):
    """Sends plans to the stabilizer that commands the robot.

    A context manager, used by one thread. It commands nothing: the stabilizer decides
    which steps of a plan it takes, and reports them in the walk's status.
    """

    def __init__(self, robot: Robot, *, endpoints: Endpoints) -> None:
        """Prepare; :meth:`connect` dials."""
        super().__init__(robot, endpoints=endpoints)
        self._status: Latest[WalkStatus] | None = None
        self._plan: zenoh.Publisher | None = None

    def status(self) -> WalkStatus | None:
        """Return the newest status of the walk; None before the first.

        The status of a stabilizer that has gone is dropped.
        """
        if self._status is None:
            return None
        if not self._stabilizers:
            self._status.forget()
        return self._status.poll()

    def robot_status(self) -> RobotStatus | None:
        """Return the robot's newest status; None before the first."""
        return None if self._farewell is None else self._farewell.poll()

    def send(self, plan: WalkPlan) -> None:
        """Send a plan. It may get lost, so the caller repeats a plan that matters."""
        if self._plan is not None:
            self._plan.put(encode(plan))

    def _declare(self, bus: Bus) -> None:
        keys = self._robot.keys
        status = bus.channel(keys["walk_status"], depth=1)
        self._status = Latest(status, WalkStatus)
        self._plan = bus.publisher(keys["walk"], urgent=False)
