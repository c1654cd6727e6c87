"""What a scenario says of the robot itself, and of rods that touch it."""

from __future__ import annotations

from typing import Annotated

import msgspec

from surefoot.schemas.arrays import Floats3, Pair
from surefoot.schemas.robot_file import NonNegative, Positive
from surefoot.schemas.toml_file import FileStruct

PerJoint = NonNegative | dict[str, NonNegative]
"""One number for all joints, or by joint."""


class Start(FileStruct, frozen=True, kw_only=True):
    """How the robot stands at tick 0."""

    yaw_deg: float = 0.0
    """Where it looks, from x to the left. Platforms under single feet turn along; their
    motions stay along the world's axes."""
    position_m: Pair = msgspec.field(default_factory=lambda: [0.0, 0.0])
    """Where its base is, x and y in the world. Platforms are under the feet wherever
    that is; tiles stay."""
    posture: dict[str, float] = {}
    """Joint positions [rad]; those not named are nominal. Its soles must be level."""
    settle_s: Annotated[float, msgspec.Meta(ge=0.0, le=60.0)] = 2.0
    """How long it holds the posture on still ground before tick 0."""


class Payload(FileStruct, frozen=True, kw_only=True):
    """A mass on a link that the controller does not know of."""

    link: str
    """Link of the URDF."""
    mass_kg: Positive
    """A ball of twice the density of water."""
    offset_m: Floats3 = msgspec.field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Its middle, in the link's frame."""
    start_s: NonNegative = 0.0
    """When it is grasped; carried from before the start when 0."""


class ModelError(FileStruct, frozen=True, kw_only=True):
    """What the robot is, against what the controller believes."""

    mass_scale: Positive = 1.0
    """The robot's true mass over the believed one."""
    servo_kp_scale: Positive = 1.0
    """The servos' true stiffness over the believed one."""
    servo_lag_scale: Positive = 1.0
    """The servos' true lag over that of their profile."""
    com_offset_m: Floats3 = msgspec.field(default_factory=lambda: [0.0, 0.0, 0.0])
    """True centre of mass of the whole robot less the believed one: ahead, left and up.
    The base link's mass is shifted for it."""
    backlash_rad: PerJoint = 0.0
    """Play between servo and joint, from end to end: no torque passes within it. One
    number for all joints, or by joint. Encoders sit on the joint's side."""
    joint_friction_nm: PerJoint = 0.0
    """Dry friction: of all joints, or by joint."""
    gravity_m_s2: Annotated[float, msgspec.Meta(ge=1.0, le=30.0)] = 9.81
    """Of the place; the controller believes in 9.81."""


class _Rod(FileStruct, frozen=True, kw_only=True):
    """What all rods share: they touch a link at its centre of mass."""

    body: str
    """Link of the URDF."""
    direction_deg: float = 0.0
    """In the ground's plane, the world's axes: 0 along x, 90 along y."""
    start_s: NonNegative = 0.0
    """When it begins."""


class _DrivenRod(_Rod, frozen=True, kw_only=True):
    """A rod that follows a course."""

    frequency_hz: Positive | None = None
    """Of a sine that fades in over its first period."""
    rise_s: Positive | None = None
    """Instead of a sine: how long it takes to go there, once, and stay."""

    def __post_init__(self) -> None:
        """Check that there is one course."""
        if (self.frequency_hz is None) == (self.rise_s is None):
            raise ValueError("needs either `frequency_hz` or `rise_s`, not both")


class ForceRod(_DrivenRod, frozen=True, kw_only=True, tag="force", tag_field="kind"):
    """Pushes and pulls with a given force, wherever the link goes."""

    amplitude_n: Positive
    """Of the force."""


class DisplacementRod(
    _DrivenRod, frozen=True, kw_only=True, tag="displacement", tag_field="kind"
):
    """Leads the link along a given way, by a stiff spring and a damper."""

    amplitude_m: Positive
    """From where the link was when it began."""
    stiffness_n_m: Positive = 1e5
    """Between rod and link."""
    damping_n_s_m: NonNegative = 1.5e3
    """Between rod and link."""


class StrikeRod(_Rod, frozen=True, kw_only=True, tag="strike", tag_field="kind"):
    """A free mass that meets the link once, with a pad between, as a pendulum does."""

    mass_kg: Positive
    """Of the striker."""
    speed_m_s: Positive
    """With which it arrives."""
    stiffness_n_m: Positive = 2e4
    """Of the pad."""


Rod = ForceRod | DisplacementRod | StrikeRod
