"""The time of a plan, which begins with the first command."""

from __future__ import annotations


class PlanClock:
    """Counts from the first joint command; before it the plan is not in force."""

    def __init__(self) -> None:
        """Has not begun."""
        self._began_s: float | None = None

    def begin(self, now_s: float) -> None:
        """Begins; later calls change nothing."""
        if self._began_s is None:
            self._began_s = now_s

    def elapsed_s(self, now_s: float) -> float | None:
        """Time since it began [s]; None before."""
        return None if self._began_s is None else now_s - self._began_s
