"""Services of the stabilizer: change of gains, hold and resume."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import zenoh

from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.robot import Robot
from surefoot.schemas.codec import decode, encode
from surefoot.schemas.errors import MessageError
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    ControlRequest,
    SettingsRequest,
    StabilizerReply,
)
from surefoot.schemas.reasons import RequestRefusal

REQUESTS_KEPT = 64
"""Requests that may wait; beyond it the oldest are dropped, unanswered."""

Request = SettingsRequest | ControlRequest


class Asked(NamedTuple):
    """A request that waits for its answer.

    Attributes:
        request: what is asked.
        query: to be answered through :meth:`reply`.
    """

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
            tick: from which on it counts.
            settings: what may change during a run, with values.
            refusal: why not; ``none`` when it was done.
            detail: the same in words.
        """
        _reply(self.query, refusal=refusal, detail=detail, tick=tick, settings=settings)


class StabilizerServices:
    """Queues what comes in on Zenoh's threads; the stabilizer's loop answers it.

    So the controller is only ever touched by one thread, between two ticks.
    """

    def __init__(self, bus: Bus, robot: Robot) -> None:
        """Declare the services.

        Args:
            bus: the stabilizer's.
            robot: names the keys.
        """
        self._queue: deque[tuple[type[Request], zenoh.Query]]
        self._queue = deque(maxlen=REQUESTS_KEPT)
        bus.queryable(
            robot.keys["settings"], lambda q: self._queue.append((SettingsRequest, q))
        )
        bus.queryable(
            robot.keys["control"], lambda q: self._queue.append((ControlRequest, q))
        )

    def next(self) -> Asked | None:
        """Return the next request; None when there is none, which costs nothing."""
        while self._queue:
            kind, query = self._queue.popleft()
            payload = query.payload
            try:
                data = b"" if payload is None else payload.to_bytes()
                return Asked(decode(data, kind), query)
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
