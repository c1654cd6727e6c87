"""Success rates and what can be said of them from a few runs."""

from __future__ import annotations

import math
from collections.abc import Sequence

Z_95 = 1.959964
"""Two-sided 95 % of the normal distribution."""


def wilson_interval(successes: int, runs: int) -> tuple[float, float]:
    """95 % confidence interval of a success rate.

    Args:
        successes: at most ``runs``.
        runs: how many there were; the interval is (0, 1) for none.

    Returns:
        Lower and upper end, after E. B. Wilson (1927), within [0, 1].
    """
    if runs == 0:
        return 0.0, 1.0
    p, z2 = successes / runs, Z_95 * Z_95
    middle = (p + z2 / (2.0 * runs)) / (1.0 + z2 / runs)
    half = (
        Z_95
        / (1.0 + z2 / runs)
        * math.sqrt(p * (1.0 - p) / runs + z2 / (4.0 * runs * runs))
    )
    return max(0.0, middle - half), min(1.0, middle + half)


def success_limit(
    levels: Sequence[float], rates: Sequence[float], *, at: float = 0.5
) -> float | None:
    """Where the success rate first falls below a level, between two levels linearly.

    Args:
        levels: what was varied, rising.
        rates: success rate at each.
        at: the rate in question.

    Returns:
        None when the rate never falls below: the limit is beyond what was tried.
        The first level when it is below from the start.
    """
    for i, (level, rate) in enumerate(zip(levels, rates, strict=True)):
        if rate >= at:
            continue
        if i == 0:
            return level
        before, good = levels[i - 1], rates[i - 1]
        return before + (level - before) * (good - at) / (good - rate)
    return None
