"""True state as a message for plots and tests."""

from __future__ import annotations

from schemas.messages import SCHEMA_VERSION, PlatformTruth, Truth
from sim_robot.truth import PlantTruth

NORMAL = 2
"""Index of the force along the sole's normal in a wrench."""


def truth_message(truth: PlantTruth, *, stamp_ns: int) -> Truth:
    """Packs the true state at a tick.

    Args:
        truth: what the plant says.
        stamp_ns: the robot's monotonic clock [ns].
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
    )
