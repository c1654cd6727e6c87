"""Does things at their time, on a thread of its own."""

from __future__ import annotations

import heapq
import logging
import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

Deed = Callable[[], None]
_LOG = logging.getLogger(__name__)
T = TypeVar("T")


class Schedule(Generic[T]):
    """A queue by time; what is due at the same time comes in the order it was put."""

    def __init__(self) -> None:
        """Start with an empty queue."""
        self._heap: list[tuple[float, int, T]] = []
        self._count = 0
        self._latest_s = -math.inf

    def put(self, item: T, *, at_s: float) -> None:
        """Add something to be done at a time [s]."""
        heapq.heappush(self._heap, (at_s, self._count, item))
        self._count += 1
        self._latest_s = max(self._latest_s, at_s)

    def put_last(self, item: T, *, now_s: float) -> None:
        """Add something to be done now, but after all that is to be done already."""
        self.put(item, at_s=max(now_s, self._latest_s))

    def take_due(self, now_s: float) -> T | None:
        """Take out the next thing that is due; None when nothing is."""
        if not self._heap or self._heap[0][0] > now_s:
            return None
        return heapq.heappop(self._heap)[2]

    @property
    def next_s(self) -> float | None:
        """When the next thing is due [s]; None when there is none."""
        return self._heap[0][0] if self._heap else None


class Dispatcher:
    """A thread that sleeps until the next thing is due.

    Attributes:
        error: what ended it, if anything did.
    """

    def __init__(self) -> None:
        """Prepare; :meth:`running` starts the thread."""
        self.error: Exception | None = None
        self._schedule: Schedule[Deed] = Schedule()
        self._changed = threading.Condition()
        self._is_over = False

    @contextmanager
    def running(self) -> Iterator[None]:
        """Run the thread; what is not yet due at the end is left undone."""
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
        """Have something done, at a time on ``time.monotonic`` [s]."""
        with self._changed:
            self._schedule.put(deed, at_s=at_s)
            self._changed.notify()

    def do_last(self, deed: Deed) -> None:
        """Have something done after all that is to be done already."""
        with self._changed:
            self._schedule.put_last(deed, now_s=time.monotonic())
            self._changed.notify()

    def _run(self) -> None:
        try:
            while (deed := self._next()) is not None:
                deed()
        except Exception as error:
            self.error = error  # told, and raised, by the main thread
            _LOG.error("the relay cannot go on: %s", error)

    def _next(self) -> Deed | None:
        """Wait for the next thing that is due; None at the end."""
        with self._changed:
            while not self._is_over:
                now_s = time.monotonic()
                deed = self._schedule.take_due(now_s)
                if deed is not None:
                    return deed
                next_s = self._schedule.next_s
                self._changed.wait(None if next_s is None else next_s - now_s)
        return None
