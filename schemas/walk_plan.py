"""A walk as it is planned: a list of footsteps, on the bus and in scenario files."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Annotated

import msgspec

from surefoot.schemas.arrays import Floats3
from surefoot.schemas.messages import Count, Message
from surefoot.schemas.robot_file import Side
from surefoot.schemas.toml_file import FileStruct

LEAST_SINGLE_S, LEAST_DOUBLE_S, LONGEST_S = 0.2, 0.05, 10.0
"""Least single and double support of a step, and the longest of either [s]."""
LEAST_HEIGHT_M, MOST_HEIGHT_M = 0.01, 0.5
"""How high a foot may be lifted [m]."""
LONGEST_WALK_S = 3600.0
"""No scenario is longer."""
MOST_STEPS = round(LONGEST_WALK_S / (LEAST_SINGLE_S + LEAST_DOUBLE_S))
"""As many are taken in an hour, at most."""
FASTEST_M_S, FASTEST_DEG_S = 10.0, 360.0
"""What nobody who walks comes near."""
SingleS = Annotated[float, msgspec.Meta(ge=LEAST_SINGLE_S, le=LONGEST_S)]
DoubleS = Annotated[float, msgspec.Meta(ge=LEAST_DOUBLE_S, le=LONGEST_S)]
Position2 = Annotated[list[float], msgspec.Meta(min_length=2, max_length=2)]
StepHeight = Annotated[float, msgspec.Meta(ge=LEAST_HEIGHT_M, le=MOST_HEIGHT_M)]
Speed = Annotated[float, msgspec.Meta(ge=-FASTEST_M_S, le=FASTEST_M_S)]
YawRate = Annotated[float, msgspec.Meta(ge=-FASTEST_DEG_S, le=FASTEST_DEG_S)]
SINGLE_S = 0.6
"""Single support of a step, where nothing else is said [s]."""
DOUBLE_S = 0.2
"""Double support after it [s]."""
HEIGHT_M = 0.05
"""Height of the swing foot over the ground [m]."""


class Step(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One foot set to one place, in the odometry frame.

    That frame is the stance frame of the first stance: origin midway between the
    soles, x ahead, z up. It stays where it was while the robot walks on.
    """

    id: Count
    """Grows from step to step, also from plan to plan."""
    side: Side
    """The foot that is moved."""
    position: Floats3
    """Sole's centre when it is set down [m]. Of z only the rise against the other
    foothold counts."""
    yaw: float
    """Heading of the sole [rad]."""
    single_s: SingleS
    """Time on the other foot alone."""
    double_s: DoubleS
    """Time on both feet that follows."""
    height_m: StepHeight
    """How high the foot is lifted over the higher of its two footholds [m]."""


class WalkPlan(Message, frozen=True, kw_only=True):
    """What a planner wants walked; ``tick`` is the robot's tick it was made at.

    It takes the place of all steps that have not begun; steps that have are passed
    over by their ``id``, and a plan that ends before the last of these is refused.
    Without steps the robot brings its feet together and stands.
    """

    begin_tick: Count
    """The first step's weight shift begins at this tick of the robot, or at once
    where it has gone by."""
    steps: Annotated[list[Step], msgspec.Meta(max_length=MOST_STEPS)]
    """In order; left and right take turns."""

    def __post_init__(self) -> None:
        """Check order of ids and sides."""
        for before, step in zip(self.steps, self.steps[1:], strict=False):
            if step.id <= before.id:
                raise ValueError(f"step ids must grow, got {step.id} after {before.id}")
        index = out_of_turn([step.side for step in self.steps])
        if index is not None:
            step = self.steps[index]
            raise ValueError(
                f"step {step.id} moves the {step.side} foot, as the step before "
                "it; left and right take turns"
            )


STEP_BYTES, HEAD_BYTES = 128, 256
"""Of a step on the wire, and of what is around the steps, at most."""


def parts_of(plan: WalkPlan, *, most_bytes: int) -> list[WalkPlan]:
    """Cut a plan into messages that the bus lets pass, in order; see :func:`joined`.

    Args:
        plan: any number of steps.
        most_bytes: of a message.
    """
    size = max(1, (most_bytes - HEAD_BYTES) // STEP_BYTES)
    begins = range(0, max(1, len(plan.steps)), size)
    return [
        msgspec.structs.replace(plan, steps=plan.steps[begin : begin + size])
        for begin in begins
    ]


def joined(messages: Iterable[WalkPlan]) -> list[WalkPlan]:
    """Put plans together again whose parts have tick and stamp in common."""
    parts = itertools.groupby(messages, key=lambda plan: (plan.tick, plan.stamp_ns))
    plans = []
    for _, same in parts:
        first, *others = same
        steps = itertools.chain(first.steps, *(part.steps for part in others))
        plans.append(msgspec.structs.replace(first, steps=list(steps)))
    return plans


Place = Annotated[list[float], msgspec.Meta(min_length=4, max_length=4)]
"""x, y, z [m] and yaw [rad] of a sole, odometry frame."""
MOST_AHEAD = 11
"""Steps to come that are told of, at most."""


class WalkStatus(Message, frozen=True, kw_only=True):
    """How a walk goes: what a planner needs to go on."""

    phase: str
    """``stand``, ``shift``, ``single``, ``double`` or ``settle``."""
    phase_s: float
    """Time in it [s]."""
    moved: str
    """The foot moved last, or on its way: ``left`` or ``right``; empty before the first
    walk. While the weight shifts, ``shift``, the foot that it goes onto: on the way it
    is always the other one's turn."""
    last_step: int
    """Largest id of a step that has begun; -1 before the first."""
    steps_done: Count
    """Steps of plans that were set down."""
    steps_planned: Count
    """Steps of all plans that were taken."""
    foot_left: str
    """``planted``, ``leaving``, ``swing``, ``landing`` or ``relanding``."""
    foot_right: str
    """The same of the right foot."""
    foothold_left: Place
    """Where the left foot was set down, or is."""
    foothold_right: Place
    """The same of the right foot."""
    goal_left: Place
    """The same, but of a foot in the air where it is being set."""
    goal_right: Place
    """The same of the right foot."""
    ahead: Annotated[list[Place], msgspec.Meta(max_length=MOST_AHEAD)]
    """Where the feet go after that, in turns; the step that brings them together
    included."""
    shift: Position2
    """Of the step under way, by step adjustment [m]."""
    dcm: Position2
    """Estimated divergent component of motion [m]."""
    dcm_reference: Position2
    """Where it should be [m]."""
    zmp_reference: Position2
    """Wanted zero-moment point [m]."""
    plan_stamp_ns: Count
    """``stamp_ns`` of the last plan."""
    refusal: str
    """Why it was refused, in words; empty when it was taken."""


class WalkStep(FileStruct, frozen=True, kw_only=True):
    """A footstep of a scenario file."""

    side: Side
    """The foot that is moved."""
    position_m: Position2
    """Sole's centre, x ahead and y to the left of where the robot stands at first."""
    yaw_deg: float = 0.0
    """Heading of the sole, against that at first."""
    rise_m: float = 0.0
    """Height of the foothold over the ground the robot stands on at first."""
    step_s: SingleS | None = None
    """Single support; the walk's when absent."""
    double_s: DoubleS | None = None
    """Double support after it; the walk's when absent."""
    height_m: StepHeight | None = None
    """How high the foot is lifted; the walk's when absent."""


def out_of_turn(sides: Sequence[Side]) -> int | None:
    """Return which is the first step that moves the foot of the one before it."""
    for index, (before, side) in enumerate(itertools.pairwise(sides), 1):
        if side == before:
            return index
    return None


PLANNED_M_S = 0.5
"""A planner may have the robot walk as fast."""


class Walk(FileStruct, frozen=True, kw_only=True):
    """Walk instead of stand: with a velocity, or by footsteps; on the spot without."""

    velocity_m_s: Speed = 0.0
    """Ahead; negative for backwards."""
    lateral_m_s: Speed = 0.0
    """To the left; negative to the right."""
    yaw_rate_deg_s: YawRate = 0.0
    """Counter-clockwise from above."""
    start_s: Annotated[float, msgspec.Meta(ge=0.0, le=LONGEST_WALK_S)] = 2.0
    """When the weight begins to shift onto the first foot."""
    stop_s: Annotated[float, msgspec.Meta(gt=0.0, le=LONGEST_WALK_S)] | None = None
    """No step of a velocity begins later, nor after the scenario's end; then the feet
    come together. Absent: in time to stand for a second at the scenario's end."""
    step_s: SingleS = SINGLE_S
    """Single support of a step."""
    double_s: DoubleS = DOUBLE_S
    """Double support after it."""
    height_m: StepHeight = HEIGHT_M
    """How high the swing foot is lifted."""
    step: Annotated[list[WalkStep], msgspec.Meta(max_length=MOST_STEPS)] = []
    """Footsteps in place of a velocity; left and right take turns."""

    def __post_init__(self) -> None:
        """Check that there is one kind of walk, time for it, and turns are taken."""
        moves = (self.velocity_m_s, self.lateral_m_s, self.yaw_rate_deg_s)
        if self.step and any(moves):
            raise ValueError("takes a velocity, or [[walk.step]], not both")
        if self.stop_s is not None and self.stop_s <= self.start_s:
            raise ValueError(
                f"`stop_s` is {self.stop_s:g}, expected later than `start_s`, "
                f"{self.start_s:g}"
            )
        index = out_of_turn([step.side for step in self.step])
        if index is not None:
            raise ValueError(
                f"at `step[{index}].side`: got {self.step[index].side!r}, as the step "
                "before it; left and right take turns"
            )

    @property
    def yaw_rate(self) -> float:
        """Of the walk [rad/s]."""
        return math.radians(self.yaw_rate_deg_s)

    def reach_m(self, duration_s: float) -> float:
        """How far from its start a robot may get, by this plan or another's [m]."""
        speed = max(math.hypot(self.velocity_m_s, self.lateral_m_s), PLANNED_M_S)
        written = [math.hypot(*step.position_m) for step in self.step]
        return max(speed * duration_s, *written, 0.0)
