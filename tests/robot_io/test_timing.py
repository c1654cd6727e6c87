"""Durations, their histograms, and the latency from sensors to servos."""

from __future__ import annotations

import time
import tracemalloc
from itertools import pairwise

import numpy as np
import pytest

from surefoot.robot_io.realtime import (
    EDGES_MS,
    RESOLUTION,
    CommandLatency,
    RecentTimes,
    TimingLog,
)

NS_PER_MS = 1e6
COUNT = 1000


def test_a_histogram_counts_every_duration_once_and_where_it_belongs() -> None:
    rng = np.random.default_rng(0)
    times_ms = rng.lognormal(0.0, 2.0, COUNT)
    log = TimingLog()
    for time_ms in times_ms:
        log.add(round(NS_PER_MS * time_ms))
    histogram = log.histogram()
    assert histogram.edges_ms == sorted(EDGES_MS)
    assert sum(histogram.counts) == COUNT
    bounds = [-np.inf, *histogram.edges_ms, np.inf]
    for (low, high), count in zip(pairwise(bounds), histogram.counts, strict=True):
        assert count == np.count_nonzero((times_ms >= low) & (times_ms < high))


@pytest.mark.parametrize("spread", [0.0, 0.3, 2.0])
def test_percentiles_are_true_to_the_resolution(spread: float) -> None:
    """Against the largest of all values that have so large a share below them."""
    rng = np.random.default_rng(1)
    times_ns = rng.lognormal(np.log(4e5), spread, COUNT).astype(np.int64)
    log = TimingLog()
    for time_ns in times_ns:
        log.add(int(time_ns))
    told = log.distribution()
    for share, value in ((50.0, told.median), (99.0, told.p99)):
        true = np.percentile(times_ns, share, method="lower") / NS_PER_MS
        assert value == pytest.approx(true, rel=RESOLUTION)
    assert told.max == pytest.approx(times_ns.max() / NS_PER_MS)


def test_durations_beyond_all_steps_count_as_the_last_one() -> None:
    log = TimingLog()
    for duration_ns in (-5, 0, 10**18):
        log.add(duration_ns)
    told = log.distribution()
    assert len(log) == 3
    assert told.max == pytest.approx(10**18 / NS_PER_MS)
    assert 0.0 <= told.median <= told.p99 <= told.max


def test_memory_does_not_grow_with_the_run() -> None:
    log, recent = TimingLog(), RecentTimes(1024)
    for duration_ns in range(1, 3000):
        log.add(duration_ns)
        recent.add(duration_ns)
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    for duration_ns in range(1, 100_000):
        log.add(duration_ns)
        recent.add(duration_ns)
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert after - before < 4096


def test_a_histogram_of_nothing_is_empty() -> None:
    assert sum(TimingLog().histogram().counts) == 0


def test_latency_runs_from_the_stamp_of_the_tick_answered_to_the_tick_it_acts_in() -> (
    None
):
    latency = CommandLatency()
    long_ago_ns = time.monotonic_ns() - round(50 * NS_PER_MS)
    latency.sensed(7, stamp_ns=long_ago_ns)
    latency.sensed(8, stamp_ns=time.monotonic_ns())
    latency.taken(7, acts_at=9)
    latency.applied(8)
    assert len(latency.log) == 0  # it acts later
    latency.applied(9)
    latency.applied(9)  # and begins to act once
    assert len(latency.log) == 1
    assert latency.log.distribution().median >= 50.0
    now_ms = (time.monotonic_ns() - long_ago_ns) / NS_PER_MS
    assert latency.log.distribution().median <= now_ms


def test_a_command_that_another_one_replaces_before_it_acts_is_not_counted() -> None:
    latency = CommandLatency()
    for tick in (1, 2):
        latency.sensed(tick, stamp_ns=time.monotonic_ns())
        latency.taken(tick, acts_at=3)
    latency.applied(3)
    assert len(latency.log) == 1
