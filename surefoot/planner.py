"""Plans footsteps at a velocity for a robot on the bus; ``surefoot walk`` uses it."""

from __future__ import annotations

import itertools
import math
import time

from surefoot.robot_io.client_side.requests import PlannerClient
from surefoot.robot_io.errors import RobotUnreachableError
from surefoot.robot_io.realtime import StopRequest
from surefoot.schemas.messages import SCHEMA_VERSION, RobotMode
from surefoot.schemas.reasons import ModeCause, in_words
from surefoot.schemas.walk_plan import WalkPlan, WalkStatus
from surefoot.stabilizer.walking.footsteps import (
    SIDES,
    Foothold,
    Pace,
    half_width_at,
    mean_yaw,
    steps_at,
)

STEPS_AHEAD = 5
"""Planned steps; if the planner is lost, the robot takes these and stands."""
PERIOD_S = 0.1
"""From plan to plan [s]; the next plan replaces a lost one."""
SILENCE_S = 5.0
"""Time without stabilizer, walk status or accepted plan until the planner fails [s]."""
NO_ANSWER_S = 1.0
"""Silence of the stabilizer after which a planner asked to end does not wait [s]."""

NOT_HEARD = (
    "does not hear them; on a bus with certificates dial with the planner's or the "
    "operator's"
)
"""The stabilizer decides who may plan; it does not tell those it ignores."""
ENDS = (ModeCause.RUN_OVER, ModeCause.FELL, ModeCause.STOPPED, ModeCause.NO_COMMANDER)
"""Causes after which a robot stays off."""


class VelocityPlanner:
    """Plans footsteps for a velocity that may change at any time; no bus, no clock.

    Attributes:
        pace: velocity and times; may be replaced while the robot walks.
    """

    def __init__(self, pace: Pace, *, half_width: float) -> None:
        """Begin; a standing robot's soles are ``half_width`` from the middle [m]."""
        self.pace = pace
        self._half_width = half_width

    def plan(self, status: WalkStatus | None, *, count: int = STEPS_AHEAD) -> WalkPlan:
        """Plan the steps after those that have begun.

        Args:
            status: newest status of the walk; None if the robot has not walked yet.
            count: number of steps; 0 brings the feet together.
        """
        first_id, first_side = 0, None
        feet = [
            Foothold(0.0, self._half_width, 0.0, 0.0),
            Foothold(0.0, -self._half_width, 0.0, 0.0),
        ]
        if status is not None:
            first_id = status.last_step + 1
            feet = [_foothold(goal) for goal in (status.goal_left, status.goal_right)]
            if status.moved and status.phase != "stand":
                first_side = 1 - SIDES.index(status.moved)
        steps = steps_at(
            self.pace,
            self._middle(feet, first_side),
            half_width=self._half_width,
            first_id=first_id,
            first_side=first_side,
        )
        return WalkPlan(
            schema=SCHEMA_VERSION,
            tick=0 if status is None else status.tick,
            stamp_ns=time.monotonic_ns(),
            begin_tick=0,
            steps=list(itertools.islice(steps, count)),
        )

    def _middle(self, feet: list[Foothold], first_side: int | None) -> Foothold:
        """Middle between the feet; during a walk, beside the foot that was set last."""
        if first_side is None:
            left, right = feet
            return Foothold(
                0.5 * (left.x + right.x),
                0.5 * (left.y + right.y),
                0.5 * (left.z + right.z),
                mean_yaw(left.yaw, right.yaw),
            )
        last = 1 - first_side
        wide = half_width_at(self.pace, self._half_width)
        return feet[last].beside(0.0, wide * (2 * last - 1))


def _foothold(numbers: list[float]) -> Foothold:
    x, y, z, yaw = numbers
    return Foothold(x, y, z, yaw)


def walk_on_bus(
    client: PlannerClient,
    planner: VelocityPlanner,
    *,
    steps: int | None,
    stop: StopRequest,
) -> WalkStatus | None:
    """Let a robot walk until it has taken some steps, or until a stop is asked for.

    Args:
        client: connected.
        planner: plans the steps.
        steps: how many; None for no end.
        stop: asks for an end; the feet come together first, unless it is urgent.

    Returns:
        The last status of the walk; None if there was none before the stop.

    Raises:
        RobotUnreachableError: there is no stabilizer that walks; or stabilizer or robot
            is gone; or the robot is in fault, or ended before all steps were taken.
    """
    heard_s = time.monotonic()
    last_word: WalkStatus | None = None
    sent, blind = set[int](), set[int]()
    is_taken, asked_s = False, math.inf
    taken = 0
    while not stop.is_urgent:
        status = client.status()
        if status is not None and status is not last_word:
            # A restarted stabilizer counts its steps from the first again.
            before = status if last_word is None else last_word
            taken += max(0, status.last_step - before.last_step)
            heard_s, last_word = time.monotonic(), status
        silence_s = time.monotonic() - heard_s
        if stop.is_set and (status is None or silence_s > NO_ANSWER_S):
            break
        left = STEPS_AHEAD if steps is None else min(STEPS_AHEAD, steps - taken)
        if stop.is_set or left < 0:
            left = 0
        if status is not None:
            if left == 0 and status.phase == "stand":
                break
            is_taken = is_taken or status.plan_stamp_ns in sent
            if status.refusal and status.plan_stamp_ns in sent - blind:
                break
        if steps is None and last_word is not None and _run_is_over(client):
            break
        missing = _missing(client, silence_s, last_word)
        if not (missing or is_taken) and time.monotonic() - asked_s > SILENCE_S:
            missing = (
                f"the stabilizer takes none of our plans: it is held, or {NOT_HEARD}"
            )
        if missing:
            many = "" if last_word is None else f", after {taken} steps"
            raise RobotUnreachableError(f"{missing}{many}")
        if client.stabilizers:
            plan = planner.plan(status, count=left)
            client.send(plan)
            sent.add(plan.stamp_ns)
            if status is None:  # step ids are a guess: the robot may have walked before
                blind.add(plan.stamp_ns)
            asked_s = min(asked_s, time.monotonic())
        else:
            asked_s = math.inf
        time.sleep(PERIOD_S)
    return last_word


def _run_is_over(client: PlannerClient) -> bool:
    """Whether the robot has reported the end of its run."""
    said = client.robot_status()
    return said is not None and said.cause is ModeCause.RUN_OVER


def _missing(
    client: PlannerClient, silence_s: float, last_word: WalkStatus | None
) -> str:
    """Why the walk cannot go on, in words; empty while it can."""
    said = client.robot_status()
    if said is not None:
        why = in_words(said.cause, said.detail)
        if said.mode is RobotMode.FAULT:
            return f"the robot is in fault ({why})"
        if said.cause in ENDS:
            return f"the robot has ended ({why})"
    if not client.robot_is_here:
        return "the robot is gone"
    if silence_s <= SILENCE_S:
        return ""
    if client.stabilizers:
        if last_word is None:
            return (
                "no word of a walk from the stabilizer: start one with --controller "
                f"whole-body; one that is of it {NOT_HEARD}"
            )
        return f"the stabilizer has said nothing for {silence_s:.0f} s"
    if last_word is None:
        return "nobody commands the robot: start one with 'surefoot stabilizer'"
    return "the stabilizer is gone"
