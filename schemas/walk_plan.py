"""Plan of a walk: a list of footsteps, on the bus and in scenario files."""

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
"""Least and largest height to which a foot may be lifted [m]."""
LONGEST_WALK_S = 3600.0
"""Longest scenario [s]."""
MOST_STEPS = round(LONGEST_WALK_S / (LEAST_SINGLE_S + LEAST_DOUBLE_S))
"""Most steps that fit into the longest scenario."""
FASTEST_M_S, FASTEST_DEG_S = 10.0, 360.0
"""Bounds of speed that no walk comes near [m/s, deg/s]."""
SingleS = Annotated[float, msgspec.Meta(ge=LEAST_SINGLE_S, le=LONGEST_S)]
DoubleS = Annotated[float, msgspec.Meta(ge=LEAST_DOUBLE_S, le=LONGEST_S)]
Position2 = Annotated[list[float], msgspec.Meta(min_length=2, max_length=2)]
StepHeight = Annotated[float, msgspec.Meta(ge=LEAST_HEIGHT_M, le=MOST_HEIGHT_M)]
Speed = Annotated[float, msgspec.Meta(ge=-FASTEST_M_S, le=FASTEST_M_S)]
YawRate = Annotated[float, msgspec.Meta(ge=-FASTEST_DEG_S, le=FASTEST_DEG_S)]
SINGLE_S = 0.6
"""Default single support of a step [s]."""
DOUBLE_S = 0.2
"""Default double support after a step [s]."""
HEIGHT_M = 0.05
"""Default height of the swing foot over the ground [m]."""


class Step(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A footstep: one foot is set to one place, in the odometry frame.

    The odometry frame is the stance frame of the first stance: origin midway between
    the soles, x ahead, z up. It stays in place while the robot walks on.
    """

    id: Count
    """Number of the step; it grows within a plan and from plan to plan."""
    side: Side
    """The foot that is moved."""
    position: Floats3
    """Centre of the sole at touchdown [m]. Only the rise of z against the other
    foothold counts."""
    yaw: float
    """Heading of the sole [rad]."""
    single_s: SingleS
    """Single support: time on the other foot alone."""
    double_s: DoubleS
    """Double support that follows: time on both feet."""
    height_m: StepHeight
    """Height to which the foot is lifted over the higher of its two footholds [m]."""


class WalkPlan(Message, frozen=True, kw_only=True):
    """Plan of a walk from a planner, made at the robot's tick ``tick``.

    It replaces all steps that have not begun. Its steps that have begun are skipped by
    their ``id``; a plan that ends before the last of these is refused. Without steps
    the robot brings its feet together and stands.
    """

    begin_tick: Count
    """The robot's tick at which the first step's weight shift begins; at once if it has
    passed."""
    steps: Annotated[list[Step], msgspec.Meta(max_length=MOST_STEPS)]
    """Steps in order; left and right alternate."""

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
"""Place of a sole: x, y, z [m] and yaw [rad], odometry frame."""
MOST_AHEAD = 11
"""Most coming steps that are reported."""


class WalkStatus(Message, frozen=True, kw_only=True):
    """Progress of a walk, from which a planner can go on."""

    phase: str
    """``stand``, ``shift``, ``single``, ``double`` or ``settle``."""
    phase_s: float
    """Time in the phase [s]."""
    moved: str
    """Foot that was moved last or is moving: ``left`` or ``right``; empty before the
    first walk. In phase ``shift`` it is the foot onto which the weight goes, so that
    the other foot always comes next."""
    last_step: int
    """Largest id of a step that has begun; -1 before the first."""
    steps_done: Count
    """Planned steps that were set down."""
    steps_planned: Count
    """Steps of all accepted plans."""
    foot_left: str
    """``planted``, ``leaving``, ``swing``, ``landing`` or ``relanding``."""
    foot_right: str
    """The same of the right foot."""
    foothold_left: Place
    """Place where the left foot was set down, or is now."""
    foothold_right: Place
    """The same of the right foot."""
    goal_left: Place
    """Like ``foothold_left``; for a foot in the air, the place where it is being
    set."""
    goal_right: Place
    """The same of the right foot."""
    ahead: Annotated[list[Place], msgspec.Meta(max_length=MOST_AHEAD)]
    """Places of the next steps, alternating; the step that brings the feet together is
    included."""
    shift: Position2
    """Shift of the present step by step adjustment [m]."""
    dcm: Position2
    """Estimated DCM [m]."""
    dcm_reference: Position2
    """Reference of the DCM [m]."""
    zmp_reference: Position2
    """Desired ZMP [m]."""
    plan_stamp_ns: Count
    """``stamp_ns`` of the last plan."""
    refusal: str
    """Why the last plan was refused, in words; empty when it was accepted."""


class WalkStep(FileStruct, frozen=True, kw_only=True):
    """A footstep of a scenario file."""

    side: Side
    """The foot that is moved."""
    position_m: Position2
    """Centre of the sole, x ahead and y to the left of where the robot stands at
    first."""
    yaw_deg: float = 0.0
    """Heading of the sole, relative to the initial one."""
    rise_m: float = 0.0
    """Height of the foothold over the ground on which the robot stands at first."""
    step_s: SingleS | None = None
    """Single support; that of the walk when absent."""
    double_s: DoubleS | None = None
    """Double support after the step; that of the walk when absent."""
    height_m: StepHeight | None = None
    """Height to which the foot is lifted; that of the walk when absent."""


def out_of_turn(sides: Sequence[Side]) -> int | None:
    """Return the index of the first step that moves the same foot as the one before."""
    for index, (before, side) in enumerate(itertools.pairwise(sides), 1):
        if side == before:
            return index
    return None


PLANNED_M_S = 0.5
"""Speed that a planner is taken to ask for at most [m/s]."""


class Walk(FileStruct, frozen=True, kw_only=True):
    """Walk instead of stand: with a velocity, by footsteps, or else on the spot."""

    velocity_m_s: Speed = 0.0
    """Speed ahead; negative is backwards."""
    lateral_m_s: Speed = 0.0
    """Speed to the left; negative is to the right."""
    yaw_rate_deg_s: YawRate = 0.0
    """Turning speed, counter-clockwise from above."""
    start_s: Annotated[float, msgspec.Meta(ge=0.0, le=LONGEST_WALK_S)] = 2.0
    """Time at which the weight begins to shift onto the first foot."""
    stop_s: Annotated[float, msgspec.Meta(gt=0.0, le=LONGEST_WALK_S)] | None = None
    """Latest begin of a step of a velocity walk, within the scenario; then the feet
    come together. Absent: early enough to stand for a second at the scenario's end."""
    step_s: SingleS = SINGLE_S
    """Single support of a step."""
    double_s: DoubleS = DOUBLE_S
    """Double support after it."""
    height_m: StepHeight = HEIGHT_M
    """Height to which the swing foot is lifted."""
    step: Annotated[list[WalkStep], msgspec.Meta(max_length=MOST_STEPS)] = []
    """Footsteps in place of a velocity; left and right alternate."""

    def __post_init__(self) -> None:
        """Check that one kind of walk is given, with time for it, and feet in turns."""
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
        """Turning speed [rad/s]."""
        return math.radians(self.yaw_rate_deg_s)

    def reach_m(self, duration_s: float) -> float:
        """Largest distance from the start, by this plan or a planner's [m]."""
        speed = max(math.hypot(self.velocity_m_s, self.lateral_m_s), PLANNED_M_S)
        written = [math.hypot(*step.position_m) for step in self.step]
        return max(speed * duration_s, *written, 0.0)
