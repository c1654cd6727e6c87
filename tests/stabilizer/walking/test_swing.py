"""The swing path is smooth, ends at rest over its goal, and continues downward."""

from __future__ import annotations

import math

import pytest

from surefoot.schemas.settings import WalkSettings
from surefoot.stabilizer.walking.swing import LATE_RAMP_S, SwingPath, from_rest, glide

SETTINGS = WalkSettings()
DURATION_S, LIFT_M, DT = 0.6, 0.05, 1e-3
FINE_S = 1e-5
SLOPE = 1e-3
NONE = (0.0, 0.0)


def begun(
    *, rise: float = 0.0, height: float = 0.0, turn: float = 0.4, climb: float = 0.0
) -> SwingPath:
    path = SwingPath(SETTINGS)
    path.begin(
        xy=(0.1, 0.2),
        yaw=0.1,
        height=height,
        target=(0.3, 0.25),
        target_yaw=0.1 + turn,
        rise=rise,
        lift=LIFT_M,
        duration_s=DURATION_S,
        climb=climb,
    )
    return path


@pytest.mark.parametrize("t", [0.05, 0.2, 0.31, 0.45, 0.59, 0.7])
def test_rates_are_the_slopes(t: float) -> None:
    early, now, late = begun(), begun(), begun()
    for path, at in ((early, t - FINE_S), (now, t), (late, t + FINE_S)):
        path.advance(at, duration_s=DURATION_S, shift=NONE, dt=DT)
    for axis in range(2):
        slope = (late.xy[axis] - early.xy[axis]) / (2.0 * FINE_S)
        assert now.xy_rate[axis] == pytest.approx(slope, abs=SLOPE)
        slope = (late.xy_rate[axis] - early.xy_rate[axis]) / (2.0 * FINE_S)
        assert now.xy_acceleration[axis] == pytest.approx(slope, abs=SLOPE)
    slope = (late.height - early.height) / (2.0 * FINE_S)
    assert now.height_rate == pytest.approx(slope, abs=SLOPE)
    assert now.yaw_rate == pytest.approx(
        (late.yaw - early.yaw) / (2.0 * FINE_S), abs=SLOPE
    )
    assert now.velocity_after(0.0)[2] == now.height_rate


@pytest.mark.parametrize("climb", [0.03, 0.1, 0.2, -0.04, -0.15])
def test_a_foot_passes_the_edge_of_a_stair_above_it(climb: float) -> None:
    """Wherever between both footholds that edge is."""
    path = begun(rise=climb, climb=climb)
    higher, times = max(climb, 0.0), [DT * k for k in range(round(DURATION_S / DT))]
    for t in times:
        path.advance(t, duration_s=DURATION_S, shift=NONE, dt=DT)
        way = (path.xy[0] - 0.1) / 0.2
        if path.height < higher - 1e-4:
            assert way == 0.0 if climb > 0.0 else way == pytest.approx(1.0)
    assert way == pytest.approx(1.0)


@pytest.mark.parametrize("rise", [-0.1, 0.0, 0.1])
@pytest.mark.parametrize("height", [-0.1, 0.0])
def test_foot_clears_both_footholds_and_comes_down_softly(
    rise: float, height: float
) -> None:
    path = begun(rise=rise, height=height)
    path.advance(
        SETTINGS.apex_part * DURATION_S, duration_s=DURATION_S, shift=NONE, dt=DT
    )
    assert path.height == pytest.approx(max(rise, height) + LIFT_M)
    path.advance(DURATION_S, duration_s=DURATION_S, shift=NONE, dt=DT)
    assert path.height == pytest.approx(rise)
    assert path.xy == pytest.approx((0.3, 0.25))
    assert path.xy_rate == pytest.approx(NONE)
    path.advance(DURATION_S - FINE_S, duration_s=DURATION_S, shift=NONE, dt=DT)
    assert path.height_rate == pytest.approx(-SETTINGS.touchdown_m_s, rel=0.01)


def test_a_foot_that_finds_no_ground_goes_down_so_far_and_no_farther() -> None:
    path = begun()
    path.advance(DURATION_S + 0.1, duration_s=DURATION_S, shift=NONE, dt=DT)
    assert path.height_rate == pytest.approx(-SETTINGS.late_m_s)
    fallen = (0.1 - LATE_RAMP_S) * SETTINGS.late_m_s
    fallen += 0.5 * (SETTINGS.touchdown_m_s + SETTINGS.late_m_s) * LATE_RAMP_S
    assert path.height == pytest.approx(-fallen)
    path.advance(DURATION_S + 10.0, duration_s=DURATION_S, shift=NONE, dt=DT)
    assert (path.height, path.height_rate) == (-SETTINGS.late_depth_m, 0.0)


def test_the_foot_turns_the_short_way() -> None:
    path = begun(turn=math.tau - 0.2)
    path.advance(DURATION_S, duration_s=DURATION_S, shift=NONE, dt=DT)
    assert path.yaw == pytest.approx(0.1 - 0.2)


def test_a_shift_of_the_goal_reaches_the_foot_without_a_jump() -> None:
    path, last = begun(), (0.1, 0.2)
    for tick in range(700):
        path.advance(tick * DT, duration_s=DURATION_S, shift=(0.1, 0.0), dt=DT)
        assert abs(path.xy[0] - last[0]) < 2.0 * DT
        last = path.xy
    assert path.xy[0] == pytest.approx(0.4, abs=1e-4)


@pytest.mark.parametrize("wanted_s", [0.45, 0.5, 0.7, 0.85])
def test_a_foot_that_is_to_be_down_at_another_time_is(wanted_s: float) -> None:
    """It changes its pace without a jump, and its rates stay the slopes."""
    path, before = begun(), 0.1
    for tick in range(1, round(wanted_s / DT) + 1):
        t = tick * DT
        wanted = DURATION_S if t < 0.15 else wanted_s
        path.advance(t, duration_s=wanted, shift=NONE, dt=DT)
        if t < wanted_s - 1.5 * DT:
            assert path.xy_rate[0] == pytest.approx(
                (path.xy[0] - before) / DT, abs=0.02
            )
        before = path.xy[0]
    assert path.xy == pytest.approx((0.3, 0.25), abs=1e-6)
    assert path.height == pytest.approx(0.0, abs=1e-6)


def test_profiles_keep_their_ends() -> None:
    assert glide(0.0) == (0.0, 0.0, 0.0)
    assert glide(1.0) == (1.0, 0.0, 0.0)
    assert from_rest(0.0, 0.5, 1.0, 3.0, 4.0) == (1.0, 0.0, 0.0)
    assert from_rest(0.5, 0.5, 1.0, 3.0, 4.0) == pytest.approx((3.0, 4.0, 0.0))


def test_a_glide_is_slower_than_a_quintic_at_its_fastest() -> None:
    assert max(glide(i / 100)[1] for i in range(101)) < 0.85 * 1.875
