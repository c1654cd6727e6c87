"""Things to be done at their time; pure: told what time it is."""

from __future__ import annotations

import heapq
import math
from typing import Generic, TypeVar

T = TypeVar("T")


class Schedule(Generic[T]):
    """A queue by time; what is due at the same time comes in the order it was put."""

    def __init__(self) -> None:
        """Nothing is to be done."""
        self._heap: list[tuple[float, int, T]] = []
        self._count = 0
        self._latest_s = -math.inf

    def put(self, item: T, *, at_s: float) -> None:
        """Adds something to be done at a time [s]."""
        heapq.heappush(self._heap, (at_s, self._count, item))
        self._count += 1
        self._latest_s = max(self._latest_s, at_s)

    def put_last(self, item: T, *, now_s: float) -> None:
        """Adds something to be done now, but after all that is to be done already."""
        self.put(item, at_s=max(now_s, self._latest_s))

    def take_due(self, now_s: float) -> T | None:
        """Takes out the next thing that is due; None when nothing is."""
        if not self._heap or self._heap[0][0] > now_s:
            return None
        return heapq.heappop(self._heap)[2]

    @property
    def next_s(self) -> float | None:
        """When the next thing is due [s]; None when there is none."""
        return self._heap[0][0] if self._heap else None
