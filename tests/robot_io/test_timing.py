"""Durations, their histograms, and the way from sensors to servos."""

from __future__ import annotations

import time
from itertools import pairwise

import numpy as np

from surefoot.robot_io.timing import EDGES_MS, CommandLatency, TimingLog

NS_PER_MS = 1e6
CAPACITY = 1000


def test_a_histogram_counts_every_duration_once_and_where_it_belongs() -> None:
    rng = np.random.default_rng(0)
    times_ms = rng.lognormal(0.0, 2.0, CAPACITY)
    log = TimingLog(CAPACITY)
    for time_ms in times_ms:
        log.add(round(NS_PER_MS * time_ms))
    histogram = log.histogram()
    assert histogram.edges_ms == sorted(EDGES_MS)
    assert sum(histogram.counts) == CAPACITY
    bounds = [-np.inf, *histogram.edges_ms, np.inf]
    for (low, high), count in zip(pairwise(bounds), histogram.counts, strict=True):
        assert count == np.count_nonzero((times_ms >= low) & (times_ms < high))


def test_a_histogram_of_nothing_is_empty() -> None:
    assert sum(TimingLog(CAPACITY).histogram().counts) == 0


def test_latency_runs_from_the_stamp_of_the_tick_answered_to_the_tick_it_acts_in() -> (
    None
):
    latency = CommandLatency(CAPACITY)
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
    latency = CommandLatency(CAPACITY)
    for tick in (1, 2):
        latency.sensed(tick, stamp_ns=time.monotonic_ns())
        latency.taken(tick, acts_at=3)
    latency.applied(3)
    assert len(latency.log) == 1
