"""The simulator's true state: live views, copies, and its message for the bus."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from surefoot.schemas.arrays import Array, Vec3, Vec6
from surefoot.schemas.messages import SCHEMA_VERSION, GroundBlock, PlatformTruth, Truth
from surefoot.sim_robot.conventions import xyzw
from surefoot.sim_robot.robot_spec import SENSOR_SOLES
from surefoot.sim_robot.world import World

_LEFT = SENSOR_SOLES.start
_RIGHT = SENSOR_SOLES.start + 6
STILL = -1
"""Platform index of ground that stands still."""
_UNTURNED_WXYZ = (1.0, 0.0, 0.0, 0.0)
NORMAL = 2
"""Index of the force along the sole's normal in a wrench."""


class PlantView:
    """True state, read directly from the arrays of the simulation.

    Attributes:
        com: (3,) centre of mass, world [m]; live, like all arrays here.
        sole_left: (3,) origin of the left sole frame, world [m].
        sole_right: (3,) origin of the right sole frame, world [m].
        upper_names: links above the ankles, in the order of :meth:`heights`.
    """

    def __init__(self, world: World, data: mujoco.MjData) -> None:
        """Find the arrays, which remain those of ``data``."""
        base = world.base_body
        left, right = world.sole_bodies
        self.com: Vec3 = data.subtree_com[base]
        self.sole_left: Vec3 = data.xpos[left]
        self.sole_right: Vec3 = data.xpos[right]
        self._base_position = data.qpos[:3]
        self._base_quat_wxyz = data.qpos[3:7]
        self._base_vertical = data.xmat[base, 6:9]
        self._base_up = world.base_up.tolist()
        self._sole_verticals = data.xmat[left, 6:9], data.xmat[right, 6:9]
        self._com_velocity = data.subtree_linvel[base]
        self._heights = data.xpos[:, 2]
        trunk = _trunk(world.model, base)
        self._height_bodies = np.array([trunk, left, right, *world.upper_bodies])
        self.upper_names = [world.model.body(i).name for i in world.upper_bodies]
        self._sensors = data.sensordata
        bodies = [
            body
            for body, plan in zip(world.ground_bodies, world.platforms, strict=True)
            if plan.in_scenario
        ]
        self._platforms = [
            (data.xpos[body], data.xquat[body]) for body in (*bodies, *world.seesaws)
        ]

    @property
    def upright(self) -> float:
        """Cosine of the angle between the base and its nominal attitude."""
        x, y, z = self._base_vertical.tolist()
        up_x, up_y, up_z = self._base_up
        return float(x * up_x + y * up_y + z * up_z)

    @property
    def sole_tilts(self) -> tuple[float, float]:
        """Angles of left and right sole against the horizontal [rad]."""
        left, right = (min(axis.item(2), 1.0) for axis in self._sole_verticals)
        return math.acos(left), math.acos(right)

    @property
    def normal_forces(self) -> tuple[float, float]:
        """Forces of the ground on left and right sole, along the sole's z axis [N]."""
        # MuJoCo's sign is that of the robot's force on the ground.
        sensors = self._sensors
        return -sensors.item(_LEFT + 2), -sensors.item(_RIGHT + 2)

    @property
    def vertical_forces(self) -> tuple[float, float]:
        """Forces of the ground on left and right sole, along the world's z axis [N]."""
        force = self._sensors
        left, right = self._sole_verticals
        return (
            -left.item(0) * force.item(_LEFT)
            - left.item(1) * force.item(_LEFT + 1)
            - left.item(2) * force.item(_LEFT + 2),
            -right.item(0) * force.item(_RIGHT)
            - right.item(1) * force.item(_RIGHT + 1)
            - right.item(2) * force.item(_RIGHT + 2),
        )

    def heights(self) -> list[float]:
        """Return world z of base, soles, then all links above the ankles [m]."""
        heights: list[float] = self._heights.take(self._height_bodies).tolist()
        return heights

    def truth(self, tick: int) -> PlantTruth:
        """Copy the true state; the CoM's velocity must have been computed before."""
        wrenches = -self._sensors[SENSOR_SOLES]
        return PlantTruth(
            tick=tick,
            base_position=self._base_position.copy(),
            base_quat_xyzw=xyzw(self._base_quat_wxyz),
            upright=self.upright,
            com=self.com.copy(),
            com_velocity=self._com_velocity.copy(),
            sole_left=self.sole_left.copy(),
            sole_right=self.sole_right.copy(),
            F_left=wrenches[:6],
            F_right=wrenches[6:],
            vertical_forces=self.vertical_forces,
            platforms=tuple(
                PlatformPose(position=position.copy(), quat_xyzw=xyzw(quat_wxyz))
                for position, quat_wxyz in self._platforms
            ),
        )


@dataclass(frozen=True, slots=True)
class PlatformPose:
    """Pose of a platform's top centre in the world.

    Attributes:
        position: (3,) position [m].
        quat_xyzw: (4,) world from platform.
    """

    position: Vec3
    quat_xyzw: Array


@dataclass(frozen=True, slots=True)
class PlantTruth:
    """True state at a tick; for plots, metrics and tests, never for control.

    Attributes:
        tick: control tick.
        base_position: (3,) base origin, world [m].
        base_quat_xyzw: (4,) world from base.
        upright: cosine of the angle by which the base leans from its nominal attitude.
        com: (3,) centre of mass, world [m].
        com_velocity: (3,) velocity of the centre of mass, world [m/s].
        sole_left: (3,) origin of the left sole frame, world [m].
        sole_right: (3,) origin of the right sole frame, world [m].
        F_left: (6,) contact wrench of the ground on the left sole, over the last
            simulation step, in the sole frame [N, N m].
        F_right: (6,) the same for the right sole.
        vertical_forces: their components along the world's vertical, left, right [N].
        platforms: platforms of the scenario in its order, then its seesaws.
    """

    tick: int
    base_position: Vec3
    base_quat_xyzw: Array
    upright: float
    com: Vec3
    com_velocity: Vec3
    sole_left: Vec3
    sole_right: Vec3
    F_left: Vec6
    F_right: Vec6
    vertical_forces: tuple[float, float]
    platforms: tuple[PlatformPose, ...]

    @property
    def normal_forces(self) -> tuple[float, float]:
        """Forces of the ground on left and right sole, along the sole's z axis [N]."""
        return float(self.F_left[2]), float(self.F_right[2])


def ground_blocks(world: World) -> list[GroundBlock]:
    """Return all blocks of the ground, platforms first."""
    blocks = []
    index = 0
    for plan in world.platforms:
        top = plan.box_centre + np.array([0.0, 0.0, plan.half_size[2]])
        if not plan.in_scenario:
            top = top + plan.top_centre
        carrier = index if plan.in_scenario else STILL
        blocks.append(_block(top, plan.quat_wxyz, 2.0 * plan.half_size, carrier))
        index += plan.in_scenario
    for ground in world.still:
        if ground.tip_rad > 0.0:  # a seesaw carries itself
            blocks.append(_block(np.zeros(3), _UNTURNED_WXYZ, ground.size, index))
            index += 1
        else:
            place, turn = ground.top_centre, ground.quat_wxyz
            blocks.append(_block(place, turn, ground.size, STILL))
    return blocks


def _block(
    position: Vec3, quat_wxyz: Sequence[float], size: Vec3, platform: int
) -> GroundBlock:
    w, x, y, z = quat_wxyz
    return GroundBlock(
        position=position.tolist(),
        quat_xyzw=[x, y, z, w],
        size=size.tolist(),
        platform=platform,
    )


def truth_message(
    truth: PlantTruth, *, stamp_ns: int, ground: list[GroundBlock]
) -> Truth:
    """Pack the true state of a tick into a message."""
    return Truth(
        schema=SCHEMA_VERSION,
        tick=truth.tick,
        stamp_ns=stamp_ns,
        base_position=truth.base_position.tolist(),
        base_quat_xyzw=truth.base_quat_xyzw.tolist(),
        com=truth.com.tolist(),
        com_velocity=truth.com_velocity.tolist(),
        sole_left=truth.sole_left.tolist(),
        sole_right=truth.sole_right.tolist(),
        F_left=truth.F_left.tolist(),
        F_right=truth.F_right.tolist(),
        normal_force=[float(truth.F_left[NORMAL]), float(truth.F_right[NORMAL])],
        platforms=[
            PlatformTruth(
                position=platform.position.tolist(),
                quat_xyzw=platform.quat_xyzw.tolist(),
            )
            for platform in truth.platforms
        ],
        ground=ground,
    )


def _trunk(model: mujoco.MjModel, base: int) -> int:
    """Return the base, or if it has no mass, the heaviest body fixed to it."""
    fixed = [base]
    for body in range(base + 1, model.nbody):  # parents come before their children
        if model.body_parentid[body] in fixed and not model.body_jntnum[body]:
            fixed.append(body)
    heaviest = max(fixed, key=lambda body: float(model.body_mass[body]))
    return base if model.body_mass[base] > 0.0 else heaviest
