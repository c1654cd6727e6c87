"""What the runs of a group amount to."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from surefoot.schemas.reasons import Outcome
from surefoot.studies.cell import Group, Row, group_of

CONFIDENCE = 0.95


def success_interval(successes: int, runs: int) -> tuple[float, float]:
    """Return Wilson's 95 % confidence interval of a success rate.

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
    """Find where the success rate first falls below a level, by interpolation.

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


@dataclass(frozen=True)
class GroupSummary:
    """Figures of a group; means and worst are over the runs that stayed up.

    Attributes:
        runs: how many there were.
        up: how many stayed up.
        up_from: lower end of the 95 % interval of the success rate.
        up_to: its upper end.
        com_rms_mm: mean over seeds of the CoM error, x y z.
        com_rms_worst_mm: worst seed.
        com_max_mm: worst seed's largest error, x y z.
        tilt_max_deg: worst seed.
        force_deviation_n: mean over seeds; of both feet, root mean square.
        force_peak_n: worst seed, either foot.
        contact_gap_s: worst seed, either foot.
    """

    runs: int
    up: int
    up_from: float
    up_to: float
    com_rms_mm: list[float] | None = None
    com_rms_worst_mm: list[float] | None = None
    com_max_mm: list[float] | None = None
    tilt_max_deg: float | None = None
    force_deviation_n: float | None = None
    force_peak_n: float | None = None
    contact_gap_s: float | None = None

    @property
    def horizontal_mm(self) -> float | None:
        """CoM error along the ground, rms of x and y together."""
        return None if self.com_rms_mm is None else math.hypot(*self.com_rms_mm[:2])

    def as_dict(self) -> dict[str, Any]:
        """Return the figures as built-in types, for JSON."""
        return asdict(self)


def summarise(rows: Iterable[Row]) -> dict[Group, GroupSummary]:
    """Return summaries by group, in the order in which the groups first come."""
    groups: dict[Group, list[Row]] = {}
    for row in rows:
        groups.setdefault(group_of(row), []).append(row)
    return {group: _summary(rows) for group, rows in groups.items()}


def _summary(rows: list[Row]) -> GroupSummary:
    standing = [row for row in rows if Outcome(row["outcome"]).is_up]
    low, high = success_interval(len(standing), len(rows))
    if not standing:
        return GroupSummary(runs=len(rows), up=0, up_from=low, up_to=high)
    deviations = [
        math.sqrt(_mean_square(pair))
        for row in standing
        if (pair := row["force_deviation_rms_n"]) is not None
    ]
    return GroupSummary(
        runs=len(rows),
        up=len(standing),
        up_from=low,
        up_to=high,
        com_rms_mm=_over(standing, "com_error_rms_mm", _mean),
        com_rms_worst_mm=_over(standing, "com_error_rms_mm", max),
        com_max_mm=_over(standing, "com_error_max_mm", max),
        tilt_max_deg=max(row["base_tilt_max_deg"] for row in standing),
        force_deviation_n=_mean(deviations) if deviations else None,
        force_peak_n=_largest(standing, "force_peak_n"),
        contact_gap_s=max(max(row["contact_gap_s"]) for row in standing),
    )


def _largest(rows: list[Row], name: str) -> float | None:
    """Largest of both feet over runs; those that ended before any counted left out."""
    values = [max(row[name]) for row in rows if row[name] is not None]
    return max(values, default=None)


def _over(rows: list[Row], name: str, what: Any) -> list[float] | None:
    """Combine axis by axis, without runs that ended before anything counted."""
    values = [row[name] for row in rows if row[name] is not None]
    if not values:
        return None
    return [float(what(column)) for column in zip(*values, strict=True)]


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _mean_square(values: Sequence[float]) -> float:
    return sum(v * v for v in values) / len(values)
