"""Carries the requests to one service to the other side, and the answers back."""

from __future__ import annotations

import threading
import time
from functools import partial

import zenoh
from zenoh.handlers import Callback

from robot_io.bus import Bus
from robot_io.relay.dispatcher import Dispatcher
from robot_io.relay.lane import Lane
from robot_io.relay.plan_clock import PlanClock

ANSWER_S = 5.0
"""How long the service may take to answer [s]."""


class ServiceForwarder:
    """Answers queries on one side with what the service on the other side answers.

    A request that is lost stays unanswered, as if the service were not there yet: who
    asks does so again.
    """

    def __init__(
        self,
        key: str,
        *,
        source: Bus,
        target: Bus,
        lane: Lane,
        dispatcher: Dispatcher,
        clock: PlanClock,
    ) -> None:
        """Begins to carry.

        Args:
            key: of the service, relative to the namespace.
            source: where it is asked.
            target: where it answers.
            lane: what becomes of its requests.
            dispatcher: asks.
            clock: of the plan.
        """
        self._key, self._target = key, target
        self._lane, self._dispatcher, self._clock = lane, dispatcher, clock
        source.queryable(key, self._on_query)

    def _on_query(self, query: zenoh.Query) -> None:
        now_s = time.monotonic()
        payload = query.payload
        parcels = self._lane.pass_on(
            b"" if payload is None else payload.to_bytes(),
            now_s=now_s,
            elapsed_s=self._clock.elapsed_s(now_s),
        )
        open_query = _OpenQuery(query, asks=len(parcels))
        for parcel in parcels:
            # Never from here: this is the thread that would have to hear the answer.
            self._dispatcher.do(
                partial(self._ask, parcel.data, open_query), at_s=parcel.at_s
            )

    def _ask(self, data: bytes, query: _OpenQuery) -> None:
        self._target.session.get(
            self._key,
            Callback(query.answer, query.end_one, indirect=False),
            payload=data,
            timeout=ANSWER_S,
        )


class _OpenQuery:
    """A query that stays open until all that was asked for it has been answered."""

    def __init__(self, query: zenoh.Query, *, asks: int) -> None:
        self._query = query
        self._asks = asks
        self._lock = threading.Lock()
        if asks == 0:
            # Zenoh gives this method no types.
            query.drop()  # type: ignore[no-untyped-call]

    def answer(self, reply: zenoh.Reply) -> None:
        """Hands an answer back."""
        if reply.ok is not None:
            self._query.reply(self._query.key_expr, reply.ok.payload.to_bytes())

    def end_one(self) -> None:
        """Nothing more comes for one of the asks."""
        with self._lock:
            self._asks -= 1
            is_over = self._asks == 0
        if is_over:
            # Zenoh gives this method no types.
            self._query.drop()  # type: ignore[no-untyped-call]
