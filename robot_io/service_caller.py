"""Asks the robot for something and waits for its answer."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TypeVar

import msgspec
import zenoh

from robot_io.errors import RequestRefusedError, RobotUnreachableError
from schemas.codec import decode, encode
from schemas.messages import ServiceReply, StabilizerReply

RETRY_PAUSE_S = 0.01
R = TypeVar("R", ServiceReply, StabilizerReply)


class ServiceCaller:
    """Calls the robot's services; every call has a limit."""

    def __init__(
        self,
        session: zenoh.Session,
        *,
        joint_count: int,
        timeout_s: float,
        robot_is_here: Callable[[], bool],
    ) -> None:
        """Calls through a session.

        Args:
            session: an open session.
            joint_count: n_a.
            timeout_s: how long a call may take [s].
            robot_is_here: asked before a call is tried again.
        """
        self._session = session
        self._joint_count = joint_count
        self._timeout_s = timeout_s
        self._robot_is_here = robot_is_here
        self._pause = threading.Event()

    def ask(
        self, key: str, request: msgspec.Struct, *, timeout_s: float | None = None
    ) -> ServiceReply:
        """Asks, again while the service is not known yet.

        Args:
            key: of the service, relative to the namespace.
            request: what to ask.
            timeout_s: limit of this call; the usual one when None [s].

        Returns:
            The robot's answer, which accepts.

        Raises:
            RequestRefusedError: the robot says no.
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
        """Asks a service whose answer is of another kind; see :meth:`ask`."""
        limit_s = self._timeout_s if timeout_s is None else timeout_s
        end = time.monotonic() + limit_s
        while (remaining_s := end - time.monotonic()) > 0:
            data = self._ask_once(key, encode(request), remaining_s)
            if data is not None:
                reply = decode(data, kind, joint_count=self._joint_count)
                if not reply.accepted:
                    raise RequestRefusedError(
                        f"{key}: refused {request}: {reply.reason}",
                        reason=reply.reason,
                    )
                return reply
            if not self._robot_is_here():
                raise RobotUnreachableError(f"{key}: the robot went away, unanswered")
            self._pause.wait(RETRY_PAUSE_S)
        raise RobotUnreachableError(
            f"{key}: no answer from the robot within {limit_s:g} s; it may "
            "hang, or be about to end"
        )

    def _ask_once(self, key: str, data: bytes, timeout_s: float) -> bytes | None:
        for reply in self._session.get(key, payload=data, timeout=timeout_s):
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
        return None
