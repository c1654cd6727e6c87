"""What a new robot file says of its joints: the URDF's limits, and guessed drives."""

from __future__ import annotations

import numpy as np

from surefoot.robot_files import servos
from surefoot.robot_files.draft import Draft, listed
from surefoot.robot_files.robot_text import JointLines
from surefoot.schemas.arrays import Vec3
from surefoot.stabilizer.stance.body import Body
from surefoot.stabilizer.stance.nominal import NominalPosture


def joint_lines(
    draft: Draft,
    body: Body,
    nominal: NominalPosture,
    *,
    com_height_m: float,
    up: Vec3,
) -> list[JointLines]:
    """Describe all joints, in the order of the URDF.

    Args:
        draft: efforts that are no limits are written anew.
        body: of the draft.
        nominal: its posture.
        com_height_m: above the soles, all joints at zero.
        up: (3,) in the base link.
    """
    model = body.model
    scale = servos.Scale(body.mass, com_height_m)
    in_leg = {
        str(model.names[joint]): (place, leg.joints.index(leg.knee))
        for leg in nominal.legs
        for place, joint in enumerate(leg.joints)
    }
    lines, weak, slow = [], [], []
    for name, element in draft.joints.items():
        if element.get("type") == "fixed":
            continue
        index = int(model.idx_vs[model.getJointId(name)]) - 6
        if name in in_leg:
            place, knee = in_leg[name]
            axis = _axis(body, name)
            like = servos.leg_drive(place=place, knee=knee, axis=axis, up=up)
        else:
            like = servos.upper_drive(body.carried_share(name))
        drive = scale.drive(like)
        limit = element.find("limit")
        assert limit is not None  # as the URDF was checked
        effort = float(limit.get("effort", 0.0))
        torque_is_told = scale.torque_is_told(effort)
        if not torque_is_told:
            limit.set("effort", repr(drive.torque))
            effort = drive.torque
            weak.append(name)
        speed, speed_is_told = servos.velocity_limit(float(limit.get("velocity", 0.0)))
        if not speed_is_told:
            limit.set("velocity", repr(speed))
            slow.append(name)
        lower, upper = model.lowerPositionLimit[7:], model.upperPositionLimit[7:]
        lines.append(
            JointLines(
                name=name,
                drive=drive,
                damping=scale.damping,
                torque=effort,
                torque_is_told=torque_is_told,
                velocity=speed,
                velocity_is_told=speed_is_told,
                nominal=_inside(nominal, index),
                soft_lower=_soft(lower[index], nominal.lower[index]),
                soft_upper=_soft(upper[index], nominal.upper[index]),
            )
        )
    _note_drives(draft, body, com_height_m, weak=weak, slow=slow)
    return lines


def _inside(nominal: NominalPosture, index: int) -> float:
    """A nominal angle with four digits that rounding keeps inside its range [rad]."""
    low, high = nominal.lower[index], nominal.upper[index]
    digits = round(float(nominal.q[index]), 4) + 0.0
    if low <= digits <= high:
        return digits
    return float(np.clip(nominal.q[index], low, high))


def _soft(hard: float, soft: float) -> float | None:
    return None if hard == soft else float(soft)


def _axis(body: Body, joint: str) -> Vec3:
    """(3,) axis of a joint in the base link, all joints at zero."""
    model = body.model
    index = model.getJointId(joint)
    inside = np.asarray(model.joints[index].createData().S).reshape(6, -1)[3:, 0]
    axis: Vec3 = body.data.oMi[index].rotation @ inside
    return axis


def _note_drives(
    draft: Draft, body: Body, height: float, *, weak: list[str], slow: list[str]
) -> None:
    draft.note(
        "found",
        f"{body.mass:.1f} kg, centre of mass {height:.3f} m above the soles with all "
        f"joints at zero; {body.model.nv - 6} joints, in the order of the URDF",
    )
    if weak:
        draft.note(
            "guessed",
            f"torque limits of {len(weak)} joints, whose effort is none or beyond what "
            f"such a robot can have: {listed(weak)}",
        )
    if slow:
        draft.note(
            "guessed",
            f"speed limits of {len(slow)} joints, {servos.USUAL_RAD_S:g} rad/s: "
            f"{listed(slow)}",
        )
    draft.note(
        "guessed",
        "servos (kp, kd), damping and rotor inertia (armature): the Walker's, scaled "
        "by mass and height; rotor inertia matters most: rotor's inertia times gear "
        "ratio squared, or measured from a torque step on a free joint",
    )
