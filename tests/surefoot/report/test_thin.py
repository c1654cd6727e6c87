from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.report.curves import BUCKETS, changes, thin
from surefoot.report.video import best_loop

PERIOD_S = 0.01


@given(st.integers(0, 5000), st.integers(1, 60), st.integers(0, 2**32 - 1))
def test_thinning_keeps_extremes_ends_and_order(
    count: int, buckets: int, seed: int
) -> None:
    values = np.random.default_rng(seed).normal(size=count)
    times = np.arange(count, dtype=np.float64)
    thin_times, thin_values = thin(times, values, buckets=buckets)
    assert len(thin_times) <= max(2 * buckets + 2, 0)
    assert np.all(np.diff(thin_times) > 0)
    np.testing.assert_array_equal(values[thin_times.astype(int)], thin_values)
    if count:
        assert (thin_times[0], thin_times[-1]) == (0, count - 1)
        assert (thin_values.min(), thin_values.max()) == (values.min(), values.max())


def test_a_peak_of_one_tick_is_seen() -> None:
    values = np.zeros(100_000)
    values[54_321] = 7.0
    times, thinned = thin(np.arange(100_000.0), values)
    assert times[thinned.argmax()] == 54_321


@pytest.mark.parametrize("count", [900, 90_000])
def test_no_line_crosses_a_gap(count: int) -> None:
    """Of a third of the run, however many points are left of it."""
    times = 0.001 * np.arange(float(count))
    known = (times < times[count // 3]) | (times > times[2 * count // 3])
    drawn, values = thin(times[known], times[known], period_s=0.001)
    (gap,) = np.flatnonzero(np.isnan(values))
    assert drawn[gap] == drawn[gap - 1] == times[count // 3 - 1]
    assert drawn[gap + 1] == times[2 * count // 3 + 1]
    assert np.all(np.diff(drawn) >= 0)


def test_gaps_too_narrow_to_be_seen_add_no_points() -> None:
    times = 0.001 * np.arange(100_000.0)[::2]
    drawn, values = thin(times, times, period_s=0.001)
    assert len(drawn) <= 2 * BUCKETS + 2
    assert np.isfinite(values).all()


def test_a_state_ends_where_it_is_no_longer_known() -> None:
    values = np.array([1.0, 1.0, 1.0, np.nan, np.nan, 0.0, 0.0])
    times, kept = changes(np.arange(7.0), values)
    assert times.tolist() == [0.0, 2.0, 3.0, 5.0, 6.0]
    np.testing.assert_array_equal(kept, [1.0, 1.0, np.nan, 0.0, 0.0])


def test_only_changes_of_a_state_are_kept() -> None:
    values = np.array([1.0, 1.0, 2.0, 2.0, 2.0, 1.0, 1.0])
    times, kept = changes(np.arange(7.0), values)
    assert times.tolist() == [0.0, 2.0, 5.0, 6.0]
    assert kept.tolist() == [1.0, 2.0, 1.0, 1.0]


def test_a_loop_is_a_whole_number_of_periods() -> None:
    times = np.arange(0.0, 12.0, PERIOD_S)
    turn = 2 * np.pi * times / 2.5
    poses = np.column_stack((np.sin(turn), np.cos(2 * turn)))
    start, end = best_loop(poses, period_s=PERIOD_S, length_s=(4.0, 7.0))
    assert (end - start) * PERIOD_S == 5.0


def test_a_short_motion_is_looped_whole() -> None:
    poses = np.zeros((100, 2))
    assert best_loop(poses, period_s=PERIOD_S, length_s=(4.0, 7.0)) == (0, 99)
