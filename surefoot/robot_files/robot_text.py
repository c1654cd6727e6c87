"""The text of a new robot file: joints, guessed servos, and what was found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from surefoot.robot_files.draft import Draft, listed
from surefoot.schemas.arrays import GRAVITY_M_S2, Vec3
from surefoot.schemas.robot_file import Foot
from surefoot.schemas.toml_file import toml_text
from surefoot.stabilizer.stance.legs import Body
from surefoot.stabilizer.stance.nominal import NominalPosture

WALKER_MASS_KG = 70.0
WALKER_COM_HEIGHT_M = 0.83
FASTEST_RAD_S, USUAL_RAD_S = 50.0, 6.0
"""A higher joint speed in a URDF is a placeholder; the second value replaces it."""
STRONGEST = 2.0
"""A torque above this multiple of mass x gravity x height is a placeholder."""
HOLD_S, HOLD_TICKS = 0.02, 4
"""Silence that the robot tolerates: the longer of the two [s, ticks]."""
_DAMPING = 1.0
_UPRIGHT_AXIS = 0.7
GUESSED = "  # guessed"
_SERVO = """
# How a servo's set-point follows a command: its fastest motion and its lag.
[servo]
profile = "ideal"

[servo.profiles.ideal]
velocity_limit_rad_s = 12.0  # guessed
lag_s = 0.0  # guessed; delay of a slow sine motion of the joint

# Slow drives, as with harmonic gears: --servo-profile harmonic.
[servo.profiles.harmonic]
velocity_limit_rad_s = 3.1  # guessed
lag_s = 0.02  # guessed

# Limits of the commands that the robot accepts.
"""
_GATE = """[gate]
step_limit_rad = {step}
hold_after_s = {hold}
fault_after_s = 1.0

# Arrays on the bus have the joints in this order. kp, kd and damping are the servo's,
# from its maker or a step response. armature is the rotor's inertia times the gear
# ratio squared.
"""


class Drive(NamedTuple):
    """The parameters of a servo.

    Attributes:
        kp: stiffness [N m/rad].
        kd: damping [N m s/rad].
        armature: rotor inertia at the joint [kg m^2].
        torque: torque limit [N m].
    """

    kp: float
    kd: float
    armature: float
    torque: float


_STRONG = Drive(6000.0, 150.0, 0.2, 270.0)
_FIRM = Drive(4000.0, 100.0, 0.15, 160.0)
_SHOULDER = Drive(1000.0, 40.0, 0.12, 96.2)
_ARM = Drive(600.0, 25.0, 0.1, 96.2)
_LIGHT = Drive(200.0, 8.0, 0.03, 27.3)
_CARRIES = ((0.2, _STRONG), (0.035, _SHOULDER), (0.015, _ARM), (0.0, _LIGHT))
"""Drives of joints above the legs, by the share of the mass that they carry."""


class Scale:
    """Scales the Walker's drives to another robot.

    M is the mass and h the height of the CoM, relative to the Walker's. At the same
    gravity, the stiffness against tipping grows with M h. Motions slow down with
    sqrt(h), so damping grows with M h^1.5 and inertia with M h^2.
    """

    def __init__(self, mass_kg: float, com_height_m: float) -> None:
        """Compute the ratios to the Walker."""
        self.tipping_nm = mass_kg * GRAVITY_M_S2 * com_height_m
        mass, height = mass_kg / WALKER_MASS_KG, com_height_m / WALKER_COM_HEIGHT_M
        self._stiff = mass * height
        self._damped = mass * height**1.5
        self._heavy = mass * height**2

    def drive(self, like: Drive) -> Drive:
        """Return one of the Walker's drives, scaled to this robot."""
        return Drive(
            kp=_round(like.kp * self._stiff),
            kd=_round(like.kd * self._damped),
            armature=_round(like.armature * self._heavy),
            torque=_round(like.torque * self._stiff),
        )

    @property
    def damping(self) -> float:
        """Passive damping [N m s/rad]."""
        return _round(_DAMPING * self._damped)

    def torque_is_told(self, effort: float) -> bool:
        """Return whether a URDF's effort [N m] is a limit, and not a placeholder."""
        return 0.0 < effort <= STRONGEST * self.tipping_nm


def leg_drive(*, place: int, knee: int, axis: Vec3, up: Vec3) -> Drive:
    """Return the Walker's drive for a leg joint.

    Args:
        place: index of the joint in its leg, 0 at the base.
        knee: index of the knee.
        axis: (3,) unit axis in the base link, with all joints at zero.
        up: (3,) unit vector in the base link.
    """
    is_yaw = place < knee and abs(float(axis @ up)) > _UPRIGHT_AXIS
    return _FIRM if is_yaw or place > knee else _STRONG


def velocity_limit(told: float) -> tuple[float, bool]:
    """Return a joint's speed limit [rad/s], and whether it is the URDF's."""
    is_told = 0.0 < told <= FASTEST_RAD_S
    return (told if is_told else USUAL_RAD_S), is_told


def _round(value: float) -> float:
    """Round to three digits, since the value is a guess."""
    return float(np.format_float_positional(value, 3, fractional=False))


def joint_lines(
    draft: Draft,
    body: Body,
    nominal: NominalPosture,
    *,
    com_height_m: float,
    up: Vec3,
) -> list[JointLines]:
    """Describe all joints, in the order of the URDF.

    Efforts in the draft that are placeholders are replaced by guesses.

    Args:
        draft: its limits are changed in place.
        body: the robot.
        nominal: its nominal posture.
        com_height_m: CoM above the soles, with all joints at zero [m].
        up: (3,) unit vector in the base link, with all joints at zero.
    """
    model = body.model
    scale = Scale(body.mass, com_height_m)
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
            like = leg_drive(place=place, knee=knee, axis=axis, up=up)
        else:
            share = body.carried_share(name)
            like = next(drive for least, drive in _CARRIES if share >= least)
        drive = scale.drive(like)
        limit = element.find("limit")
        assert limit is not None  # checked before
        effort = float(limit.get("effort", 0.0))
        torque_is_told = scale.torque_is_told(effort)
        if not torque_is_told:
            limit.set("effort", repr(drive.torque))
            effort = drive.torque
            weak.append(name)
        speed, speed_is_told = velocity_limit(float(limit.get("velocity", 0.0)))
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
    """Return a nominal angle with four digits, kept inside its range [rad]."""
    low, high = nominal.lower[index], nominal.upper[index]
    digits = round(float(nominal.q[index]), 4) + 0.0
    if low <= digits <= high:
        return digits
    return float(np.clip(nominal.q[index], low, high))


def _soft(hard: float, soft: float) -> float | None:
    return None if hard == soft else float(soft)


def _axis(body: Body, joint: str) -> Vec3:
    """Return (3,) a joint's axis in the base link, with all joints at zero."""
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
            f"speed limits of {len(slow)} joints, {USUAL_RAD_S:g} rad/s: "
            f"{listed(slow)}",
        )
    draft.note(
        "guessed",
        "servos (kp, kd), damping and rotor inertia (armature): the Walker's, scaled "
        "by mass and height; rotor inertia matters most: rotor's inertia times gear "
        "ratio squared, or measured from a torque step on a free joint",
    )


class JointLines(NamedTuple):
    """The robot file's entries for one joint.

    Attributes:
        name: name in the URDF.
        drive: guessed drive.
        damping: guessed passive damping [N m s/rad].
        torque: torque limit [N m].
        torque_is_told: whether the URDF gives it.
        velocity: speed limit [rad/s].
        velocity_is_told: whether the URDF gives it.
        nominal: nominal angle [rad].
        soft_lower: lower end of the used range [rad]; None if it is the joint's own.
        soft_upper: upper end of the used range [rad]; None if it is the joint's own.
    """

    name: str
    drive: Drive
    damping: float
    torque: float
    torque_is_told: bool
    velocity: float
    velocity_is_told: bool
    nominal: float
    soft_lower: float | None
    soft_upper: float | None


def robot_text(
    *,
    name: str,
    source: str,
    rate_hz: float,
    base_link: str,
    base_height_m: float,
    imu: str,
    feet: Sequence[Foot],
    nominal: NominalPosture,
    joints: Sequence[JointLines],
) -> str:
    """Return the TOML; feet are left, then right, joints in the order of the bus."""
    sink, rise = nominal.com_travel_m
    head = toml_text(
        {
            "name": name,
            "urdf": f"{name}.urdf",
            "namespace": name,
            "rate_hz": rate_hz,
            "base_link": base_link,
            "nominal_base_height_m": round(base_height_m, 4),
        }
    )
    head += f"com_travel_m = [{sink}, {rise}]\n\n"
    head += toml_text({"imu": {"frame": imu}})
    soles = "".join(
        "\n[[foot]]\n"
        + toml_text(
            {
                "side": foot.side,
                "sole_frame": foot.sole_frame,
                "ft_link": foot.ft_link,
                "half_length_m": foot.half_length_m,
                "half_width_m": foot.half_width_m,
            }
        )
        for foot in feet
    )
    return "".join(
        (
            f"# Made from {source} by surefoot new-robot. Units are in the key names;\n"
            "# replace numbers that are marked as guessed by measured ones.\n",
            head,
            soles,
            _SERVO,
            _GATE.format(
                step=round(20.0 / rate_hz, 5),
                hold=round(max(HOLD_S, HOLD_TICKS / rate_hz), 4),
            ),
            *map(_joint_text, joints),
        )
    )


def _joint_text(joint: JointLines) -> str:
    told = {
        "torque_limit_nm": (joint.torque, joint.torque_is_told),
        "velocity_limit_rad_s": (joint.velocity, joint.velocity_is_told),
        "nominal_rad": (joint.nominal, True),
        "soft_lower_rad": (joint.soft_lower, True),
        "soft_upper_rad": (joint.soft_upper, True),
    }
    guessed = {
        "kp_nm_rad": (joint.drive.kp, False),
        "kd_nm_s_rad": (joint.drive.kd, False),
        "armature_kg_m2": (joint.drive.armature, False),
        "damping_nm_s_rad": (joint.damping, False),
    }
    lines = [
        toml_text({key: float(value)}).rstrip() + ("" if is_told else GUESSED)
        for key, (value, is_told) in {**guessed, **told}.items()
        if value is not None
    ]
    return "\n".join(
        ["\n[[joint]]", toml_text({"name": joint.name}).rstrip(), *lines, ""]
    )
