"""Forwards messages, services and presence between the relay's sides, each when due."""

from __future__ import annotations

import heapq
import logging
import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Generic, TypeVar

import zenoh
from zenoh.handlers import Callback

from surefoot.robot_io.bus.bus import Bus, bytes_of
from surefoot.robot_io.relay.lane import Lane, Parcel, PlanClock
from surefoot.schemas.topics import COMMAND, TICK_SENSORS, URGENT

Deed = Callable[[], None]
_LOG = logging.getLogger(__name__)
T = TypeVar("T")
ANSWER_S = 5.0
"""Longest time for a service to answer [s]."""


class Schedule(Generic[T]):
    """A queue by time; items due at the same time come in the order they were put."""

    def __init__(self) -> None:
        """Start with an empty queue."""
        self._heap: list[tuple[float, int, T]] = []
        self._count = 0
        self._latest_s = -math.inf

    def put(self, item: T, *, at_s: float) -> None:
        """Add an item that is due at a time [s]."""
        heapq.heappush(self._heap, (at_s, self._count, item))
        self._count += 1
        self._latest_s = max(self._latest_s, at_s)

    def put_last(self, item: T, *, now_s: float) -> None:
        """Add an item that is due now, but after all items in the queue."""
        self.put(item, at_s=max(now_s, self._latest_s))

    def take_due(self, now_s: float) -> T | None:
        """Take out the next item that is due; None when none is."""
        if not self._heap or self._heap[0][0] > now_s:
            return None
        return heapq.heappop(self._heap)[2]

    @property
    def next_s(self) -> float | None:
        """When the next item is due [s]; None when there is none."""
        return self._heap[0][0] if self._heap else None


class Dispatcher:
    """A thread that sleeps until the next deed is due, and does it.

    Attributes:
        error: the error that ended the thread; None if there was none.
    """

    def __init__(self) -> None:
        """Prepare; :meth:`running` starts the thread."""
        self.error: Exception | None = None
        self._schedule: Schedule[Deed] = Schedule()
        self._changed = threading.Condition()
        self._is_over = False

    @contextmanager
    def running(self) -> Iterator[None]:
        """Run the thread; deeds not yet due at the end are dropped."""
        thread = threading.Thread(target=self._run, name="relay", daemon=True)
        thread.start()
        try:
            yield
        finally:
            with self._changed:
                self._is_over = True
                self._changed.notify()
            thread.join()

    def do(self, deed: Deed, *, at_s: float) -> None:
        """Add a deed for a time on ``time.monotonic`` [s]."""
        with self._changed:
            self._schedule.put(deed, at_s=at_s)
            self._changed.notify()

    def do_last(self, deed: Deed) -> None:
        """Add a deed after all deeds that wait."""
        with self._changed:
            self._schedule.put_last(deed, now_s=time.monotonic())
            self._changed.notify()

    def _run(self) -> None:
        try:
            while (deed := self._next()) is not None:
                deed()
        except Exception as error:  # of this thread: the main one reports and raises it
            self.error = error
            _LOG.error("the relay cannot go on: %s", error)

    def _next(self) -> Deed | None:
        """Wait for the next deed that is due; None at the end."""
        with self._changed:
            while not self._is_over:
                now_s = time.monotonic()
                deed = self._schedule.take_due(now_s)
                if deed is not None:
                    return deed
                next_s = self._schedule.next_s
                self._changed.wait(None if next_s is None else next_s - now_s)
        return None


class Forwarder:
    """Subscribes on one side, publishes on the other.

    A message due at once goes on from Zenoh's own thread. The dispatcher sends messages
    that wait, and all messages behind them, to keep the order.
    """

    def __init__(
        self,
        name: str,
        key: str,
        *,
        source: Bus,
        target: Bus,
        lane: Lane,
        dispatcher: Dispatcher,
        clock: PlanClock,
    ) -> None:
        """Begin to forward."""
        self._begins_clock = name == COMMAND
        self._lane, self._dispatcher, self._clock = lane, dispatcher, clock
        self._waiting = 0
        self._lock = threading.Lock()
        self._publisher = target.publisher(
            key, urgent=name in URGENT, flush=name == TICK_SENSORS[-1]
        )
        self._subscriber = source.session.declare_subscriber(
            key, Callback(self._on_sample, indirect=False)
        )

    def close(self) -> None:
        """Stop receiving."""
        # Zenoh gives this method no types.
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]

    def _on_sample(self, sample: zenoh.Sample) -> None:
        now_s = time.monotonic()
        if self._begins_clock:
            self._clock.begin(now_s)
        parcels = self._lane.pass_on(
            sample.payload.to_bytes(),
            now_s=now_s,
            elapsed_s=self._clock.elapsed_s(now_s),
        )
        for parcel in parcels:
            self._send(parcel, now_s)

    def _send(self, parcel: Parcel, now_s: float) -> None:
        if self._waiting == 0 and parcel.at_s <= now_s:
            self._publisher.put(parcel.data)
            return
        with self._lock:
            self._waiting += 1
        self._dispatcher.do(partial(self._deliver, parcel.data), at_s=parcel.at_s)

    def _deliver(self, data: bytes) -> None:
        self._publisher.put(data)
        with self._lock:  # only now may the next one go on without waiting
            self._waiting -= 1


class PresenceMirror:
    """Declares the liveliness tokens of one side on the other, and withdraws them.

    Changes come after all messages that wait to be sent. So the last message of a
    process arrives before the news that it has gone.
    """

    def __init__(
        self, pattern: str, *, source: Bus, target: Bus, dispatcher: Dispatcher
    ) -> None:
        """Begin to mirror."""
        self._target, self._dispatcher = target, dispatcher
        self._tokens: dict[str, zenoh.LivelinessToken] = {}
        source.watch_presence(pattern, self._on_change)

    def _on_change(self, key: str, is_there: bool) -> None:
        self._dispatcher.do_last(partial(self._mirror, key, is_there))

    def _mirror(self, key: str, is_there: bool) -> None:
        if is_there and key not in self._tokens:
            liveliness = self._target.session.liveliness()
            self._tokens[key] = liveliness.declare_token(key)
        elif not is_there and key in self._tokens:
            # Zenoh gives this method no types.
            self._tokens.pop(key).undeclare()  # type: ignore[no-untyped-call]


class ServiceForwarder:
    """Answers queries on one side with the answer of the service on the other side.

    A lost request stays unanswered, as if the service were not there yet; the caller
    asks again.
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
        """Begin to forward."""
        self._key, self._target = key, target
        self._lane, self._dispatcher, self._clock = lane, dispatcher, clock
        source.queryable(key, self._on_query)

    def _on_query(self, query: zenoh.Query) -> None:
        now_s = time.monotonic()
        parcels = self._lane.pass_on(
            bytes_of(query), now_s=now_s, elapsed_s=self._clock.elapsed_s(now_s)
        )
        open_query = _OpenQuery(query, asks=len(parcels))
        for parcel in parcels:
            # Never from here: this thread would have to receive the answer.
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
    """A query that stays open until all requests made for it have been answered."""

    def __init__(self, query: zenoh.Query, *, asks: int) -> None:
        self._query = query
        self._asks = asks
        self._lock = threading.Lock()
        if asks == 0:
            # Zenoh gives this method no types.
            query.drop()  # type: ignore[no-untyped-call]

    def answer(self, reply: zenoh.Reply) -> None:
        """Pass an answer back."""
        if reply.ok is not None:
            self._query.reply(self._query.key_expr, reply.ok.payload.to_bytes())

    def end_one(self) -> None:
        """Record that one of the requests is finished."""
        with self._lock:
            self._asks -= 1
            is_over = self._asks == 0
        if is_over:
            # Zenoh gives this method no types.
            self._query.drop()  # type: ignore[no-untyped-call]
