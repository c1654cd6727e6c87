"""Counts and times of a channel, for messages at known times."""

from __future__ import annotations

import msgspec
import pytest

from surefoot.cli.bus_messages import ChannelTiming, TimingMeter
from surefoot.robot_io.realtime import distribution_of

MS = 1_000_000
TOLERANCE = 1e-9


def measure(
    *messages: tuple[int, int], every_tick: bool = True, has_delay: bool = True
) -> ChannelTiming:
    """Return the timing of messages (tick, receipt in ms), each stamped 2 ms before."""
    meter = TimingMeter(
        "joints", every_tick=every_tick, window_s=1.0, has_delay=has_delay
    )
    for tick, at_ms in messages:
        content = {"tick": tick, "stamp_ns": (at_ms - 2) * MS, "q": [0.0]}
        meter.add(msgspec.msgpack.encode(content), received_ns=at_ms * MS)
    return meter.timing(max(at_ms for _, at_ms in messages) * MS)


def test_a_steady_channel_has_its_rate_and_no_jitter() -> None:
    timing = measure(*((tick, 10 + 5 * tick) for tick in range(21)))
    assert timing.rate_hz == pytest.approx(200.0, abs=TOLERANCE)
    assert timing.period_ms == pytest.approx(5.0, abs=TOLERANCE)
    assert timing.jitter_ms == distribution_of([0.0])
    assert timing.delay_ms is not None
    assert timing.delay_ms.max == pytest.approx(2.0, abs=TOLERANCE)
    assert (timing.gaps, timing.duplicates, timing.out_of_order) == (0, 0, 0)


def test_ticks_passed_over_repeated_and_late_are_counted_apart() -> None:
    order = [0, 1, 5, 5, 4, 6, 6, 6, 9]
    timing = measure(*((tick, 10 + at) for at, tick in enumerate(order)))
    assert timing.messages == len(order)
    assert timing.gaps == 3 + 2
    assert timing.duplicates == 3
    assert timing.out_of_order == 1
    assert timing.restarts == 0


def test_another_run_of_the_robot_is_no_late_message() -> None:
    timing = measure((5000, 10), (5001, 11), (0, 12), (1, 13))
    assert (timing.restarts, timing.out_of_order, timing.gaps) == (1, 0, 0)


def test_a_channel_without_fixed_rate_has_no_gaps_to_count() -> None:
    timing = measure((0, 10), (20, 30), every_tick=False, has_delay=False)
    assert timing.gaps is None
    assert timing.delay_ms is None
    assert timing.rate_hz == pytest.approx(50.0, abs=TOLERANCE)


def test_only_the_window_counts_for_the_rate() -> None:
    slow = [(tick, 10 + 100 * tick) for tick in range(5)]
    fast = [(5 + tick, 2000 + 10 * tick) for tick in range(11)]
    timing = measure(*slow, *fast)
    assert timing.rate_hz == pytest.approx(100.0, abs=TOLERANCE)
    assert timing.messages == len(slow) + len(fast)


def test_one_late_message_is_the_largest_jitter() -> None:
    timing = measure((0, 10), (1, 12), (2, 14), (3, 20), (4, 22))
    assert timing.jitter_ms is not None
    assert timing.jitter_ms.max == pytest.approx(4.0, abs=TOLERANCE)
    assert timing.jitter_ms.median == pytest.approx(0.0, abs=TOLERANCE)


def test_unreadable_messages_are_counted_and_no_more() -> None:
    meter = TimingMeter("ref", every_tick=True, window_s=1.0, has_delay=True)
    for data in (b"", b"\xc1", msgspec.msgpack.encode({"tick": "x"})):
        meter.add(data, received_ns=MS)
    timing = meter.timing(MS)
    assert (timing.messages, timing.unreadable, timing.rate_hz) == (3, 3, None)
