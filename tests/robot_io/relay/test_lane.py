"""Effects of faults on messages, without a bus and without a clock."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surefoot.robot_io.relay.lane import Lane, Parcel
from surefoot.schemas.codec import decode, encode
from surefoot.schemas.messages import JointState
from surefoot.schemas.relay_plan import RelayPlan
from surefoot.schemas.toml_file import convert
from tests.robot_io.sensor_messages import message

PERIOD_S = 1e-3
EPSILON_S = 1e-9
MANY = 2000
SIGMAS = 5.0
"""Standard deviations by which the share of random events may be off."""
FAULTS = st.sampled_from(
    [
        {"kind": "drop", "probability": 0.3},
        {"kind": "delay", "ms": 4.0},
        {"kind": "jitter", "ms": 5.0},
        {"kind": "duplicate", "probability": 0.3},
        {"kind": "duplicate", "probability": 0.3, "ms": 2.5},
        {"kind": "reorder", "probability": 0.3},
        {"kind": "corrupt", "probability": 0.3, "bits": 3},
        {"kind": "cut", "start_s": 0.02, "duration_s": 0.02},
        {"kind": "clock_jump", "seconds": -5.0},
    ]
)
QUICK = settings(max_examples=40)
IN_ORDER = ("drop", "delay", "jitter", "cut", "corrupt", "clock_jump")
GAPS_S = st.lists(st.floats(0.0, 0.01), min_size=1, max_size=60)


def lane(*faults: dict[str, Any], channel: str = "joints", seed: int = 0) -> Lane:
    """Return a channel all of whose messages meet these faults."""
    table = {
        "name": "test",
        "fault": [{"topics": ["joints", "imu"], **fault} for fault in faults],
    }
    return Lane(convert(table, RelayPlan, source="test"), channel, seed=seed)


def passed(through: Lane, times_s: list[float]) -> list[list[Parcel]]:
    """Return the fate of messages 0, 1, 2, ... that arrive at these times."""
    return [
        through.pass_on(encode(message("joints", tick)), now_s=at, elapsed_s=at)
        for tick, at in enumerate(times_s)
    ]


def at_times(gaps_s: list[float]) -> list[float]:
    """Return times with these gaps between them."""
    return [sum(gaps_s[: index + 1]) for index in range(len(gaps_s))]


def every_ms(count: int) -> list[float]:
    """Return times that are a millisecond apart."""
    return [tick * PERIOD_S for tick in range(count)]


def ticks(groups: list[list[Parcel]]) -> list[int]:
    """Return the numbers of the messages in the order in which they leave."""
    leaving = sorted((p for group in groups for p in group), key=lambda p: p.at_s)
    return [decode(parcel.data, JointState).tick for parcel in leaving]


@QUICK
@given(GAPS_S, st.lists(FAULTS, max_size=4), st.integers(0, 9))
def test_same_plan_seed_and_arrivals_give_the_same_departures(
    gaps_s: list[float], faults: list[dict[str, Any]], seed: int
) -> None:
    one, two = lane(*faults, seed=seed), lane(*faults, seed=seed)
    assert passed(one, at_times(gaps_s)) == passed(two, at_times(gaps_s))
    assert one.counts == two.counts


@QUICK
@given(GAPS_S, st.lists(FAULTS, max_size=4))
def test_nothing_leaves_before_it_came(
    gaps_s: list[float], faults: list[dict[str, Any]]
) -> None:
    times_s = at_times(gaps_s)
    groups = passed(lane(*faults), times_s)
    for came_s, group in zip(times_s, groups, strict=True):
        assert all(parcel.at_s >= came_s for parcel in group)


@QUICK
@given(
    GAPS_S, st.lists(FAULTS.filter(lambda fault: fault["kind"] in IN_ORDER), max_size=4)
)
def test_only_reordering_and_late_copies_break_the_order(
    gaps_s: list[float], faults: list[dict[str, Any]]
) -> None:
    groups = passed(lane(*faults), at_times(gaps_s))
    leaving = [parcel.at_s for group in groups for parcel in group]
    assert leaving == sorted(leaving)


@QUICK
@given(GAPS_S, st.lists(FAULTS, max_size=4))
def test_before_the_first_command_nothing_is_touched(
    gaps_s: list[float], faults: list[dict[str, Any]]
) -> None:
    through = lane(*faults)
    for tick, at_s in enumerate(at_times(gaps_s)):
        data = encode(message("joints", tick))
        assert through.pass_on(data, now_s=at_s, elapsed_s=None) == [Parcel(at_s, data)]


@QUICK
@given(GAPS_S)
def test_channels_without_faults_pass_unchanged(gaps_s: list[float]) -> None:
    through = lane({"kind": "drop", "probability": 1.0}, channel="status")
    times_s = at_times(gaps_s)
    groups = passed(through, times_s)
    for tick, (at_s, group) in enumerate(zip(times_s, groups, strict=True)):
        assert group == [Parcel(at_s, encode(message("joints", tick)))]


@pytest.mark.parametrize("kind", ["drop", "duplicate", "reorder", "corrupt"])
@pytest.mark.parametrize("share", [0.05, 0.5])
def test_chance_hits_the_share_asked_for(kind: str, share: float) -> None:
    through = lane({"kind": kind, "probability": share})
    passed(through, every_ms(MANY))
    sigma = (MANY * share * (1.0 - share)) ** 0.5
    assert abs(through.counts[kind] - MANY * share) < SIGMAS * sigma


def test_what_is_lost_of_one_channel_says_nothing_of_another() -> None:
    fault = {"kind": "drop", "probability": 0.5}
    joints, imu = (
        [bool(group) for group in passed(lane(fault, channel=name), every_ms(200))]
        for name in ("joints", "imu")
    )
    assert joints != imu


def test_one_more_fault_leaves_the_chance_of_the_others_alone() -> None:
    fault = {"kind": "drop", "probability": 0.5}
    alone = passed(lane(fault), every_ms(200))
    more = passed(lane(fault, {"kind": "jitter", "ms": 3.0}), every_ms(200))
    assert [bool(group) for group in alone] == [bool(group) for group in more]


def test_a_delay_is_the_same_for_all() -> None:
    for tick, (parcel,) in enumerate(
        passed(lane({"kind": "delay", "ms": 4.0}), every_ms(50))
    ):
        assert abs(parcel.at_s - tick * PERIOD_S - 0.004) < EPSILON_S


def test_jitter_stays_below_its_limit_and_spreads() -> None:
    groups = passed(lane({"kind": "jitter", "ms": 5.0}), [float(i) for i in range(500)])
    late = [parcel.at_s - tick for tick, (parcel,) in enumerate(groups)]
    assert all(0.0 <= seconds <= 0.005 + EPSILON_S for seconds in late)
    assert min(late) < 0.001
    assert max(late) > 0.004


def test_a_message_kept_back_is_overtaken_by_the_next_two() -> None:
    through = lane(
        {"kind": "reorder", "probability": 1.0, "ms": 2.5, "duration_s": 0.0005}
    )
    assert ticks(passed(through, every_ms(5))) == [1, 2, 0, 3, 4]


def test_a_copy_comes_after_its_original() -> None:
    through = lane({"kind": "duplicate", "probability": 1.0, "ms": 1.5})
    groups = passed(through, every_ms(3))
    assert all(first.data == copy.data for first, copy in groups)
    assert ticks(groups) == [0, 1, 0, 2, 1, 2]


def test_a_cut_loses_all_that_comes_meanwhile_and_nothing_else() -> None:
    through = lane({"kind": "cut", "start_s": 0.0095, "duration_s": 0.010})
    groups = passed(through, every_ms(30))
    assert [t for t, group in enumerate(groups) if not group] == list(range(10, 20))
    assert through.counts == {"arrived": 30, "left": 20, "cut": 10}


@QUICK
@given(st.integers(1, 64))
def test_so_many_bits_are_flipped_as_asked_for(bits: int) -> None:
    original = encode(message("joints", 7))
    fault = {"kind": "corrupt", "probability": 1.0, "bits": bits}
    (parcel,) = lane(fault).pass_on(original, now_s=0.0, elapsed_s=0.0)
    pairs = zip(original, parcel.data, strict=True)
    assert sum((before ^ after).bit_count() for before, after in pairs) == bits


@pytest.mark.parametrize("seconds", [2.5, -60.0])
def test_a_clock_jump_moves_the_stamp_alone_and_never_below_zero(
    seconds: float,
) -> None:
    before = message("joints", 7)
    through = lane({"kind": "clock_jump", "seconds": seconds})
    (parcel,) = through.pass_on(encode(before), now_s=0.0, elapsed_s=0.0)
    moved_ns = max(0, before.stamp_ns + round(seconds * 1e9))
    expected = msgspec.structs.replace(before, stamp_ns=moved_ns)
    assert decode(parcel.data, JointState) == expected


@QUICK
@given(st.binary(max_size=40))
def test_what_is_no_message_keeps_its_bytes_in_a_clock_jump(data: bytes) -> None:
    through = lane({"kind": "clock_jump", "seconds": 1.0})
    assert through.pass_on(data, now_s=0.0, elapsed_s=0.0) == [Parcel(0.0, data)]
