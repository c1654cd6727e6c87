"""The ground of a world as blocks, for pages that draw it."""

from __future__ import annotations

import numpy as np

from surefoot.schemas.messages import GroundBlock
from surefoot.sim_robot.platforms import PlatformPlan
from surefoot.sim_robot.still_ground import StillGround
from surefoot.sim_robot.world import World

STILL = -1
"""What ground that stands still says for its platform."""


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
    return [*blocks, *(_still(ground) for ground in world.still)]


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
    from scipy.spatial.transform import Rotation

    return GroundBlock(
        position=ground.top_centre.tolist(),
        quat_xyzw=Rotation.from_matrix(ground.R_world_top).as_quat().tolist(),
        size=ground.size.tolist(),
        platform=STILL,
    )
