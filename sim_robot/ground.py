"""The ground under the feet: its platforms, how they move, and its still parts.

There is one platform under both feet, or one under each. The plant steps the ground.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.motions import Axis, Motion
from surefoot.schemas.scenario import Scenario
from surefoot.sim_robot.catalogue import within
from surefoot.sim_robot.conventions import SIM_STEP_S, MotionLaw
from surefoot.sim_robot.motion import motion_law
from surefoot.sim_robot.robot_spec import Stance

AXES: tuple[Axis, ...] = ("x", "y", "z", "yaw", "pitch", "roll")
"""Order of a platform's joints: R_world_platform = Rz(yaw) Ry(pitch) Rx(roll)."""

HALF_THICKNESS_M = 0.03

SHARED_HALF_SIZE_M = (0.40, 0.45)
"""Half length (x) and half width (y) of a moving platform under both feet [m]."""

WALKED_HALF_SIZE_M = 12.0
"""Least half length and half width of still ground, and where the robot walks [m]."""
BEYOND_WALK_M = 2.0
"""Distance by which ground extends beyond a walk [m]."""

SINGLE_HALF_LENGTH_M = 0.30

SINGLE_OUTWARD_M = 0.30
"""Distance from a sole's centre to the outer edge of a platform under one foot [m]."""

MIDLINE_GAP_M = 0.01
"""Distance from the midline between the feet to such a platform's inner edge [m]."""


CONTACT_TIME_CONSTANT_S = 0.004

CONTACT_IMPEDANCE = (0.95, 0.99, 0.001, 0.5, 2.0)
"""Critically damped contact; the standing robot sinks in by about 35 um."""

PLATFORM_INERTIA = 1e6
"""Rotor inertia of platform joints [kg or kg m^2]: too large for the robot to move."""

_SLIDE, _HINGE = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE

_JOINTS = {
    "x": (_SLIDE, [1.0, 0.0, 0.0]),
    "y": (_SLIDE, [0.0, 1.0, 0.0]),
    "z": (_SLIDE, [0.0, 0.0, 1.0]),
    "yaw": (_HINGE, [0.0, 0.0, 1.0]),
    "pitch": (_HINGE, [0.0, 1.0, 0.0]),
    "roll": (_HINGE, [1.0, 0.0, 0.0]),
}


class PlacedMotion(NamedTuple):
    """A motion with its path in the scenario file, for errors."""

    path: str
    motion: Motion


@dataclass(frozen=True)
class PlatformPlan:
    """A box of ground and its motions.

    Attributes:
        name: ``ground_both``, ``ground_left`` or ``ground_right``.
        in_scenario: whether the scenario file lists it; ground not listed is fixed.
        top_centre: (3,) point of the top face, at rest [m, world], under the sole's
            centre or midway between the soles. Motions move the box from there and
            turn it about this point.
        half_size: (3,) half size of the box [m].
        box_centre: (3,) centre of the box, relative to the top centre [m].
        motions: the scenario's motions by axis; empty when fixed.
        yaw: turn of the box, so that it lies along the robot's heading [rad].
    """

    name: str
    in_scenario: bool
    top_centre: Vec3
    half_size: Vec3
    box_centre: Vec3
    motions: dict[Axis, tuple[PlacedMotion, ...]]
    yaw: float = 0.0

    @property
    def quat_wxyz(self) -> list[float]:
        """(4,) orientation, platform from box."""
        return [math.cos(0.5 * self.yaw), 0.0, 0.0, math.sin(0.5 * self.yaw)]


def plan_platforms(scenario: Scenario, start: Stance) -> tuple[PlatformPlan, ...]:
    """Lay out the ground with a box under every foot.

    Returns:
        The platforms of the scenario in its order, then fixed ground for feet that it
        does not mention. All tops are at z = 0 at rest. Empty if the scenario has only
        tiles: these have a floor around them.
    """
    left, right = start.soles_in_world
    soles = {"left": left, "right": right, "both": 0.5 * (left + right)}
    shared, walk = SHARED_HALF_SIZE_M, scenario.walk
    if walk is not None or not scenario.platform:
        reach = walk.reach_m(scenario.duration_s) if walk is not None else 0.0
        shared = (max(WALKED_HALF_SIZE_M, reach + BEYOND_WALK_M),) * 2
    plans = []
    for at, platform in enumerate(scenario.platform):
        placed = [
            PlacedMotion(f"platform[{at}].motion[{index}]", motion)
            for index, motion in enumerate(platform.motion)
        ]
        motions = {
            axis: chosen
            for axis in AXES
            if (chosen := tuple(m for m in placed if m.motion.axis == axis))
        }
        plans.append(
            _plan(
                platform.foot,
                soles,
                motions=motions,
                in_scenario=True,
                yaw=start.yaw,
                size_m=platform.size_m,
                shared=shared,
            )
        )
    feet = {platform.foot for platform in scenario.platform}
    if not feet and scenario.tile:
        return ()
    if not feet:
        plan = _plan(
            "both", soles, motions={}, in_scenario=False, yaw=start.yaw, shared=shared
        )
        return (plan,)
    if "both" not in feet:
        for foot in ("left", "right"):
            if foot not in feet:
                plans.append(
                    _plan(foot, soles, motions={}, in_scenario=False, yaw=start.yaw)
                )
    return tuple(plans)


def _plan(
    foot: str,
    soles: dict[str, Vec3],
    *,
    motions: dict[Axis, tuple[PlacedMotion, ...]],
    in_scenario: bool,
    yaw: float,
    size_m: list[float] | None = None,
    shared: tuple[float, float] = SHARED_HALF_SIZE_M,
) -> PlatformPlan:
    top_centre = soles[foot] * (1.0, 1.0, 0.0)
    half_length, half_width = shared
    y_centre = 0.0
    if foot != "both":
        x, y, _ = top_centre - soles["both"]
        y_foot = math.cos(yaw) * y - math.sin(yaw) * x
        outward = 1.0 if y_foot >= 0.0 else -1.0
        inner = MIDLINE_GAP_M - abs(y_foot)
        half_length = SINGLE_HALF_LENGTH_M
        half_width = 0.5 * (SINGLE_OUTWARD_M - inner)
        y_centre = outward * 0.5 * (SINGLE_OUTWARD_M + inner)
    if size_m is not None:
        wider = 0.5 * size_m[1] - half_width
        half_length, half_width = 0.5 * size_m[0], 0.5 * size_m[1]
        y_centre += wider if y_centre > 0.0 else -wider if y_centre < 0.0 else 0.0
    box_centre = np.array([0.0, y_centre, -HALF_THICKNESS_M])
    if yaw:
        box_centre[:2] = -math.sin(yaw) * y_centre, math.cos(yaw) * y_centre
    return PlatformPlan(
        name=f"ground_{foot}",
        in_scenario=in_scenario,
        top_centre=top_centre,
        half_size=np.array([half_length, half_width, HALF_THICKNESS_M]),
        box_centre=box_centre,
        motions=motions,
        yaw=yaw,
    )


def add_platform(
    spec: mujoco.MjSpec, plan: PlatformPlan, *, robot: Robot, friction: float
) -> None:
    """Add a box that only the soles touch, with a joint for each moving axis."""
    body = spec.worldbody.add_body(
        name=plan.name,
        pos=plan.top_centre,
        mass=1.0,
        ipos=[0.0, 0.0, 0.0],
        inertia=[1.0, 1.0, 1.0],
        explicitinertial=True,
        gravcomp=1.0,
    )
    body.add_geom(
        name=plan.name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=plan.half_size,
        pos=plan.box_centre,
        quat=plan.quat_wxyz,
        contype=0,
        conaffinity=0,
        rgba=[0.42, 0.45, 0.50, 1.0],
    )
    for axis in plan.motions:
        kind, direction = _JOINTS[axis]
        body.add_joint(
            name=f"{plan.name}_{axis}",
            type=kind,
            axis=direction,
            armature=PLATFORM_INERTIA,
        )
    let_soles_touch(spec, plan.name, robot=robot, friction=friction)


def let_soles_touch(
    spec: mujoco.MjSpec, geom: str, *, robot: Robot, friction: float
) -> None:
    """Let both soles, and nothing else, touch a geom of the ground, in firm contact."""
    for foot in (robot.left, robot.right):
        pair = spec.add_pair(geomname1=geom, geomname2=foot.sole_frame, condim=3)
        pair.name = f"{geom} {foot.sole_frame}"
        pair.friction[:] = [friction, friction, 0.0, 0.0, 0.0]
        pair.solref[:] = [CONTACT_TIME_CONSTANT_S, 1.0]
        pair.solimp[:] = CONTACT_IMPEDANCE


class Ground:
    """The moving ground of a world.

    Each moving axis of a platform is a joint of huge inertia. Its position and velocity
    follow the scenario exactly. The force of its acceleration is applied as well, so a
    contact sees the ground with its motion at the end of the step. After the
    translation, rotations compose as Rz(yaw) Ry(pitch) Rx(roll), about the platform's
    top centre.
    """

    def __init__(
        self, platforms: Sequence[PlatformPlan], data: mujoco.MjData, *, after: int
    ) -> None:
        """Take over the platform joints of ``data``, at rest at zero.

        Args:
            platforms: of the world of ``data``.
            data: their state is changed in place.
            after: number of the world's degrees of freedom that come after theirs.

        Raises:
            ScenarioError: a motion cannot be done.
        """
        self._laws: list[tuple[MotionLaw, ...]] = [
            tuple(_law(placed) for placed in motions)
            for platform in platforms
            for motions in platform.motions.values()
        ]
        count = len(self._laws)
        first = len(data.qvel) - after - count
        self._qpos = data.qpos[first + 1 : first + 1 + count]
        self._qvel = data.qvel[first : first + count]
        self._force = data.qfrc_applied[first : first + count]
        self._position: Array = np.zeros(count)
        self._velocity: Array = np.zeros(count)
        self.arrive()

    @property
    def moves(self) -> bool:
        """Whether any platform moves in this scenario."""
        return bool(self._laws)

    def aim(self, time_s: float) -> None:
        """Push the platforms towards their places after the next step."""
        for index, laws in enumerate(self._laws):
            position = velocity = 0.0
            for law in laws:
                p, v = law(time_s)
                position += p
                velocity += v
            self._position[index] = position
            self._velocity[index] = velocity
        np.subtract(self._velocity, self._qvel, out=self._force)
        self._force *= PLATFORM_INERTIA / SIM_STEP_S

    def arrive(self) -> None:
        """Put the platforms exactly at their places after a step."""
        self._qpos[:] = self._position
        self._qvel[:] = self._velocity


def _law(placed: PlacedMotion) -> MotionLaw:
    with within(placed.path):
        return motion_law(placed.motion)
