"""Guesses drives: the Walker's, scaled to a robot of other mass and height."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surefoot.schemas.arrays import Vec3

WALKER_MASS_KG = 70.0
WALKER_COM_HEIGHT_M = 0.83
FASTEST_RAD_S, USUAL_RAD_S = 50.0, 6.0
"""A joint speed above the first is no limit; the second stands for it."""
STRONGEST = 2.0
"""A torque of more than this many times mass x gravity x height is no limit."""
GRAVITY_M_S2 = 9.81


class Drive(NamedTuple):
    """A servo.

    Attributes:
        kp: [N m/rad].
        kd: [N m s/rad].
        armature: rotor inertia at the joint [kg m^2].
        torque: [N m].
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
_DAMPING = 1.0
_UPRIGHT_AXIS = 0.7
_CARRIES = ((0.2, _STRONG), (0.035, _SHOULDER), (0.015, _ARM), (0.0, _LIGHT))
"""Joints above the legs: by the part of the robot's mass that hangs on them."""


class Scale:
    """How drives grow from the Walker to a robot.

    With mass M and height h of the CoM, at the same gravity: what holds it against
    tipping grows with M h; its motions slow down with sqrt(h), so damping grows with
    M h^1.5 and inertia with M h^2.
    """

    def __init__(self, mass_kg: float, com_height_m: float) -> None:
        """Compare with the Walker.

        Args:
            mass_kg: of the robot.
            com_height_m: above its soles.
        """
        self.tipping_nm = mass_kg * GRAVITY_M_S2 * com_height_m
        mass, height = mass_kg / WALKER_MASS_KG, com_height_m / WALKER_COM_HEIGHT_M
        self._stiff = mass * height
        self._damped = mass * height**1.5
        self._heavy = mass * height**2

    def drive(self, like: Drive) -> Drive:
        """One of the Walker's drives for this robot."""
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
        """Whether a URDF's effort is a limit and no placeholder [N m]."""
        return 0.0 < effort <= STRONGEST * self.tipping_nm


def leg_drive(*, place: int, knee: int, axis: Vec3, up: Vec3) -> Drive:
    """The Walker's drive of a leg joint.

    Args:
        place: of the joint in its leg, 0 at the base.
        knee: place of the knee.
        axis: (3,) in the base link, all joints at zero, of length one.
        up: (3,) in the base link.
    """
    is_yaw = place < knee and abs(float(axis @ up)) > _UPRIGHT_AXIS
    return _FIRM if is_yaw or place > knee else _STRONG


def upper_drive(carried_share: float) -> Drive:
    """The Walker's drive of a joint above the legs that carries this much."""
    return next(drive for least, drive in _CARRIES if carried_share >= least)


def velocity_limit(told: float) -> tuple[float, bool]:
    """A joint's speed limit [rad/s], and whether the URDF tells it."""
    is_told = 0.0 < told <= FASTEST_RAD_S
    return (told if is_told else USUAL_RAD_S), is_told


def _round(value: float) -> float:
    """Three digits: a guess deserves no more."""
    return float(np.format_float_positional(value, 3, fractional=False))
