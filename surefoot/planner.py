"""Turns a velocity into footsteps for a robot on the bus, as long as it walks."""

from __future__ import annotations

import itertools
import time

from surefoot.robot_io.client_side.requests import PlannerClient
from surefoot.robot_io.realtime import StopRequest
from surefoot.schemas.messages import SCHEMA_VERSION
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
"""A planner that is gone leaves the robot so many steps; then it stands."""
PERIOD_S = 0.1
"""Plans are sent so often: one that is lost is made up for by the next."""
SILENCE_S = 10.0
"""A stabilizer that says nothing of a walk for so long takes no plans."""


class VelocityPlanner:
    """Footsteps for a velocity that may change at any time; no bus, no clock.

    Attributes:
        pace: velocity and times; may be replaced while the robot walks.
    """

    def __init__(self, pace: Pace, *, half_width: float) -> None:
        """Begin.

        Args:
            pace: velocity and times.
            half_width: sole to middle, standing [m].
        """
        self.pace = pace
        self._half_width = half_width

    def plan(self, status: WalkStatus | None, *, count: int = STEPS_AHEAD) -> WalkPlan:
        """Plan on from where the feet are being set.

        Args:
            status: the walk's newest word; None of a robot that has not walked yet.
            count: steps; none bring the feet together.
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
        """Between the feet; on the way, beside the foot that was set last."""
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
    """Have a robot walk until it has taken some steps, or somebody asks for an end.

    Args:
        client: connected.
        planner: of the steps.
        steps: how many; None for no end.
        stop: asks for an end: the feet come together first, unless it is urgent.

    Returns:
        The walk's last word; None when the stabilizer never said one.
    """
    heard_s = time.monotonic()
    begun = client.status()
    first = -1 if begun is None else begun.last_step
    status, sent = begun, set[int]()
    while not stop.is_urgent and client.robot_is_here:
        left = STEPS_AHEAD
        status = client.status() or status
        if status is not None and steps is not None:
            left = min(left, steps - (status.last_step - first))
        if status is not None or not client.has_stabilizer:
            heard_s = time.monotonic()
        elif time.monotonic() - heard_s > SILENCE_S:
            return None
        if stop.is_set:
            left = 0
        is_over = status is not None and status.phase == "stand"
        if left <= 0 and is_over:
            return status
        if status is not None and status.refusal and status.plan_stamp_ns in sent:
            return status
        plan = planner.plan(status, count=max(0, left))
        client.send(plan)
        sent.add(plan.stamp_ns)
        time.sleep(PERIOD_S)
    return status
