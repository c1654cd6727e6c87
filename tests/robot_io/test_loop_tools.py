"""Pacing, timing and stopping of loops."""

from __future__ import annotations

import gc
import os
import signal
import sys
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.robot_io.realtime import (
    MAX_LAG_PERIODS,
    SWITCH_INTERVAL_S,
    Pacer,
    RecentTimes,
    StopRequest,
    TimingLog,
    quiet_interpreter,
)
from surefoot.schemas.arrays import MS_PER_NS
from tests.support import wait_until

PERIOD_S = 0.001


@given(
    st.lists(st.integers(0, 10**12), min_size=1, max_size=30),
    st.integers(1, 20),
)
def test_distribution_is_that_of_the_newest_durations(
    durations_ns: list[int], capacity: int
) -> None:
    log = RecentTimes(capacity)
    for duration_ns in durations_ns:
        log.add(duration_ns)
    kept = np.array(durations_ns[-capacity:])
    told = log.distribution()
    assert told.max == pytest.approx(MS_PER_NS * kept.max())
    assert told.median == pytest.approx(MS_PER_NS * np.median(kept))
    assert told.median <= told.p99 <= told.max * (1 + 1e-12)


def test_distribution_of_nothing_is_zero() -> None:
    for log in (TimingLog(), RecentTimes(5)):
        told = log.distribution()
        assert (told.median, told.p99, told.max) == (0.0, 0.0, 0.0)


def test_pacer_never_begins_a_tick_early() -> None:
    lateness = TimingLog()
    pacer = Pacer(PERIOD_S, lateness=lateness)
    begin_s = time.monotonic()
    for _ in range(50):
        pacer.wait()
    assert len(lateness) == 50
    assert time.monotonic() - begin_s >= 49 * PERIOD_S


def test_pacer_gives_up_what_it_cannot_catch_up() -> None:
    pacer = Pacer(PERIOD_S, lateness=TimingLog())
    busy_until_s = time.monotonic() + 4 * MAX_LAG_PERIODS * PERIOD_S
    wait_until(lambda: time.monotonic() > busy_until_s, what="the lag")
    pacer.wait()
    assert pacer.skipped >= 3 * MAX_LAG_PERIODS


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_become_requests_and_old_handlers_come_back(number: int) -> None:
    before = signal.getsignal(number)
    stop = StopRequest()
    woken: list[bool] = []
    stop.waking(lambda: woken.append(True))
    with stop.on_signals():
        os.kill(os.getpid(), number)
        wait_until(lambda: stop.is_set, what="the signal")
    assert stop.cause == signal.Signals(number).name
    assert woken == [True]
    assert signal.getsignal(number) is before


def test_the_first_cause_is_the_one_that_is_told() -> None:
    stop = StopRequest()
    stop.set("first")
    stop.set("second")
    assert stop.cause == "first"


def test_a_late_listener_is_woken_at_once() -> None:
    stop = StopRequest()
    stop.set()
    woken: list[bool] = []
    stop.waking(lambda: woken.append(True))
    assert woken == [True]


def test_quiet_interpreter_is_undone_even_after_an_error() -> None:
    interval_s = sys.getswitchinterval()

    def fail_inside() -> None:
        with quiet_interpreter():
            assert not gc.isenabled()
            assert np.geterr()["over"] == "ignore"
            assert sys.getswitchinterval() == pytest.approx(SWITCH_INTERVAL_S)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail_inside()
    assert gc.isenabled()
    assert np.geterr()["over"] == "warn"
    assert sys.getswitchinterval() == pytest.approx(interval_s)
