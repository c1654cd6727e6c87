"""One platform, as part of an editable MuJoCo model."""

from __future__ import annotations

import mujoco

from robot_io.robot import Robot
from sim_robot.platforms import PlatformPlan

CONTACT_TIME_CONSTANT_S = 0.004
CONTACT_IMPEDANCE = (0.95, 0.99, 0.001, 0.5, 2.0)
"""Critically damped; the standing robot sinks in by some 35 um."""
PLATFORM_INERTIA = 1e6
"""Rotor inertia of platform joints [kg or kg m^2]: the robot does not move them."""

_SLIDE, _HINGE = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
_JOINTS = {
    "x": (_SLIDE, [1.0, 0.0, 0.0]),
    "y": (_SLIDE, [0.0, 1.0, 0.0]),
    "z": (_SLIDE, [0.0, 0.0, 1.0]),
    "yaw": (_HINGE, [0.0, 0.0, 1.0]),
    "pitch": (_HINGE, [0.0, 1.0, 0.0]),
    "roll": (_HINGE, [1.0, 0.0, 0.0]),
}


def add_platform(
    spec: mujoco.MjSpec, plan: PlatformPlan, *, robot: Robot, friction: float
) -> None:
    """Adds a box that only the soles touch, with a joint for each axis that moves.

    Args:
        spec: the world, with the robot in it.
        plan: the platform.
        robot: whose soles touch it.
        friction: between them.
    """
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
    for foot in (robot.left, robot.right):
        pair = spec.add_pair(geomname1=plan.name, geomname2=foot.sole_frame, condim=3)
        pair.friction[:] = [friction, friction, 0.0, 0.0, 0.0]
        pair.solref[:] = [CONTACT_TIME_CONSTANT_S, 1.0]
        pair.solimp[:] = CONTACT_IMPEDANCE
