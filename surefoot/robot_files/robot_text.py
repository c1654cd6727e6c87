"""The text of a new robot file, with a word on every number that was guessed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from surefoot.robot_files.servos import Drive
from surefoot.schemas.robot_file import Foot
from surefoot.schemas.toml_file import toml_text
from surefoot.stabilizer.stance.nominal import NominalPosture

GUESSED = "  # guessed"


class JointLines(NamedTuple):
    """What the robot file says of a joint.

    Attributes:
        name: in the URDF.
        drive: guessed.
        damping: guessed [N m s/rad].
        torque: limit [N m].
        torque_is_told: by the URDF.
        velocity: limit [rad/s].
        velocity_is_told: by the URDF.
        nominal: [rad].
        soft_lower: lower end of what is used, where tighter than the range [rad].
        soft_upper: upper end.
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
    """Return the TOML.

    Args:
        name: of the robot, its URDF and its namespace.
        source: name of the URDF it was made from.
        rate_hz: of its control loop.
        base_link: that floats.
        base_height_m: above the soles in the nominal posture.
        imu: link of the inertial unit.
        feet: left, then right.
        nominal: posture and travel.
        joints: in the order of the bus.
    """
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
            "# a number marked as guessed is to be replaced by a measured one.\n",
            head,
            soles,
            _SERVO,
            _GATE.format(step=round(20.0 / rate_hz, 5)),
            *map(_joint_text, joints),
        )
    )


_SERVO = """
# How a servo's set-point follows a command: its fastest motion and its lag.
[servo]
profile = "ideal"

[servo.profiles.ideal]
velocity_limit_rad_s = 12.0  # guessed
lag_s = 0.0  # guessed; the time by which a slow sine of the joint comes late

# The same of slow drives, as behind harmonic gears: --servo-profile harmonic.
[servo.profiles.harmonic]
velocity_limit_rad_s = 3.1  # guessed
lag_s = 0.02  # guessed

# What the robot refuses, whoever asks.
"""

_GATE = """[gate]
step_limit_rad = {step}
hold_after_s = 0.02
fault_after_s = 1.0

# Their order is the order of every array on the bus. kp, kd, damping: the servo's law,
# as its maker or a step response tells. armature: the rotor's inertia times the gear
# ratio squared.
"""


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
