"""Plans that cannot be walked are refused; feet come together at the end."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.schemas.messages import SCHEMA_VERSION
from surefoot.schemas.settings import WalkSettings
from surefoot.schemas.walk_plan import Step, WalkPlan
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.walking.footsteps import Foothold, LegSpeed, leg_speed_of
from surefoot.stabilizer.walking.step_queue import CLOSING_ID, StepQueue
from tests.support import with_speeds

NEAREST_M = 0.17
HALF_M = 0.11
LEFT, RIGHT = Foothold(0.0, HALF_M, 0.0, 0.0), Foothold(0.0, -HALF_M, 0.0, 0.0)
FEET = [LEFT, RIGHT]
LIMITS = WalkSettings()


def step(number: int = 0, **changes: Any) -> Step:
    side = "left" if number % 2 == 0 else "right"
    y = HALF_M if side == "left" else -HALF_M
    table = {
        "id": number,
        "side": side,
        "position": [0.2 * (number + 1), y, 0.0],
        "yaw": 0.0,
        "single_s": 0.6,
        "double_s": 0.2,
        "height_m": 0.05,
    }
    return Step(**{**table, **changes})


def plan(*steps: Step) -> WalkPlan:
    return WalkPlan(
        schema=SCHEMA_VERSION, tick=0, stamp_ns=0, begin_tick=0, steps=list(steps)
    )


@pytest.fixture
def queue() -> StepQueue:
    return StepQueue(LIMITS, half_width=HALF_M, nearest=NEAREST_M)


def test_the_other_foot_comes_beside_the_last_step(queue: StepQueue) -> None:
    assert queue.take(plan(step(0), step(1)), FEET, walks=False) == ""
    *moves, closing = queue.ahead(FEET, 5)
    assert [move.id for move in moves] == [0, 1]
    assert (closing.id, closing.side) == (CLOSING_ID, 0)
    assert closing.place.seen_from(moves[-1].place) == pytest.approx(
        (0.0, 2.0 * HALF_M, 0.0)
    )


def test_feet_that_are_together_need_no_closing_step(queue: StepQueue) -> None:
    beside = step(1, position=[0.2, -HALF_M, 0.0])
    queue.take(plan(step(0), beside), FEET, walks=False)
    assert [move.id for move in queue.ahead(FEET, 5)] == [0, 1]


def test_steps_begun_are_passed_over_and_the_rest_replaced(queue: StepQueue) -> None:
    queue.take(plan(step(0), step(1), step(2)), FEET, walks=False)
    queue.begin(FEET)
    again = plan(step(0), step(1, height_m=0.08))
    feet = [Foothold(0.2, HALF_M, 0.0, 0.0), RIGHT]
    assert queue.take(again, feet, walks=True) == ""
    assert [(m.id, m.height_m) for m in queue.ahead(feet, 1)] == [(1, 0.08)]
    assert queue.planned == 2


def test_a_planner_that_counts_anew_is_told_where_ids_go_on(queue: StepQueue) -> None:
    first = step(8, position=[0.2, HALF_M, 0.0])
    queue.take(plan(first), FEET, walks=False)
    feet = [queue.begin(FEET).place, RIGHT]
    assert queue.take(plan(first), feet, walks=True) == ""  # late, and no fault
    assert "end with 1, and step 8 has" in queue.take(
        plan(step(0), step(1)), feet, walks=True
    )


def test_an_empty_plan_brings_the_feet_together(queue: StepQueue) -> None:
    queue.take(plan(step(0), step(1)), FEET, walks=False)
    queue.begin(FEET)
    feet = [Foothold(0.2, HALF_M, 0.0, 0.0), RIGHT]
    assert queue.take(plan(), feet, walks=True) == ""
    (closing,) = queue.ahead(feet, 3)
    assert (closing.id, closing.place.x) == (CLOSING_ID, pytest.approx(0.2))
    assert queue.planned == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"position": [0.9, HALF_M, 0.0]}, "ahead of the other"),
        ({"position": [0.2, 0.0, 0.0]}, "beside the other"),
        ({"position": [0.2, 0.5, 0.0]}, "beside the other"),
        ({"yaw": 1.0}, "turned by"),
        ({"position": [0.2, HALF_M, 0.4]}, "higher"),
    ],
)
def test_what_no_robot_can_step_to_is_refused(
    queue: StepQueue, change: dict[str, Any], words: str
) -> None:
    why = queue.take(plan(step(0, **change)), FEET, walks=False)
    assert words in why
    assert "step 0" in why
    assert len(queue) == 0


@pytest.mark.parametrize(
    ("place", "yaw", "over_mm"),
    [
        ([0.04, 0.17, 0.0], -0.6, 48),
        ([-0.04, 0.17, 0.0], 0.6, 48),
        ([0.0, 0.21, 0.0], -0.6, 8),
        ([0.0, 0.22, 0.0], -0.6, 0),
        ([0.0, 0.17, 0.0], 0.0, 0),
        ([0.3, 0.17, 0.0], -0.6, 0),  # past the other one's toe
    ],
)
def test_no_sole_is_set_on_the_other_one(
    place: list[float], yaw: float, over_mm: int
) -> None:
    soles = [(0.1357, 0.0774)] * 2
    queue = StepQueue(LIMITS, half_width=HALF_M, nearest=0.1698, soles=soles)
    feet = [Foothold(0.0, 0.22, 0.0, 0.0), Foothold(0.0, 0.0, 0.0, 0.0)]
    why = queue.take(plan(step(0, position=place, yaw=yaw)), feet, walks=False)
    words = f"step 0, left foot: its sole would stand on the other one by {over_mm} mm"
    assert why == (words if over_mm else "")


def test_the_foot_on_its_way_cannot_be_next(queue: StepQueue) -> None:
    queue.take(plan(step(0)), FEET, walks=False)
    queue.begin(FEET)
    why = queue.take(plan(step(2)), FEET, walks=True)
    assert "on its way" in why


@pytest.mark.parametrize("walked", [False, True])
def test_while_the_weight_shifts_only_the_leaving_foot_can_be_first(
    queue: StepQueue, walked: bool
) -> None:
    if walked:  # and brought the right foot beside the left one last
        queue.take(plan(step(0)), FEET, walks=False)
        queue.begin(FEET)
        queue.begin([Foothold(0.2, HALF_M, 0.0, 0.0), RIGHT])
    queue.take(plan(step(3, position=[0.2, -HALF_M, 0.0])), FEET, walks=False)
    queue.leaving = 1
    assert "shifts onto" in queue.take(plan(step(4)), FEET, walks=True)
    again = plan(step(5, position=[0.2, -HALF_M, 0.0]))
    assert queue.take(again, FEET, walks=True) == ""
    assert queue.begin(FEET).side == 1
    assert queue.leaving is None


@pytest.mark.parametrize("leaving", [0, 1])
def test_given_up_in_the_shift_the_leaving_foot_closes(
    queue: StepQueue, leaving: int
) -> None:
    queue.take(plan(step(0)), FEET, walks=False)
    queue.begin(FEET)
    feet = [Foothold(0.2, HALF_M, 0.0, 0.0), RIGHT]  # a walk that ended so
    queue.leaving = leaving
    assert queue.take(plan(), feet, walks=True) == ""
    (closing,) = queue.ahead(feet, 3)
    assert (closing.id, closing.side) == (CLOSING_ID, leaving)
    assert abs(closing.place.seen_from(feet[1 - leaving])[0]) < 1e-9


def test_a_shift_moves_all_that_is_to_come(queue: StepQueue) -> None:
    queue.take(plan(step(0), step(1)), FEET, walks=False)
    before = [move.place for move in queue.ahead(FEET, 2)]
    queue.shift_by(0.05, -0.02)
    for old, move in zip(before, queue.ahead(FEET, 2), strict=True):
        assert (move.place.x - old.x, move.place.y - old.y) == pytest.approx(
            (0.05, -0.02)
        )


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        ((step(0), step(0)), "must grow"),
        ((step(0), step(2)), "take turns"),
    ],
)
def test_messages_in_disorder_are_refused(steps: tuple[Step, ...], words: str) -> None:
    raw = msgspec.to_builtins(plan(step(0)))
    raw["steps"] = [msgspec.to_builtins(one) for one in steps]
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(raw, WalkPlan)


def test_a_turn_takes_as_long_as_the_hip_needs() -> None:
    turned = {"yaw": 0.3}
    times = []
    for speed in (LegSpeed(10.0, 10.0), LegSpeed(10.0, 0.3), LegSpeed(10.0, 0.15)):
        queue = StepQueue(LIMITS, half_width=HALF_M, nearest=NEAREST_M, leg_speed=speed)
        queue.take(plan(step(0, **turned)), FEET, walks=False)
        times.append(queue.begin(FEET).single_s)
    assert times[0] == step(0).single_s
    assert times[2] == pytest.approx(2.0 * times[1])


def test_a_leg_turns_as_fast_as_its_hip(walker: Robot) -> None:
    """The Walker's hip yaw is vertical; its other joints do not turn a foot."""
    for speed, expected in ((8.0, 8.0), (0.3, 0.3), (0.01, math.inf)):
        slow = with_speeds(walker, speed, only="hip_yaw")
        assert leg_speed_of(RobotModel(slow)).turn == pytest.approx(expected, rel=0.01)


def test_a_step_takes_as_long_as_the_drives_need() -> None:
    times = []
    for leg_speed in (LegSpeed(10.0), LegSpeed(0.5)):
        queue = StepQueue(
            LIMITS, half_width=HALF_M, nearest=NEAREST_M, leg_speed=leg_speed
        )
        queue.take(plan(step(0)), FEET, walks=False)
        times.append(queue.begin(FEET).single_s)
    assert times[0] == step(0).single_s
    assert times[1] > times[0]
