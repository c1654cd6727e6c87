"""Success rates and what can be said of them from a few runs."""

from __future__ import annotations

from collections.abc import Sequence

CONFIDENCE = 0.95


def success_interval(successes: int, runs: int) -> tuple[float, float]:
    """Wilson's 95 % confidence interval of a success rate.

    Args:
        successes: at most ``runs``.
        runs: how many there were; the interval is (0, 1) for none.

    Returns:
        Lower and upper end, within [0, 1].
    """
    from scipy.stats import binomtest

    if runs == 0:
        return 0.0, 1.0
    interval = binomtest(successes, runs).proportion_ci(CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)


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
