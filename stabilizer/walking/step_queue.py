"""Coming steps: those of the plan, and the one that brings the feet together."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from surefoot.robot_io.robot import Robot
from surefoot.schemas.settings import WalkSettings
from surefoot.schemas.walk_plan import WalkPlan
from surefoot.stabilizer.control.reference import Stance, standing
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.walking.footsteps import (
    ANY_SPEED,
    SIDES,
    Foothold,
    LegSpeed,
    leg_speed_of,
    swing_time,
)

CLOSING_ID = -1
"""Id of the step that brings the feet together; it is in no plan."""
TOGETHER_M = 0.01
"""Distance from side by side up to which feet are together [m]."""
NEARLY_TOGETHER_M = 0.03
"""The same right after a step that was to bring them together [m]."""
TOGETHER_RAD = 0.03
"""Angle between feet up to which they are together [rad]."""
BETWEEN_SOLES_M = 0.001
"""Gap below which two soles would touch [m]."""


@dataclass(frozen=True, slots=True)
class Move:
    """A step as it is carried out.

    Attributes:
        id: id of the plan's step, or CLOSING_ID.
        side: 0 for the left foot, 1 for the right one.
        place: place where the foot is to be set.
        single_s: single support.
        double_s: double support after it.
        height_m: height to which the foot is lifted [m].
    """

    id: int
    side: int
    place: Foothold
    single_s: float
    double_s: float
    height_m: float


class StepQueue:
    """Steps that have not begun.

    Attributes:
        shift: (x, y) added to the plan's places by step adjustment [m].
        last: the step begun last; None before the first.
        leaving: the foot that takes the walk's first step, while the weight shifts off
            it; None otherwise.
        begun: largest id of a plan's step that has begun; -1 before the first.
        planned: steps of all accepted plans so far.
    """

    def __init__(
        self,
        settings: WalkSettings,
        *,
        half_width: float,
        nearest: float,
        leg_speed: LegSpeed = ANY_SPEED,
        soles: Sequence[tuple[float, float]] = (),
    ) -> None:
        """Begin without a plan.

        Args:
            settings: has the limits of steps.
            half_width: distance of sole to middle, standing [m].
            nearest: least sideways distance of the feet [m].
            leg_speed: of the slower leg; a step that needs more than a part of it takes
                longer.
            soles: half length and half width of left and right sole [m]; empty when
                unknown.
        """
        self._soles = soles
        self._leg_speed = leg_speed
        self._settings, self._nearest = settings, nearest
        self._width = 2.0 * half_width
        self._steps: deque[Move] = deque()
        self.shift = (0.0, 0.0)
        self.last: Move | None = None
        self.leaving: int | None = None
        self.begun = CLOSING_ID
        self.planned = 0
        self._known: list[Move] = []
        self._known_for: tuple[object, ...] | None = None

    @classmethod
    def of(
        cls, settings: WalkSettings, *, model: RobotModel, stance: Stance
    ) -> StepQueue:
        """Return the queue of a robot that begins in its nominal stance."""
        left, right = stance.p_sole
        return cls(
            settings,
            half_width=0.5 * float(left[1] - right[1]),
            nearest=nearest_of(model, settings),
            leg_speed=leg_speed_of(model),
            soles=model.half_sizes,
        )

    def __len__(self) -> int:
        """Number of the plan's steps that have not begun."""
        return len(self._steps)

    def take(self, plan: WalkPlan, feet: Sequence[Foothold], *, walks: bool) -> str:
        """Replace the steps that have not begun by those of a plan.

        Args:
            plan: the newest.
            feet: places of left and right foot, or where they are being set.
            walks: whether the robot is walking, so that the next foot is fixed.

        Returns:
            Why the plan is refused, in words; no steps are left then. Empty when
            accepted.
        """
        moves = [
            Move(
                id=step.id,
                side=SIDES.index(step.side),
                place=_foothold(step.position, step.yaw),
                single_s=step.single_s,
                double_s=step.double_s,
                height_m=step.height_m,
            )
            for step in plan.steps
            if step.id > self.begun
        ]
        self.drop()
        self.shift = (0.0, 0.0)
        if plan.steps and plan.steps[-1].id < self.begun:
            return (
                f"its steps end with {plan.steps[-1].id}, and step {self.begun} has "
                "begun; ids go on from there, also those of another planner"
            )
        why = self._why_not(moves, feet, walks=walks)
        if not why:
            self._steps.extend(moves)
            self.planned += len(moves)
        return why

    def drop(self) -> None:
        """Drop all coming steps; the feet come together."""
        self.planned -= len(self._steps)
        self._steps.clear()
        self._known_for = None

    def ahead(self, feet: Sequence[Foothold], count: int) -> list[Move]:
        """Return the coming steps, the closing one included.

        Args:
            feet: places of left and right foot, or where they are being set.
            count: largest number of steps.

        Returns:
            The steps; the same list until something changes them.
        """
        asked = (*feet, self.shift, count)
        if asked != self._known_for:
            self._known, self._known_for = self._look_ahead(feet, count), asked
        return self._known

    def _look_ahead(self, feet: Sequence[Foothold], count: int) -> list[Move]:
        (x, y), places = self.shift, list(feet)
        moves: list[Move] = []
        for move in itertools.islice(self._steps, count):
            p = move.place
            place = Foothold(p.x + x, p.y + y, p.z, p.yaw)
            moves.append(self._paced(move, place, start=places[move.side]))
            places[move.side] = moves[-1].place
        if len(moves) < count:
            before, side = self.last, self.leaving
            if moves:
                before, side = moves[-1], None
            closing = self._closing(before, places, side)
            if closing is not None:
                moves.append(closing)
        return moves

    def begin(self, feet: Sequence[Foothold]) -> Move:
        """Remove and return the next step, the first of :meth:`ahead`.

        Args:
            feet: places of left and right foot.
        """
        move = self.ahead(feet, 1)[0]
        if self._steps:
            self._steps.popleft()
        self.last, self.leaving, self._known_for = move, None, None
        self.begun = max(self.begun, move.id)
        return move

    def shift_by(self, x: float, y: float) -> None:
        """Shift all coming places.

        Args:
            x: [m], odometry frame.
            y: [m].
        """
        self.shift = (self.shift[0] + x, self.shift[1] + y)

    def _closing(
        self, before: Move | None, places: list[Foothold], side: int | None
    ) -> Move | None:
        """Return the step that brings the feet together, if needed.

        Without a given side it is by the foot that was not moved last.
        """
        if before is None:
            return None
        if side is None:
            side = 1 - before.side
        goal = places[1 - side].beside(0.0, self._width if side == 0 else -self._width)
        x, y, yaw = places[side].seen_from(goal)
        # No further step for the error of the closing one.
        near = TOGETHER_M if before.id != CLOSING_ID else NEARLY_TOGETHER_M
        if abs(x) < near and abs(y) < near and abs(yaw) < TOGETHER_RAD:
            return None
        closing = Move(
            CLOSING_ID, side, goal, before.single_s, before.double_s, before.height_m
        )
        return self._paced(closing, goal, start=places[side])

    def _paced(self, move: Move, place: Foothold, *, start: Foothold) -> Move:
        """Return a step to a place, with the time that the leg needs for it."""
        way = math.hypot(place.x - start.x, place.y - start.y)
        least_s = swing_time(
            way,
            self._settings,
            leg_speed=self._leg_speed,
            lift=move.height_m,
            climb=place.z - start.z,
            turn=math.remainder(place.yaw - start.yaw, math.tau),
        )
        single_s = max(move.single_s, least_s)
        return Move(move.id, move.side, place, single_s, move.double_s, move.height_m)

    def _why_not(
        self, moves: Sequence[Move], feet: Sequence[Foothold], *, walks: bool
    ) -> str:
        """Return why these steps cannot be walked; empty when they can."""
        places = list(feet)
        last, leaving = self.last, self.leaving
        if moves and leaving is not None:
            if moves[0].side != leaving:
                return (
                    f"step {moves[0].id} moves the {SIDES[1 - leaving]} foot, which "
                    "the weight shifts onto; the other one leaves first"
                )
        elif moves and walks and last is not None and moves[0].side == last.side:
            return (
                f"step {moves[0].id} moves the {SIDES[last.side]} foot, which is on "
                "its way; the other one's turn is next"
            )
        for move in moves:
            support = places[1 - move.side]
            why = self._unreachable(move, support)
            if why:
                return f"step {move.id}, {SIDES[move.side]} foot: {why}"
            places[move.side] = move.place
        return ""

    def _unreachable(self, move: Move, support: Foothold) -> str:
        limits = self._settings
        x, y, yaw = move.place.seen_from(support)
        apart = y if move.side == 0 else -y
        if abs(x) > limits.longest_m:
            return f"{x:+.3f} m ahead of the other, at most {limits.longest_m:g} m"
        if not self._nearest <= apart <= limits.farthest_m:
            return (
                f"{apart:.3f} m beside the other, expected {self._nearest:.3f} to "
                f"{limits.farthest_m:g} m"
            )
        if abs(yaw) > limits.turn_limit_rad:
            return f"turned by {yaw:+.3f} rad, at most {limits.turn_limit_rad:g} rad"
        rise = move.place.z - support.z
        if abs(rise) > limits.rise_limit_m:
            return f"{rise:+.3f} m higher, at most {limits.rise_limit_m:g} m"
        if self._soles:
            mine, other = self._soles[move.side], self._soles[1 - move.side]
            over = _overlap((move.place, mine), (support, other))
            if over > 0.0:
                return f"its sole would stand on the other one by {1e3 * over:.0f} mm"
            if over > -BETWEEN_SOLES_M:
                return "its sole would touch the other one"
        return ""


def nearest_of(model: RobotModel, settings: WalkSettings) -> float:
    """Return the least sideways distance of parallel feet [m].

    Args:
        model: of the robot.
        settings: has the gap between the soles.
    """
    return sum(width for _, width in model.half_sizes) + settings.between_soles_m


class Foretold(NamedTuple):
    """How a plan will go.

    Attributes:
        why: why it will be refused, in words; empty if accepted.
        taken_s: least time that it takes, including the step that brings the feet
            together and both shifts of the weight [s].
        longer: longest time that a step needs, over the time planned for it [1].
    """

    why: str
    taken_s: float
    longer: float


def foretold(plan: WalkPlan, robot: Robot, settings: WalkSettings) -> Foretold:
    """Predict how a plan goes for a robot that stands.

    Args:
        plan: the plan.
        robot: the robot that would walk.
        settings: of walking.
    """
    model = RobotModel(robot)
    stance = standing(model)
    queue = StepQueue.of(settings, model=model, stance=stance)
    feet = [
        Foothold(float(p[0]), float(p[1]), 0.0, yaw)
        for p, yaw in zip(stance.p_sole, stance.yaw_sole, strict=True)
    ]
    why = queue.take(plan, feet, walks=False)
    moves = queue.ahead(feet, len(queue) + 1)
    taken_s = sum(move.single_s + move.double_s for move in moves[:-1])
    if moves:
        taken_s += settings.shift_s + moves[-1].single_s + settings.settle_s
    longer = max(
        (
            (move.single_s + move.double_s) / (step.single_s + step.double_s)
            for move, step in zip(moves, plan.steps, strict=False)
        ),
        default=1.0,
    )
    return Foretold(why, taken_s, longer)


def _overlap(
    one: tuple[Foothold, tuple[float, float]],
    other: tuple[Foothold, tuple[float, float]],
) -> float:
    """Return how far two soles overlap, along the axis with the least overlap [m].

    Negative for a gap. Two rectangles that do not overlap have a gap along an axis of
    one of them.

    Args:
        one: place, half length and half width of a sole.
        other: the same of the other sole.
    """
    least = math.inf
    for (place, (length, width)), (beside, (its_length, its_width)) in (
        (one, other),
        (other, one),
    ):
        x, y, yaw = beside.seen_from(place)
        cos, sin = abs(math.cos(yaw)), abs(math.sin(yaw))
        least = min(
            least,
            length + cos * its_length + sin * its_width - abs(x),
            width + sin * its_length + cos * its_width - abs(y),
        )
    return least


def _foothold(position: list[float], yaw: float) -> Foothold:
    x, y, z = position
    return Foothold(x, y, z, yaw)
