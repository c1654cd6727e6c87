"""Finds the largest push that a robot stands, by halving."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

WITHIN = 1.02
"""The search ends when what fell is at most so many times what stood."""
STEP = 2.0
"""From the first guess on, until one stood and one fell."""
MOST_STEPS = 6
DIGITS = 4


@dataclass
class MarginSearch:
    """A search that is told, push by push, whether the robot stood.

    It takes for granted that whoever stands a push stands every smaller one.

    Attributes:
        size: to be tried next.
        stood: largest that was stood; 0 when none was.
        fell: smallest that was not; None when all were stood.
        tried: how many so far.
    """

    size: float
    stood: float = 0.0
    fell: float | None = None
    tried: int = field(default=0)

    def __post_init__(self) -> None:
        """Name sizes by a few digits, so that a run is found again by its name."""
        self.size = _rounded(self.size)

    @property
    def is_done(self) -> bool:
        """Whether the margin is known to within 2 %, or lies beyond what is tried."""
        if self.stood and self.fell is not None:
            # Sizes of a few digits leave no room between some neighbours.
            return self.fell <= WITHIN * self.stood or self.size in (
                self.stood,
                self.fell,
            )
        return self.tried > MOST_STEPS

    def tell(self, *, stood: bool) -> None:
        """Take in how it went with ``size``, and choose the next."""
        self.tried += 1
        if stood:
            self.stood = max(self.stood, self.size)
        else:
            self.fell = self.size if self.fell is None else min(self.fell, self.size)
        if self.fell is None:
            self.size = _rounded(self.size * STEP)
        elif not self.stood:
            self.size = _rounded(self.size / STEP)
        else:
            self.size = _rounded(math.sqrt(self.stood * self.fell))


def _rounded(size: float) -> float:
    return float(f"{size:.{DIGITS}g}")
