"""A foot that is caught by an edge goes back, higher, and on."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import WalkSettings
from surefoot.stabilizer.walking.footsteps import Foothold, LegSpeed, turned
from surefoot.stabilizer.walking.ground import ExpectedGround
from surefoot.stabilizer.walking.step_queue import Move
from surefoot.stabilizer.walking.swing_foot import BACK_M, FREE_S, SwingFoot

SETTINGS = WalkSettings()
DT, MOST_N = 1e-3, 70.0
MOVE = Move(3, 0, Foothold(0.4, 0.1, 0.0, 0.0), 0.6, 0.2, 0.05)


def soles(*, x: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> Any:
    return SimpleNamespace(
        p_sole=[np.array([x, 0.1, z]), np.array([0.2, -0.1, 0.0])],
        R_world_sole=[turned(yaw), turned(yaw)],
    )


@pytest.fixture
def swing() -> SwingFoot:
    ground = ExpectedGround(SETTINGS, half_sizes=[(0.13, 0.07)] * 2, period_s=DT)
    swing = SwingFoot(
        SETTINGS,
        ground,
        lead_s=0.0,
        leg_speed=LegSpeed(8.0),
        weight=MOST_N / SETTINGS.caught_share,
        period_s=DT,
    )
    swing.lift(MOVE, soles(), rise=0.0, climb=0.0)
    return swing


def feels(swing: SwingFoot, here: Any, F: Array, *, ticks: int) -> bool:
    told = [swing.is_caught(0, here, F) for _ in range(ticks)]
    return told[-1]


@pytest.mark.parametrize(
    ("along", "up", "caught"),
    [
        (-200.0, -100.0, True),
        (-200.0, 150.0, True),
        (-200.0, 400.0, False),  # ground below rubs
        (-50.0, 0.0, False),  # its own mass, speeding up
        (200.0, 0.0, False),  # pushed ahead
    ],
)
@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_what_is_in_the_way_pushes_back_more_than_up(
    swing: SwingFoot, along: float, up: float, caught: bool, yaw: float
) -> None:
    F = np.zeros(6)
    F[:3] = [along, 0.0, up] @ turned(yaw)
    here = soles(yaw=yaw)
    assert not feels(swing, here, F, ticks=2)
    assert feels(swing, here, F, ticks=1) is caught


def test_it_goes_back_higher_and_on(swing: SwingFoot) -> None:
    t = 0.2
    for tick in range(round(t / DT)):
        swing.go_on(0, soles(), t=tick * DT, duration_s=0.6, shift=(0.0, 0.0))
    here = soles(x=0.1, z=0.04)
    move, left_s = swing.step_over(MOVE, here, t=t, left_s=0.4, rise=0.0)
    assert move is MOVE
    assert left_s >= MOVE.single_s
    assert swing.least_left_s(MOVE, (0.0, 0.0)) < left_s
    reference, heights = swing.references[0], []
    for tick in range(round(left_s / DT) + 1):
        now = t + tick * DT
        swing.go_on(0, here, t=now, duration_s=t + left_s, shift=(0.0, 0.0))
        heights.append(reference.p[2])
        if tick == 0:
            start = [0.1 - BACK_M, 0.1, 0.04]
            np.testing.assert_allclose(reference.p, start, atol=1e-6)
    highest = MOVE.height_m + SETTINGS.step_over_m
    assert max(heights) == pytest.approx(highest, abs=1e-6)
    np.testing.assert_allclose(reference.p[:2], MOVE.place[:2], atol=1e-9)


def test_it_has_time_to_come_free_before_it_is_caught_again(swing: SwingFoot) -> None:
    F, here = np.array([-300.0, 0.0, -50.0, 0.0, 0.0, 0.0]), soles(x=0.1, z=0.04)
    assert feels(swing, here, F, ticks=3)
    _, left_s = swing.step_over(MOVE, here, t=0.2, left_s=0.4, rise=0.0)
    told = []
    for tick in range(round(2.0 * FREE_S / DT)):
        now = 0.2 + tick * DT
        swing.go_on(0, here, t=now, duration_s=0.2 + left_s, shift=(0.0, 0.0))
        told.append(swing.is_caught(0, here, F))
    assert not any(told[: round(FREE_S / DT)])
    assert told[-1]


def test_what_is_too_high_ends_the_step_where_the_foot_is(swing: SwingFoot) -> None:
    here = soles(x=0.1, z=0.04)
    highest, move = MOVE.height_m, MOVE
    while move is MOVE and highest < 1.0:
        move, _ = swing.step_over(MOVE, here, t=0.2, left_s=0.4, rise=0.0)
        highest += SETTINGS.step_over_m
    assert SETTINGS.rise_limit_m < highest < SETTINGS.rise_limit_m + 0.04
    assert move.place[:2] == pytest.approx((0.1 - BACK_M, 0.1))
    F = np.array([-300.0, 0.0, -50.0, 0.0, 0.0, 0.0])
    assert not feels(swing, here, F, ticks=1000)


def test_a_foot_that_bounced_goes_down_as_one_that_finds_no_ground(
    swing: SwingFoot,
) -> None:
    v, due_s = swing.references[0].v, MOVE.single_s
    for since_s in (0.0, 0.01, 0.03, 0.06, 0.2):
        swing.go_down(0, soles(), (0.0, 0.1), yaw=0.0, since_s=since_s)
        bounced = v[2]
        swing.go_on(0, soles(), t=due_s + since_s, duration_s=due_s, shift=(0.0, 0.0))
        assert bounced == pytest.approx(v[2])
    swing.go_down(0, soles(), (0.0, 0.1), yaw=0.0, since_s=math.inf)
    assert v[2] == bounced == pytest.approx(-SETTINGS.late_m_s)
