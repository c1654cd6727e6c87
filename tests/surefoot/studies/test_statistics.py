"""Success rates, their intervals and limits."""

from __future__ import annotations

import pytest

from surefoot.studies.summary import success_interval, success_limit

TOLERANCE = 1e-4


@pytest.mark.parametrize(
    ("successes", "runs", "low", "high"),
    [(50, 50, 0.9287, 1.0), (0, 50, 0.0, 0.0713), (5, 10, 0.2366, 0.7634)],
)
def test_interval_is_wilsons(
    successes: int, runs: int, low: float, high: float
) -> None:
    interval = success_interval(successes, runs)
    assert interval == pytest.approx((low, high), abs=TOLERANCE)


def test_nothing_tried_says_nothing() -> None:
    assert success_interval(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("rates", "limit"),
    [
        ([1.0, 1.0, 0.0], 150.0),
        ([1.0, 0.25, 0.0], 60.0 + 60.0 * 0.5 / 0.75),
        ([0.0, 0.0, 0.0], 60.0),
        ([1.0, 0.75, 0.5], None),
    ],
)
def test_limit_lies_where_half_the_runs_fall(
    rates: list[float], limit: float | None
) -> None:
    assert success_limit([60.0, 120.0, 180.0], rates) == (
        None if limit is None else pytest.approx(limit)
    )
