"""True state of the simulator, which the robot does not know."""

from __future__ import annotations

from dataclasses import dataclass

from surefoot.schemas.arrays import Array, Vec3, Vec6
from surefoot.schemas.messages import SCHEMA_VERSION, GroundBlock, PlatformTruth, Truth

NORMAL = 2
"""Index of the force along the sole's normal in a wrench."""


@dataclass(frozen=True, slots=True)
class PlatformPose:
    """A platform's top centre in the world.

    Attributes:
        position: (3,) [m].
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
        com_velocity: (3,) world [m/s].
        sole_left: (3,) sole frame's origin, world [m].
        sole_right: (3,) the same of the right foot.
        F_left: (6,) contact wrench of the ground on the left sole, over the last
            simulation step, in the sole frame [N, N m].
        F_right: (6,) the same of the right foot.
        vertical_forces: their parts along the world's vertical, left and right [N].
        platforms: platforms of the scenario, in its order.
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
        """Of the ground on the left and right sole, along the sole's z axis [N]."""
        return float(self.F_left[2]), float(self.F_right[2])


def truth_message(
    truth: PlantTruth, *, stamp_ns: int, ground: list[GroundBlock]
) -> Truth:
    """Pack the true state at a tick.

    Args:
        truth: what the plant says.
        stamp_ns: the robot's monotonic clock [ns].
        ground: all blocks of it.
    """
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
