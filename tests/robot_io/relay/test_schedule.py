"""The schedule returns messages when they are due, in the right order."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from surefoot.robot_io.relay.forwarder import Schedule

TIMES = st.lists(st.integers(0, 20), max_size=40)

QUICK = settings(max_examples=40)


def drained(schedule: Schedule[int], now_s: float) -> list[int]:
    """Return everything that is due."""
    taken = []
    while (item := schedule.take_due(now_s)) is not None:
        taken.append(item)
    return taken


@QUICK
@given(TIMES)
def test_the_order_is_by_time_then_by_coming(times: list[int]) -> None:
    schedule: Schedule[int] = Schedule()
    for index, at_s in enumerate(times):
        schedule.put(index, at_s=at_s)
    expected = sorted(range(len(times)), key=lambda index: (times[index], index))
    assert drained(schedule, 20.0) == expected
    assert schedule.next_s is None


@QUICK
@given(TIMES, st.integers(0, 20))
def test_nothing_is_taken_before_its_time(times: list[int], now: int) -> None:
    schedule: Schedule[int] = Schedule()
    for index, at_s in enumerate(times):
        schedule.put(index, at_s=at_s)
    taken = drained(schedule, now)
    assert sorted(taken) == [i for i, at_s in enumerate(times) if at_s <= now]
    later = [at_s for at_s in times if at_s > now]
    assert schedule.next_s == (min(later) if later else None)


@QUICK
@given(TIMES)
def test_the_last_comes_after_all_others(times: list[int]) -> None:
    schedule: Schedule[int] = Schedule()
    for at_s in times:
        schedule.put(0, at_s=at_s)
    schedule.put_last(1, now_s=3.0)
    assert drained(schedule, 20.0) == [0] * len(times) + [1]
