"""Footsteps from a velocity or from a scenario, within what a robot can do."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Mat
from surefoot.schemas.messages import SCHEMA_VERSION
from surefoot.schemas.robot_file import Side
from surefoot.schemas.settings import WalkSettings
from surefoot.schemas.walk_plan import Step, Walk, WalkPlan
from surefoot.stabilizer.control.reference import standing
from surefoot.stabilizer.model import N_BASE_V, RobotModel, turn_level

SIDES: tuple[Side, Side] = ("left", "right")
STAND_AT_END_S = 1.0
"""Time to stand at the scenario's end after a walk without an end of its own."""
_LENGTH_TOLERANCE = 1e-6
MOST_TURN_RAD = 1.5
"""Turn from which a step is refused, however wide."""
RAMP = 0.35
"""Part of a foot's travel time in which it speeds up, and in which it slows down
[1]."""
GLIDE_PEAK = 1.0 / (1.0 - RAMP)
"""Peak speed of a foot's travel over its mean [1]."""
FOOT_SHARE = 0.75
"""Largest speed of a swing foot over that of its leg: hip and knee turn at once [1]."""

QUINTIC_PEAK = 1.875
"""Peak speed of a quintic from rest to rest over its mean [1]."""
LIFT_SHARE = 0.25
"""Largest speed of a rising foot over that of its leg: only a bent knee lifts it
[1]."""
TURN_SHARE = 1.5
"""Largest rate of turn of a swing foot over that of its hip: the base, which turns by
half as much, takes a part [1]."""
SLOWEST_TURN_RAD_S = 0.1
"""A leg that turns its foot more slowly has no joint for it, and is not waited for."""


class LegSpeed(NamedTuple):
    """Speeds of a leg, by its drives.

    Attributes:
        travel: of the end of a straight leg [m/s].
        turn: of the foot about the vertical, by the joint that turns it most [rad/s].
    """

    travel: float = math.inf
    turn: float = math.inf


ANY_SPEED = LegSpeed()


class Foothold(NamedTuple):
    """A place for a sole.

    Attributes:
        x: ahead, odometry frame [m].
        y: to the left [m].
        z: up [m].
        yaw: heading [rad].
    """

    x: float
    y: float
    z: float
    yaw: float

    def beside(self, x: float, y: float, yaw: float = 0.0) -> Foothold:
        """Return the place at an offset in the axes of this one."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return Foothold(
            self.x + cos * x - sin * y,
            self.y + sin * x + cos * y,
            self.z,
            self.yaw + yaw,
        )

    def seen_from(self, other: Foothold) -> tuple[float, float, float]:
        """Return x, y [m] and yaw [rad] of this place in the axes of another."""
        x, y = turn_level(self.x - other.x, self.y - other.y, -other.yaw)
        return x, y, math.remainder(self.yaw - other.yaw, math.tau)


class Pace(NamedTuple):
    """A walking velocity, with the times and height of its steps.

    Attributes:
        ahead: speed ahead [m/s].
        lateral: speed to the left [m/s].
        yaw_rate: turning speed, counter-clockwise from above [rad/s].
        single_s: single support.
        double_s: double support.
        height_m: height of the swing foot [m].
    """

    ahead: float
    lateral: float
    yaw_rate: float
    single_s: float
    double_s: float
    height_m: float


def steps_at(
    pace: Pace,
    middle: Foothold,
    *,
    half_width: float,
    first_id: int,
    first_side: int | None = None,
) -> Iterator[Step]:
    """Yield an endless sequence of footsteps for a velocity.

    In going sideways or turning, the leading foot opens the stance and the other one
    closes it, so that the feet never come nearer than in standing. If an arc would
    still bring them nearer, the feet go wider apart.

    Args:
        pace: velocity and times.
        middle: place between the feet at first; in a walk, beside the standing foot.
        half_width: sole to middle, standing [m].
        first_id: id of the first step; the others count up from it.
        first_side: foot that goes first; None for the leading one.
    """
    leads, turns = _leading(pace.lateral), _turning(pace, half_width)
    wide = _width_with(turns, pace, half_width)
    side = first_side
    if side is None:
        side = leads if pace.lateral else turns
    stands = half_width if first_side is None else wide
    support = middle.beside(0.0, -stands if side == 0 else stands)
    number = 0
    while True:
        middle = _advanced(middle, *_way(side, pace, turns))
        out = 1.0 if side == 0 else -1.0
        place = middle.beside(0.0, out * wide)
        # The first step leaves a stance that may be narrower, or of another pace.
        x, apart, yaw = place.seen_from(support)
        if out * apart < 2.0 * half_width - _LENGTH_TOLERANCE:
            place = support.beside(x, out * 2.0 * half_width, yaw)
        support = place
        yield Step(
            id=first_id + number,
            side=SIDES[side],
            position=[place.x, place.y, place.z],
            yaw=place.yaw,
            single_s=pace.single_s,
            double_s=pace.double_s,
            height_m=pace.height_m,
        )
        number += 1
        side = 1 - side


def half_width_at(pace: Pace, half_width: float) -> float:
    """Return the distance of the feet from their middle at a pace [m].

    Args:
        pace: velocity and times.
        half_width: sole to middle, standing [m].
    """
    return _width_with(_turning(pace, half_width), pace, half_width)


def _turning(pace: Pace, half_width: float) -> int:
    """Return the foot that turns for both: on the side of the turn, if that opens most.

    In going backwards, this foot's way along the arc is towards the other foot.
    """
    foot = _leading(pace.yaw_rate)
    widths = [_width_with(side, pace, half_width) for side in (foot, 1 - foot)]
    return foot if widths[0] <= widths[1] else 1 - foot


def _width_with(turns: int, pace: Pace, half_width: float) -> float:
    """Return the least distance of sole to middle that keeps the feet apart enough.

    Seen from a foot beside the middle of one step before, the next foot is w (1 + cos
    turn) beside it, plus the outward way of the middle. It must not be nearer than in
    standing.
    """
    width = half_width
    for side in (0, 1):
        ahead, lateral, turn = _way(side, pace, turns)
        out = ahead * math.sin(0.5 * turn) + lateral * math.cos(0.5 * turn)
        if side == 1:
            out = -out
        if abs(turn) < MOST_TURN_RAD:
            width = max(width, (2.0 * half_width - out) / (1.0 + math.cos(turn)))
    return width


def _way(side: int, pace: Pace, turns: int) -> tuple[float, float, float]:
    """Return the middle's way ahead and aside, and its turn, in a step of a foot.

    The leading foot covers the sideways way of both steps, or turns for both.
    """
    period = pace.single_s + pace.double_s
    ahead, lateral, turn = (
        rate * period for rate in (pace.ahead, pace.lateral, pace.yaw_rate)
    )
    leads = _leading(pace.lateral)
    return (
        ahead,
        2.0 * lateral if side == leads else 0.0,
        2.0 * turn if side == turns else 0.0,
    )


def _leading(rate: float) -> int:
    """Return the foot on the side to which the robot goes or turns."""
    return 1 if rate < 0.0 else 0


def _advanced(middle: Foothold, ahead: float, lateral: float, turn: float) -> Foothold:
    """Return the middle after a step, along the chord of the arc."""
    half = middle.beside(0.0, 0.0, 0.5 * turn)
    return half.beside(ahead, lateral, 0.5 * turn)


def turned(yaw: float) -> Mat:
    """Return the (3, 3) rotation about the vertical by a yaw [rad]."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def mean_yaw(left: float, right: float) -> float:
    """Return the mean of two headings, the short way around [rad]."""
    return right + 0.5 * math.remainder(left - right, math.tau)


def travel_part(
    climb: float, lift: float, settings: WalkSettings
) -> tuple[float, float]:
    """Return begin and end of a foot's travel, in parts of single support [1].

    A climbing foot first rises to the level of its foothold. A descending foot stays
    above its old one until it has arrived. Somewhere between is the edge of a stair.

    Args:
        climb: height of the foothold over the one that is left, by plan [m].
        lift: height to which the foot is lifted over the higher of both footholds [m].
        settings: has that part on level ground, and the part until the foot is highest.
    """
    begins, ends, up = 0.0, settings.horizontal_part, settings.apex_part
    if climb > 0.0:
        begins = up * _when_risen(climb / (climb + lift))
    elif climb < 0.0:
        ends = min(ends, 1.0 - (1.0 - up) * _when_risen(-climb / (lift - climb)))
    return begins, ends


def _when_risen(part: float) -> float:
    """Return when, from 0 to 1, a quintic from rest to rest has gone a part."""
    low, high = 0.0, 1.0
    for _ in range(20):
        s = 0.5 * (low + high)
        if s * s * s * (10.0 + s * (6.0 * s - 15.0)) < part:
            low = s
        else:
            high = s
    return high


def swing_time(
    way: float,
    settings: WalkSettings,
    *,
    leg_speed: LegSpeed,
    lift: float,
    climb: float = 0.0,
    turn: float = 0.0,
) -> float:
    """Return the least single support in which a leg can set its foot so far [s].

    Args:
        way: horizontal way of the foot [m].
        settings: has the parts of single support for travel, rise and descent.
        leg_speed: of the leg.
        lift: height of the foot over the higher of both footholds [m].
        climb: height of the foothold over the one that is left, by plan [m].
        turn: from the foot's heading to the foothold's [rad].
    """
    begins, ends = travel_part(climb, lift, settings)
    up, speed = settings.apex_part, leg_speed.travel
    rise_s = QUINTIC_PEAK * (lift + max(climb, 0.0)) / (up * LIFT_SHARE * speed)
    fall_s = QUINTIC_PEAK * (lift - min(climb, 0.0)) / (LIFT_SHARE * speed)
    part = ends - begins
    travel_s = way * (GLIDE_PEAK / (part * FOOT_SHARE * speed))
    turn_s = abs(turn) * (GLIDE_PEAK / (part * TURN_SHARE * leg_speed.turn))
    return max(travel_s, turn_s, rise_s, fall_s / (1.0 - up))


def leg_speed_of(model: RobotModel) -> LegSpeed:
    """Return the speeds of a robot's slower leg in its nominal posture."""
    body, q = model.pin_model, model.nominal_configuration()
    data, servo = body.createData(), model.robot.servo_profile.velocity_limit_rad_s
    com_height = float(pin.centerOfMass(body, data, q)[2])
    travel = turn = math.inf
    for sole in model.sole_ids:
        J = np.abs(
            pin.computeFrameJacobian(body, data, q, sole, pin.LOCAL_WORLD_ALIGNED)
        )[:, N_BASE_V:]
        hip, yaw = int(np.argmax(J[0])), int(np.argmax(J[5]))
        travel = min(travel, com_height * min(servo, float(model.velocity_limit[hip])))
        turn = min(turn, J[5, yaw] * min(servo, float(model.velocity_limit[yaw])))
    return LegSpeed(travel, float(turn) if turn > SLOWEST_TURN_RAD_S else math.inf)


def half_width_of(robot: Robot) -> float:
    """Return the distance from sole to middle in a robot's nominal stance [m]."""
    left, right = standing(RobotModel(robot)).p_sole
    return 0.5 * float(left[1] - right[1])


def plan_of(
    walk: Walk, robot: Robot, settings: WalkSettings, *, duration_s: float
) -> WalkPlan:
    """Return the plan of a scenario's walk.

    Args:
        walk: of the scenario.
        robot: the robot that walks.
        settings: has the times of the first and the last shift.
        duration_s: of the scenario.
    """
    model, period_s = RobotModel(robot), robot.period_s
    if walk.step:
        steps = _written_steps(walk)
    else:
        left, right = standing(model).p_sole
        half_width, speed = 0.5 * float(left[1] - right[1]), leg_speed_of(model)
        steps = _velocity_steps(walk, settings, duration_s, half_width, speed)
    return WalkPlan(
        schema=SCHEMA_VERSION,
        tick=0,
        stamp_ns=0,
        begin_tick=round(walk.start_s / period_s),
        steps=steps,
    )


def _written_steps(walk: Walk) -> list[Step]:
    return [
        Step(
            id=number,
            side=step.side,
            position=[*step.position_m, step.rise_m],
            yaw=math.radians(step.yaw_deg),
            single_s=step.step_s or walk.step_s,
            double_s=step.double_s or walk.double_s,
            height_m=step.height_m or walk.height_m,
        )
        for number, step in enumerate(walk.step)
    ]


def _velocity_steps(
    walk: Walk,
    settings: WalkSettings,
    duration_s: float,
    half_width: float,
    leg_speed: LegSpeed,
) -> list[Step]:
    """Return as many steps as there is time for, with the time that each takes."""
    pace = Pace(
        ahead=walk.velocity_m_s,
        lateral=walk.lateral_m_s,
        yaw_rate=walk.yaw_rate,
        single_s=walk.step_s,
        double_s=walk.double_s,
        height_m=walk.height_m,
    )
    steps = steps_at(
        pace, Foothold(0.0, 0.0, 0.0, 0.0), half_width=half_width, first_id=0
    )
    first = list(itertools.islice(steps, 4))
    swings = list(zip(first, first[2:], strict=False))
    way = max(math.dist(after.position, before.position) for before, after in swings)
    turn = max(abs(after.yaw - before.yaw) for before, after in swings)
    least_s = swing_time(
        way, settings, leg_speed=leg_speed, lift=walk.height_m, turn=turn
    )
    # Double support too short to unload a foot is extended by waiting.
    period = max(walk.step_s, least_s) + max(walk.double_s, settings.unload_wait_s)
    last_s = walk.stop_s
    if last_s is None:
        # One more step brings the feet together.
        last_s = duration_s - STAND_AT_END_S - settings.settle_s - 2.0 * period
    last_s = min(last_s, duration_s)
    begun_s = walk.start_s + settings.shift_s
    count = max(0, math.floor((last_s - begun_s) / period + 1.0 + _LENGTH_TOLERANCE))
    return list(itertools.islice(itertools.chain(first, steps), count))
