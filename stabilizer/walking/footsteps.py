"""Footsteps: from a velocity, from a scenario, and what a robot may be asked for."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Mat
from surefoot.schemas.messages import SCHEMA_VERSION
from surefoot.schemas.robot_file import Side
from surefoot.schemas.settings import WalkSettings
from surefoot.schemas.walk_plan import Step, Walk, WalkPlan
from surefoot.stabilizer.control.reference import standing
from surefoot.stabilizer.model import RobotModel

SIDES: tuple[Side, Side] = ("left", "right")
STAND_AT_END_S = 1.0
"""A walk without an end of its own stops in time to stand for so long."""
_LENGTH_TOLERANCE = 1e-6
MOST_TURN_RAD = 1.5
"""A step that turns by more is refused, however wide."""
RAMP = 0.35
"""Part of a foot's way in which it speeds up, and slows down again [1]."""
GLIDE_PEAK = 1.0 / (1.0 - RAMP)
"""Fastest of a foot's way over its mean [1]."""
FOOT_SHARE = 0.75
"""Fastest swing foot, as part of its leg's speed: hip and knee turn at once [1]."""

QUINTIC_PEAK = 1.875
"""Fastest of a quintic from rest to rest over its mean [1]."""
LIFT_SHARE = 0.25
"""Fastest that a foot rises, as part of its leg's speed: by a bent knee alone [1]."""


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
        """Return the place at an offset in this one's own axes."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return Foothold(
            self.x + cos * x - sin * y,
            self.y + sin * x + cos * y,
            self.z,
            self.yaw + yaw,
        )

    def seen_from(self, other: Foothold) -> tuple[float, float, float]:
        """Return x, y [m] and yaw [rad] of this place in another one's axes."""
        cos, sin = math.cos(other.yaw), math.sin(other.yaw)
        x, y = self.x - other.x, self.y - other.y
        turn = math.remainder(self.yaw - other.yaw, math.tau)
        return cos * x + sin * y, cos * y - sin * x, turn


class Pace(NamedTuple):
    """A velocity and the times and height of its steps.

    Attributes:
        ahead: [m/s].
        lateral: to the left [m/s].
        yaw_rate: counter-clockwise from above [rad/s].
        single_s: single support.
        double_s: double support.
        height_m: of the swing foot.
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
    """Yield footsteps for a velocity, without end.

    A robot that goes sideways, or turns, opens its stance with the leading foot and
    closes it with the other one, so that its feet never come nearer than standing.
    Where an arc would bring them nearer all the same they go wider apart.

    Args:
        pace: velocity and times.
        middle: between the feet at first; on the way, beside the one that stands.
        half_width: sole to middle, standing [m].
        first_id: of the first step; the others count on.
        first_side: which foot goes first; None for the leading one.
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
        # The first one leaves a stance that may be narrower, or made at another pace.
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
    """Return how far the feet go from their middle at a pace [m].

    Args:
        pace: velocity and times.
        half_width: sole to middle, standing [m].
    """
    return _width_with(_turning(pace, half_width), pace, half_width)


def _turning(pace: Pace, half_width: float) -> int:
    """The foot that turns for both: to where the robot turns, if that opens most.

    Going back, its way along the arc is towards the other foot.
    """
    foot = _leading(pace.yaw_rate)
    widths = [_width_with(side, pace, half_width) for side in (foot, 1 - foot)]
    return foot if widths[0] <= widths[1] else 1 - foot


def _width_with(turns: int, pace: Pace, half_width: float) -> float:
    """The least sole to middle that brings no foot nearer to the other than standing.

    Seen from a foot that stands beside the middle of a step before, the next one is
    w (1 + cos turn) beside it, and farther by what the middle has gone outward.
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
    """How far the middle goes ahead and aside, and turns, by a step of a foot.

    The leading foot goes both steps' way to the side, or turns for both.
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
    """The foot on the side that one goes, or turns, to."""
    return 1 if rate < 0.0 else 0


def _advanced(middle: Foothold, ahead: float, lateral: float, turn: float) -> Foothold:
    """Go on for a step, along the chord of the arc."""
    half = middle.beside(0.0, 0.0, 0.5 * turn)
    return half.beside(ahead, lateral, 0.5 * turn)


def turned(yaw: float) -> Mat:
    """Return the (3, 3) rotation about the vertical by a yaw [rad]."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def mean_yaw(left: float, right: float) -> float:
    """Return the heading between two, the short way [rad]."""
    return right + 0.5 * math.remainder(left - right, math.tau)


def travel_part(
    climb: float, lift: float, settings: WalkSettings
) -> tuple[float, float]:
    """Return the part of single support in which a foot travels, from and to [1].

    A foot that climbs first rises to the level of its foothold, one that descends
    stays above its old one until it has arrived: somewhere between is the edge of a
    stair.

    Args:
        climb: height of the foothold over the one that is left, by plan [m].
        lift: how high the foot is lifted over the higher of both [m].
        settings: the part on level ground, and that until the foot is highest.
    """
    begins, ends, up = 0.0, settings.horizontal_part, settings.apex_part
    if climb > 0.0:
        begins = up * _when_risen(climb / (climb + lift))
    elif climb < 0.0:
        ends = min(ends, 1.0 - (1.0 - up) * _when_risen(-climb / (lift - climb)))
    return begins, ends


def _when_risen(part: float) -> float:
    """Return when a quintic from rest to rest has gone a part of its way [1]."""
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
    leg_speed: float,
    lift: float,
    climb: float = 0.0,
) -> float:
    """Return the least single support in which a leg can set its foot so far [s].

    Args:
        way: of the foot [m].
        settings: the parts of it in which the foot travels, rises and comes down.
        leg_speed: of the end of a straight leg, by the speed of its drives [m/s].
        lift: over the higher of both footholds [m].
        climb: height of the foothold over the one that is left, by plan [m].
    """
    begins, ends = travel_part(climb, lift, settings)
    up = settings.apex_part
    rise_s = QUINTIC_PEAK * (lift + max(climb, 0.0)) / (up * LIFT_SHARE * leg_speed)
    fall_s = QUINTIC_PEAK * (lift - min(climb, 0.0)) / (LIFT_SHARE * leg_speed)
    travel_s = way * (GLIDE_PEAK / ((ends - begins) * FOOT_SHARE * leg_speed))
    return max(travel_s, rise_s, fall_s / (1.0 - up))


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
        robot: that walks.
        settings: the times of the first and the last shift.
        duration_s: of the scenario.
    """
    stance, period_s = standing(RobotModel(robot)), robot.period_s
    if walk.step:
        steps = _written_steps(walk)
    else:
        speed = stance.com_nominal * robot.servo_profile.velocity_limit_rad_s
        half_width = 0.5 * float(stance.p_sole[0][1] - stance.p_sole[1][1])
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
    leg_speed: float,
) -> list[Step]:
    """As many as there is time for, with the times that they take."""
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
    way = max(
        math.dist(step.position, before.position)
        for before, step in zip(first, first[2:], strict=False)
    )
    least_s = swing_time(way, settings, leg_speed=leg_speed, lift=walk.height_m)
    # A foot that double support was too short to unload is waited for.
    period = max(walk.step_s, least_s) + max(walk.double_s, settings.unload_wait_s)
    last_s = walk.stop_s
    if last_s is None:
        # One more step brings the feet together.
        last_s = duration_s - STAND_AT_END_S - settings.settle_s - 2.0 * period
    last_s = min(last_s, duration_s)
    begun_s = walk.start_s + settings.shift_s
    count = max(0, math.floor((last_s - begun_s) / period + 1.0 + _LENGTH_TOLERANCE))
    return list(itertools.islice(itertools.chain(first, steps), count))
