"""A velocity becomes footsteps that a robot can take."""

from __future__ import annotations

import itertools
import math

import msgspec
import pytest

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.schemas.settings import WalkSettings
from surefoot.schemas.walk_plan import MOST_STEPS, Step, Walk, WalkPlan
from surefoot.stabilizer.walking.footsteps import (
    SIDES,
    Foothold,
    Pace,
    half_width_of,
    plan_of,
    steps_at,
)
from surefoot.stabilizer.walking.step_queue import StepQueue

NEAREST_M = 0.17
HALF_M = 0.11
ORIGIN = Foothold(0.0, 0.0, 0.0, 0.0)
PACES = {
    "ahead": (0.25, 0.0, 0.0),
    "back": (-0.2, 0.0, 0.0),
    "left": (0.0, 0.1, 0.0),
    "right": (0.0, -0.1, 0.0),
    "turn": (0.1, 0.0, 0.3),
    "turn right on the spot": (0.0, 0.0, -0.3),
    "all at once": (0.15, -0.05, 0.2),
}


def steps(name: str, count: int = 12) -> list[Step]:
    pace = Pace(*PACES[name], single_s=0.6, double_s=0.2, height_m=0.05)
    endless = steps_at(pace, ORIGIN, half_width=HALF_M, first_id=5)
    return list(itertools.islice(endless, count))


def places(some: list[Step]) -> list[tuple[int, Foothold]]:
    return [(SIDES.index(s.side), Foothold(*s.position, s.yaw)) for s in some]


@pytest.mark.parametrize("name", PACES)
def test_feet_never_come_nearer_than_standing(name: str) -> None:
    feet = [ORIGIN.beside(0.0, HALF_M), ORIGIN.beside(0.0, -HALF_M)]
    for side, place in places(steps(name)):
        feet[side] = place
        _, y, yaw = feet[0].seen_from(feet[1])
        assert y > 2.0 * HALF_M * math.cos(yaw) - 0.02
        outward = yaw if PACES[name][2] else 0.0
        assert outward >= -1e-9


@pytest.mark.parametrize("name", PACES)
def test_two_steps_go_as_far_as_the_velocity_says(name: str) -> None:
    ahead, lateral, turn = PACES[name]
    (_, one), (_, two) = places(steps(name))[1::2][:2]
    x, y, yaw = two.seen_from(one)
    assert yaw == pytest.approx(1.6 * turn)
    if not turn:
        assert (x, y) == pytest.approx((1.6 * ahead, 1.6 * lateral))


@pytest.mark.parametrize("name", PACES)
def test_steps_can_be_walked(name: str) -> None:
    from surefoot.schemas.messages import SCHEMA_VERSION

    plan = WalkPlan(
        schema=SCHEMA_VERSION, tick=0, stamp_ns=0, begin_tick=0, steps=steps(name)
    )
    queue = StepQueue(WalkSettings(), half_width=HALF_M, nearest=NEAREST_M)
    feet = [ORIGIN.beside(0.0, HALF_M), ORIGIN.beside(0.0, -HALF_M)]
    assert queue.take(plan, feet, walks=False) == ""
    assert [step.id for step in plan.steps] == list(range(5, 17))


def test_a_circle_closes() -> None:
    turns = round(math.tau / (0.3 * 0.8))
    (_, first), *_, (_, last) = places(steps("turn", count=2 * turns))[1::2]
    radius = math.hypot(first.x - last.x, first.y - last.y)
    assert radius < 4.0 * 0.1 / 0.3


def test_a_walk_without_an_end_stops_in_time(walker: Robot) -> None:
    settings = WalkSettings()
    plan = plan_of(
        Walk(velocity_m_s=0.25, start_s=1.0), walker, settings, duration_s=10.0
    )
    period = 0.8
    ends_s = 1.0 + settings.shift_s + (len(plan.steps) + 1) * period + settings.settle_s
    assert 8.0 <= ends_s + 1e-9 <= 9.0 + 1e-6 + period
    assert plan.begin_tick == 1000


def test_width_is_that_of_the_nominal_stance(walker: Robot) -> None:
    assert half_width_of(walker) == pytest.approx(0.11)


def test_slow_drives_take_fewer_steps_in_the_same_time(walker: Robot) -> None:
    quick = Walk(velocity_m_s=0.46, start_s=1.0, step_s=0.5, double_s=0.15)
    slow_drives = load_robot("walker", servo_profile="harmonic")
    counts = [
        len(plan_of(quick, robot, WalkSettings(), duration_s=20.0).steps)
        for robot in (walker, slow_drives)
    ]
    assert counts[1] < counts[0]


def test_footsteps_of_a_velocity_end_with_the_run(walker: Robot) -> None:
    walk = Walk(velocity_m_s=0.25, start_s=1.0, stop_s=3600.0)
    settings = WalkSettings()
    plan = plan_of(walk, walker, settings, duration_s=9.0)
    last_s = 1.0 + settings.shift_s + (len(plan.steps) - 1) * 0.8
    assert 9.0 - 0.8 < last_s <= 9.0


def test_an_hour_of_the_shortest_steps_is_a_plan(walker: Robot) -> None:
    walk = Walk(start_s=0.0, stop_s=3600.0, step_s=0.2, double_s=0.05)
    plan = plan_of(walk, walker, WalkSettings(), duration_s=3600.0)
    assert 10000 < len(plan.steps) <= MOST_STEPS
    assert msgspec.convert(msgspec.to_builtins(plan), WalkPlan) == plan


def test_an_arc_back_is_one() -> None:
    """Heading and middle go where the velocity says, whichever foot opens."""
    pace = Pace(-0.2, 0.0, 0.3, single_s=0.6, double_s=0.2, height_m=0.05)
    endless = steps_at(pace, ORIGIN, half_width=HALF_M, first_id=0)
    taken = places(list(itertools.islice(endless, 12)))
    assert taken[0][0] == 1  # the right one is outside: going back it is the leading
    last = taken[-1][1]
    assert last.yaw == pytest.approx(12 * 0.8 * 0.3)
    middle = last.beside(0.0, -HALF_M)
    radius = 0.2 / 0.3
    assert math.hypot(middle.x, middle.y + radius) == pytest.approx(radius, abs=0.03)
