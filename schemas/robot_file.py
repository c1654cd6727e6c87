"""Robot file: what a TOML beside a URDF says about a robot."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from surefoot.schemas.toml_file import FileStruct

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Fraction = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
Side = Literal["left", "right"]


class Imu(FileStruct, frozen=True, kw_only=True):
    """Where the IMU sits."""

    frame: str
    """URDF link whose frame the readings are in."""


class Foot(FileStruct, frozen=True, kw_only=True):
    """One foot: its sole rectangle and its force-torque sensor."""

    side: Side
    """Left or right."""
    sole_frame: str
    """URDF link in the middle of the contact rectangle, z out of the ground."""
    ft_link: str
    """URDF link below the sensor; the sensor frame is this link's frame."""
    half_length_m: Positive
    """Half of the sole along x."""
    half_width_m: Positive
    """Half of the sole along y."""


class VirtualForceTorque(FileStruct, frozen=True, kw_only=True):
    """Ankles without sensors: their wrenches follow from joint efforts and dynamics."""

    cutoff_hz: Positive = 50.0
    """Of the momentum observer: faster is noisier [Hz]."""
    effort_noise_nm: NonNegative = 0.0
    """Deviation of one reading of a joint's effort, which the simulator adds [N m]."""


class ServoProfile(FileStruct, frozen=True, kw_only=True):
    """How a servo's set-point follows the position command."""

    velocity_limit_rad_s: Positive
    """Fastest the set-point moves."""
    lag_s: NonNegative
    """Time constant of the first-order lag behind the limit [s]."""


class Servo(FileStruct, frozen=True, kw_only=True):
    """Servo profiles and which one is used."""

    profile: str
    """The one used when no other is asked for."""
    profiles: dict[str, ServoProfile]
    """By name."""


class Gate(FileStruct, frozen=True, kw_only=True):
    """Limits of the robot-side command gate."""

    step_limit_rad: Positive
    """Farthest a command may move a joint in one tick."""
    position_margin_rad: NonNegative = 0.0
    """Kept free before each end of the joint range."""
    hold_after_s: Positive = 0.02
    """Silence of the commander after which the last posture is held [s]."""
    fault_after_s: Positive = 1.0
    """Silence after which the robot goes to fault [s]."""
    max_command_age_s: Positive | None = None
    """A command that answers older sensors is refused [s]; ``hold_after_s`` when
    absent."""
    max_loop_delay_s: Positive | None = None
    """Delay of the loop, from a reading to the tick in which the servos follow its
    answer, beyond which the robot goes to fault when it is that on average over half a
    second; ``surefoot margins`` tells what is borne [s]; not watched when absent."""
    beyond_limits: Literal["clip", "refuse"] = "clip"
    """What becomes of a command beyond a position, velocity or step limit."""
    warn_only: bool = False
    """For prototypes in simulation: commands beyond a limit are followed, and
    counted; what is no posture at all, or nobody's, is refused still."""
    first_command_tolerance_rad: Positive = 0.05
    """How far from the held posture the first command may be, per joint."""
    lease_s: Positive = 1.0
    """A commander silent for longer loses the lease [s]."""

    def __post_init__(self) -> None:
        """Refuse a fault before the hold that leads to it."""
        if self.hold_after_s >= self.fault_after_s:
            raise ValueError(
                f"`hold_after_s` is {self.hold_after_s:g}, expected less than "
                f"`fault_after_s`, {self.fault_after_s:g}"
            )


class Joint(FileStruct, frozen=True, kw_only=True):
    """One actuated joint; its range stands in the URDF."""

    name: str
    """Joint of the URDF."""
    kp_nm_rad: Positive
    """Stiffness of the servo."""
    kd_nm_s_rad: NonNegative
    """Damping of the servo."""
    armature_kg_m2: NonNegative
    """Rotor inertia seen at the joint."""
    damping_nm_s_rad: NonNegative
    """Passive damping of the servo."""
    torque_limit_nm: Positive
    """Largest torque; the same as in the URDF."""
    velocity_limit_rad_s: Positive
    """Fastest command the gate lets pass and the controller asks for."""
    nominal_rad: float
    """Nominal posture."""
    soft_lower_rad: float | None = None
    """Lower end of what the controller uses, where tighter than the joint range."""
    soft_upper_rad: float | None = None
    """Upper end of what the controller uses, where tighter than the joint range."""


class RobotFile(FileStruct, frozen=True, kw_only=True):
    """A robot: geometry in the URDF it names, the rest here."""

    name: str
    """Shown to people."""
    urdf: str
    """Path of the URDF, relative to this file."""
    namespace: str
    """Zenoh's namespace: what every key on the bus begins with."""
    rate_hz: Annotated[float, msgspec.Meta(gt=0.0, le=20_000.0)]
    """Control ticks in a second."""
    base_link: str
    """URDF link that floats."""
    nominal_base_height_m: float
    """Base origin above the ground in the nominal posture."""
    com_travel_m: tuple[float, float] = (-0.1, 0.03)
    """How far the centre of mass may sink and rise over its feet, from nominal."""
    imu: Imu
    """Inertial unit."""
    foot: Annotated[list[Foot], msgspec.Meta(min_length=2, max_length=2)]
    """Left, then right."""
    virtual_ft: VirtualForceTorque | None = None
    """Given where the ankles have no sensors: the ankle channels then carry zeros, and
    the stabilizer puts what it infers in their place. Efforts must be measured."""
    servo: Servo
    """Servos."""
    gate: Gate
    """Limits of the command gate."""
    joint: Annotated[list[Joint], msgspec.Meta(min_length=1)]
    """Their order is the order of every array on the bus."""
    keys: dict[str, str] = {}
    """Channel name to key, where the real bus calls it otherwise."""
