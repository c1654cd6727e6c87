"""A planner continues from the feet's present footholds, with increasing ids."""

from __future__ import annotations

import itertools
import math
import random

import msgspec
import pytest

from surefoot import planner as planner_module
from surefoot.planner import STEPS_AHEAD, VelocityPlanner, walk_on_bus
from surefoot.robot_io.errors import RobotUnreachableError
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.messages import SCHEMA_VERSION, RobotMode, RobotStatus
from surefoot.schemas.reasons import ModeCause
from surefoot.schemas.settings import WalkSettings
from surefoot.schemas.walk_plan import WalkPlan, WalkStatus
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.walking.footsteps import Foothold, Pace
from surefoot.stabilizer.walking.step_queue import StepQueue

HALF_M = 0.11
SOLES = RobotModel(load_robot("walker")).half_sizes
NEAREST_M = sum(width for _, width in SOLES) + WalkSettings().between_soles_m
PACE = Pace(0.25, 0.0, 0.0, single_s=0.6, double_s=0.2, height_m=0.05)
STATUS = WalkStatus(
    schema=SCHEMA_VERSION,
    tick=4000,
    stamp_ns=0,
    phase="single",
    phase_s=0.1,
    moved="left",
    last_step=6,
    steps_done=6,
    steps_planned=9,
    foot_left="swing",
    foot_right="planted",
    foothold_left=[1.0, 0.11, 0.0, 0.0],
    foothold_right=[1.0, -0.11, 0.0, 0.0],
    goal_left=[1.2, 0.11, 0.0, 0.0],
    goal_right=[1.0, -0.11, 0.0, 0.0],
    ahead=[],
    shift=[0.0, 0.0],
    dcm=[1.0, 0.0],
    dcm_reference=[1.0, 0.0],
    zmp_reference=[1.0, 0.0],
    plan_stamp_ns=0,
    refusal="",
)
AHEAD, ASIDE, TURN = (
    (-0.4, -0.2, 0.0, 0.2, 0.4),
    (-0.1, -0.05, 0.0, 0.05, 0.1),
    (-20.0, -10.0, 0.0, 10.0, 20.0),
)
"""Values up to the limits of the live page [m/s, deg/s]."""


@pytest.fixture
def planner() -> VelocityPlanner:
    return VelocityPlanner(PACE, half_width=HALF_M)


def test_first_plan_begins_in_the_nominal_stance(planner: VelocityPlanner) -> None:
    plan = planner.plan(None)
    assert [step.id for step in plan.steps] == list(range(STEPS_AHEAD))
    assert plan.steps[0].position == pytest.approx([0.2, HALF_M, 0.0])


def test_goes_on_with_the_other_foot_from_the_one_in_the_air(
    planner: VelocityPlanner,
) -> None:
    first = planner.plan(STATUS).steps[0]
    assert (first.id, first.side) == (7, "right")
    assert first.position == pytest.approx([1.4, -HALF_M, 0.0])


def test_a_new_velocity_counts_from_the_next_step_on(planner: VelocityPlanner) -> None:
    planner.pace = PACE._replace(ahead=0.0)
    first = planner.plan(STATUS).steps[0]
    assert first.position == pytest.approx([1.2, -HALF_M, 0.0])


@pytest.mark.parametrize("lateral", [-0.1, 0.0, 0.1])
@pytest.mark.parametrize(("onto", "leaving"), [("left", "right"), ("right", "left")])
def test_while_the_weight_shifts_the_leaving_foot_is_first(
    planner: VelocityPlanner, lateral: float, onto: str, leaving: str
) -> None:
    planner.pace = PACE._replace(lateral=lateral)
    status = msgspec.structs.replace(STATUS, phase="shift", moved=onto)
    assert planner.plan(status).steps[0].side == leaving


def test_no_steps_is_a_plan_too(planner: VelocityPlanner) -> None:
    assert planner.plan(STATUS, count=0).steps == []


@pytest.mark.parametrize("ahead", [-0.1, 0.0, 0.4])
@pytest.mark.parametrize("yaw_rate", [-0.3, 0.0, 0.3])
def test_plans_are_taken_on_the_way(
    planner: VelocityPlanner, ahead: float, yaw_rate: float
) -> None:
    planner.pace = PACE._replace(ahead=ahead, yaw_rate=yaw_rate)
    queue = StepQueue(WalkSettings(), half_width=HALF_M, nearest=NEAREST_M)
    feet = [Foothold(0.0, HALF_M, 0.0, 0.0), Foothold(0.0, -HALF_M, 0.0, 0.0)]
    assert queue.take(planner.plan(None), feet, walks=False) == ""
    walks = False
    for _ in range(8):
        move = queue.begin(feet)
        feet[move.side] = move.place
        walks = True
        status = msgspec.structs.replace(
            STATUS,
            last_step=queue.begun,
            moved=("left", "right")[move.side],
            goal_left=list(feet[0]),
            goal_right=list(feet[1]),
        )
        plan = msgspec.convert(msgspec.to_builtins(planner.plan(status)), type=WalkPlan)
        assert queue.take(plan, feet, walks=walks) == ""
        # What is resent changes nothing.
        again = queue.ahead(feet, 3)
        assert queue.take(plan, feet, walks=walks) == ""
        assert queue.ahead(feet, 3) == again


def robot_status(mode: RobotMode, cause: ModeCause) -> RobotStatus:
    return RobotStatus(
        schema=SCHEMA_VERSION,
        tick=0,
        stamp_ns=0,
        mode=mode,
        cause=cause,
        detail="",
        notice="",
        commander="",
        command_age_s=0.0,
        q_command=[],
        refused={},
        clipped={},
        deadline_misses=0,
    )


class FakeClient:
    """A bus with some messages, after which nothing new comes."""

    def __init__(
        self,
        *words: WalkStatus,
        has_stabilizer: bool = True,
        robot: RobotStatus | None = None,
        robot_is_here: bool = True,
    ) -> None:
        self._words = list(words)
        self._word: WalkStatus | None = None
        self.stabilizers = ("one",) if has_stabilizer else ()
        self.robot_is_here = robot_is_here
        self._robot = robot
        self.sent: list[WalkPlan] = []

    def status(self) -> WalkStatus | None:
        if self._words:
            self._word = self._words.pop(0)
        return self._word

    def robot_status(self) -> RobotStatus | None:
        return self._robot

    def send(self, plan: WalkPlan) -> None:
        self.sent.append(plan)


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planner_module, "SILENCE_S", 0.05)
    monkeypatch.setattr(planner_module, "NO_ANSWER_S", 0.02)
    monkeypatch.setattr(planner_module, "PERIOD_S", 0.01)


ESTOPPED = robot_status(RobotMode.FAULT, ModeCause.ESTOP)
RUN_OVER = robot_status(RobotMode.OFF, ModeCause.RUN_OVER)
OTHERS = [msgspec.structs.replace(STATUS, tick=tick) for tick in range(1000)]
"""Status messages of a walk by another planner's plan."""


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize(
    ("client", "words"),
    [
        (FakeClient(has_stabilizer=False), "nobody commands the robot"),
        (FakeClient(), "no word of a walk"),
        (FakeClient(STATUS), "said nothing"),
        (FakeClient(*OTHERS), "takes none of our plans: it is held, or"),
        (FakeClient(STATUS, has_stabilizer=False), "the stabilizer is gone"),
        (FakeClient(STATUS, robot=ESTOPPED), "the robot is in fault"),
        (FakeClient(STATUS, robot=RUN_OVER), "the robot has ended"),
        (FakeClient(STATUS, robot_is_here=False), "the robot is gone"),
    ],
)
def test_a_walk_that_nobody_answers_ends_and_says_what_is_missing(
    planner: VelocityPlanner, client: FakeClient, words: str
) -> None:
    with pytest.raises(RobotUnreachableError, match=words):
        walk_on_bus(client, planner, steps=3, stop=StopRequest())  # type: ignore[arg-type]  # all that it asks for


@pytest.mark.usefixtures("impatient")
def test_the_runs_end_is_that_of_a_walk_without_one(planner: VelocityPlanner) -> None:
    client = FakeClient(STATUS, robot=RUN_OVER)
    assert walk_on_bus(client, planner, steps=None, stop=StopRequest()) is STATUS  # type: ignore[arg-type]  # as above


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize("words", [(), (STATUS,)])
def test_asked_for_an_end_it_waits_for_nobody_who_is_silent(
    planner: VelocityPlanner, words: tuple[WalkStatus, ...]
) -> None:
    stop = StopRequest()
    stop.set()
    client = FakeClient(*words)
    status = walk_on_bus(client, planner, steps=None, stop=stop)  # type: ignore[arg-type]  # as above
    assert status is (words[0] if words else None)


@pytest.mark.usefixtures("impatient")
def test_steps_are_counted_from_the_first_word_on_and_over_a_new_beginning(
    planner: VelocityPlanner,
) -> None:
    stand = msgspec.structs.replace(STATUS, phase="stand")
    words = [
        msgspec.structs.replace(stand, last_step=number) for number in (6, 7, -1, 0, 1)
    ]
    client = FakeClient(*words)
    walk_on_bus(client, planner, steps=3, stop=StopRequest())  # type: ignore[arg-type]  # as above
    assert [len(plan.steps) for plan in client.sent] == [3, 2, 2, 1]
    assert client.sent[2].steps[0].id == 0


@pytest.mark.usefixtures("impatient")
def test_a_plan_from_before_the_first_word_may_be_refused(
    planner: VelocityPlanner,
) -> None:
    class Walked(FakeClient):
        """A robot that has walked, and says so once it hears a plan from id 0."""

        def send(self, plan: WalkPlan) -> None:
            super().send(plan)
            why = "ids go on from there" if plan.steps[0].id == 0 else ""
            told = msgspec.structs.replace(
                STATUS,
                phase="stand",
                refusal=why,
                plan_stamp_ns=plan.stamp_ns,
                last_step=6 if why else 9,
            )
            self._words.append(told)

    client = Walked()
    status = walk_on_bus(client, planner, steps=3, stop=StopRequest())  # type: ignore[arg-type]  # as above
    assert status is not None
    assert status.refusal == ""
    assert [plan.steps[0].id for plan in client.sent[:2]] == [0, 7]


def _refusals(paces: list[Pace]) -> list[str]:
    """Walk a step at each pace, by a new plan each; return the refusals."""
    planner = VelocityPlanner(PACE, half_width=HALF_M)
    queue = StepQueue(WalkSettings(), half_width=HALF_M, nearest=NEAREST_M, soles=SOLES)
    feet = [Foothold(0.0, HALF_M, 0.0, 0.0), Foothold(0.0, -HALF_M, 0.0, 0.0)]
    status, refused = None, []
    for pace in paces:
        planner.pace = pace
        why = queue.take(planner.plan(status), feet, walks=status is not None)
        if why:
            refused.append(f"{pace}: {why}")
            break
        move = queue.begin(feet)
        feet[move.side] = move.place
        apart = move.place.seen_from(feet[1 - move.side])[1]
        assert abs(apart) > 2.0 * HALF_M - 1e-5
        status = msgspec.structs.replace(
            STATUS,
            last_step=queue.begun,
            moved=("left", "right")[move.side],
            goal_left=list(feet[0]),
            goal_right=list(feet[1]),
        )
    return refused


def test_all_velocities_of_the_live_page_are_walked() -> None:
    refused = [
        why
        for ahead, aside, turn in itertools.product(AHEAD, ASIDE, TURN)
        for why in _refusals(
            [PACE._replace(ahead=ahead, lateral=aside, yaw_rate=math.radians(turn))]
            * 6,
        )
    ]
    assert refused == []


def test_velocities_may_change_at_every_step() -> None:
    rng = random.Random(3)
    paces = [
        PACE._replace(
            ahead=rng.choice(AHEAD),
            lateral=rng.choice(ASIDE),
            yaw_rate=math.radians(rng.choice(TURN)),
        )
        for _ in range(300)
    ]
    assert _refusals(paces) == []


def test_too_quick_a_turn_is_refused_as_one() -> None:
    (why,) = _refusals([PACE._replace(ahead=0.0, yaw_rate=math.radians(40.0))])
    assert why.endswith("left foot: turned by +1.117 rad, at most 0.6 rad")
