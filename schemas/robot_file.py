"""Robot file: the TOML beside a URDF that describes a robot."""

from __future__ import annotations

import re
from typing import Annotated, Literal

import msgspec

from surefoot.schemas.toml_file import FileStruct

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Fraction = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
Side = Literal["left", "right"]
NAME = r"[^\s./\\-][^/\\]{0,99}"
"""Pattern of a robot's name."""


class Imu(FileStruct, frozen=True, kw_only=True):
    """Place of the IMU."""

    frame: str
    """URDF link in whose frame the readings are."""


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
    """Ankles without sensors: wrenches are inferred from joint efforts and dynamics."""

    cutoff_hz: Positive = 50.0
    """Bandwidth of the momentum observer: a higher one is noisier [Hz]."""
    effort_noise_nm: NonNegative = 0.0
    """Standard deviation of a joint's effort reading, added by the simulator [N m]."""


class ServoProfile(FileStruct, frozen=True, kw_only=True):
    """How a servo's set-point follows the position command."""

    velocity_limit_rad_s: Positive
    """Largest speed of the set-point."""
    lag_s: NonNegative
    """Time constant of the first-order lag after the speed limit [s]."""


class Servo(FileStruct, frozen=True, kw_only=True):
    """Servo profiles and the default one."""

    profile: str
    """Profile used when no other is asked for."""
    profiles: dict[str, ServoProfile]
    """Profiles by name."""


class Gate(FileStruct, frozen=True, kw_only=True):
    """Limits of the robot-side command gate."""

    step_limit_rad: Positive
    """Largest change of a joint command in one tick."""
    position_margin_rad: NonNegative = 0.0
    """Margin kept to each end of the joint range."""
    hold_after_s: Positive = 0.02
    """Silence of the commander after which the last posture is held [s]."""
    fault_after_s: Positive = 1.0
    """Silence of the commander after which the robot goes to FAULT [s]."""
    max_command_age_s: Positive | None = None
    """Largest age of the sensors that a command answers; older commands are refused.
    ``hold_after_s`` when absent [s]."""
    max_loop_delay_s: Positive | None = None
    """Largest loop delay, from a reading to the tick in which the servos follow its
    answer, averaged over half a second. Beyond it the robot goes to FAULT; not watched
    when absent. ``surefoot margins`` tells what a robot bears [s]."""
    beyond_limits: Literal["clip", "refuse"] = "clip"
    """Treatment of commands beyond a position, velocity or step limit."""
    warn_only: bool = False
    """For prototypes in simulation: commands beyond a limit are followed and counted.
    Invalid postures and commands without a lease are still refused."""
    first_command_tolerance_rad: Positive = 0.05
    """Largest distance of the first command from the held posture, per joint."""
    lease_s: Positive = 1.0
    """A commander silent for longer loses the lease [s]."""

    def __post_init__(self) -> None:
        """Refuse a fault that would come before the hold."""
        if self.hold_after_s >= self.fault_after_s:
            raise ValueError(
                f"`hold_after_s` is {self.hold_after_s:g}, expected less than "
                f"`fault_after_s`, {self.fault_after_s:g}"
            )


class Joint(FileStruct, frozen=True, kw_only=True):
    """One actuated joint; the URDF has its range."""

    name: str
    """Name of the joint in the URDF."""
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
    """Largest joint velocity that the gate lets pass and the controller asks for."""
    nominal_rad: float
    """Position in the nominal posture."""
    soft_lower_rad: float | None = None
    """Lower end of the range the controller uses, if tighter than the joint range."""
    soft_upper_rad: float | None = None
    """Upper end of the range the controller uses, if tighter than the joint range."""


class RobotFile(FileStruct, frozen=True, kw_only=True):
    """A robot: geometry in the URDF it names, the rest here."""

    name: Annotated[str, msgspec.Meta(extra_json_schema={"pattern": f"^{NAME}$"})]
    """Name shown to people, and part of file names: one line of at most 100
    characters, no slashes, and no dot, hyphen or blank first."""
    urdf: str
    """Path of the URDF, relative to this file."""
    namespace: str
    """Zenoh's namespace: the beginning of every key on the bus."""
    rate_hz: Annotated[float, msgspec.Meta(gt=0.0, le=20_000.0)]
    """Control ticks per second."""
    base_link: str
    """URDF link of the floating base."""
    nominal_base_height_m: float
    """Height of the base origin above the ground in the nominal posture."""
    com_travel_m: tuple[float, float] = (-0.1, 0.03)
    """Range of the CoM's height over the feet, from nominal: lowest and highest."""
    imu: Imu
    """Inertial unit."""
    foot: Annotated[list[Foot], msgspec.Meta(min_length=2, max_length=2)]
    """Left, then right."""
    virtual_ft: VirtualForceTorque | None = None
    """Given if the ankles have no sensors: the ankle channels then carry zeros, and the
    stabilizer infers their wrenches. Efforts must be measured."""
    servo: Servo
    """Servos."""
    gate: Gate
    """Limits of the command gate."""
    joint: Annotated[list[Joint], msgspec.Meta(min_length=1)]
    """Actuated joints, in the order of every array on the bus."""
    keys: dict[str, str] = {}
    """Channel name to key, where the real bus uses another key."""

    def __post_init__(self) -> None:
        """Refuse a name that is not fit for files."""
        if not (re.fullmatch(NAME, self.name) and self.name.isprintable()):
            raise ValueError(
                f"at `name`: got {self.name[:60]!r}, expected one line of at most 100 "
                "characters, no slashes, and no dot, hyphen or blank first; it becomes "
                "part of file names"
            )
