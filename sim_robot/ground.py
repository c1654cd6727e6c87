"""All the ground under the feet: what moves of it, and what stands still."""

from __future__ import annotations

import mujoco
import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import GroundBlock
from surefoot.sim_robot.conventions import SIM_STEP_S
from surefoot.sim_robot.errors import within
from surefoot.sim_robot.motion import motion_law
from surefoot.sim_robot.motion_law import MotionLaw
from surefoot.sim_robot.platforms import PLATFORM_INERTIA, PlacedMotion, PlatformPlan
from surefoot.sim_robot.still_ground import StillGround
from surefoot.sim_robot.world import World

STILL = -1
"""What ground that stands fast says for its platform."""


def ground_blocks(world: World) -> list[GroundBlock]:
    """Return all blocks, platforms first.

    Args:
        world: of the run.
    """
    blocks = []
    index = 0
    for plan in world.platforms:
        blocks.append(_platform(plan, index if plan.in_scenario else STILL))
        index += plan.in_scenario
    for ground in world.still:
        blocks.append(_seesaw(ground, index) if ground.tip_rad else _still(ground))
        index += ground.tip_rad > 0.0
    return blocks


def _platform(plan: PlatformPlan, index: int) -> GroundBlock:
    top = plan.box_centre + np.array([0.0, 0.0, plan.half_size[2]])
    if index == STILL:
        top = top + plan.top_centre
    w, x, y, z = plan.quat_wxyz
    return GroundBlock(
        position=top.tolist(),
        quat_xyzw=[x, y, z, w],
        size=(2.0 * plan.half_size).tolist(),
        platform=index,
    )


def _still(ground: StillGround) -> GroundBlock:
    w, x, y, z = ground.quat_wxyz
    return GroundBlock(
        position=ground.top_centre.tolist(),
        quat_xyzw=[x, y, z, w],
        size=ground.size.tolist(),
        platform=STILL,
    )


def _seesaw(ground: StillGround, index: int) -> GroundBlock:
    return GroundBlock(
        position=[0.0, 0.0, 0.0],
        quat_xyzw=[0.0, 0.0, 0.0, 1.0],
        size=ground.size.tolist(),
        platform=index,
    )


class Ground:
    """The moving ground of a world.

    Each axis of a platform that moves is a joint of huge inertia. Its position and
    velocity follow the scenario exactly; the force that goes with its acceleration
    is applied as well, so that a contact sees the ground as it will have moved at
    the end of the step. Rotations compose as Rz(yaw) Ry(pitch) Rx(roll), after the
    translation, about the platform's top centre.
    """

    def __init__(self, world: World, data: mujoco.MjData) -> None:
        """Take over the platform joints of ``data``, at rest in zero.

        Raises:
            ScenarioError: a motion cannot be done.
        """
        self._laws: list[tuple[MotionLaw, ...]] = [
            tuple(_law(placed) for placed in motions)
            for platform in world.platforms
            for motions in platform.motions.values()
        ]
        count = len(self._laws)
        first = world.model.nv - len(world.seesaws) - count
        self._qpos = data.qpos[first + 1 : first + 1 + count]
        self._qvel = data.qvel[first : first + count]
        self._force = data.qfrc_applied[first : first + count]
        self._position: Array = np.zeros(count)
        self._velocity: Array = np.zeros(count)
        self._write()

    @property
    def moves(self) -> bool:
        """Whether any platform moves at all in this scenario."""
        return bool(self._laws)

    def aim(self, time_s: float) -> None:
        """Push the platforms towards where they will be after the next step.

        Args:
            time_s: end of the step.
        """
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
        """Put the platforms exactly where they belong after a step."""
        self._write()

    def _write(self) -> None:
        self._qpos[:] = self._position
        self._qvel[:] = self._velocity


def _law(placed: PlacedMotion) -> MotionLaw:
    with within(placed.path):
        return motion_law(placed.motion)
