"""Bus messages.

Every message is a MessagePack map with string keys; all fields are required on
the wire, unknown ones are refused. SI units and radians. ``F`` is always the
wrench [force; moment] of the ground on the robot at the sole, in the sole frame;
the force-torque messages carry what the sensor reports, in the sensor's frame,
with the same sign (ground on robot).
"""

from __future__ import annotations

from enum import StrEnum
from typing import ClassVar

import msgspec

from schemas.arrays import Floats, Floats3, Floats4, Floats6, Pair

SCHEMA_VERSION = 1


class Message(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What every sample carries."""

    PER_JOINT: ClassVar[tuple[str, ...]] = ()
    """Names of the fields that hold one number per joint."""

    schema: int
    """Version of this format; see SCHEMA_VERSION."""
    tick: int
    """The robot's control tick this sample belongs to."""
    stamp_ns: int
    """Monotonic clock of the sender when the sample was taken [ns]."""


class JointState(Message, frozen=True, kw_only=True):
    """Measured joints, in the order of the robot file."""

    PER_JOINT: ClassVar[tuple[str, ...]] = ("q", "dq", "effort")

    q: Floats
    """Position [rad]."""
    dq: Floats
    """Velocity [rad/s]."""
    effort: Floats
    """Servo torque [N m]."""


class ImuState(Message, frozen=True, kw_only=True):
    """Inertial unit in its own frame."""

    quat_xyzw: Floats4
    """The unit's own attitude estimate (world from IMU), yaw free."""
    angular_velocity: Floats3
    """Gyroscope [rad/s]."""
    linear_acceleration: Floats3
    """Accelerometer, specific force: +g upwards at rest [m/s^2]."""


class ForceTorque(Message, frozen=True, kw_only=True):
    """Six-axis sensor between ankle and foot plate, in the sensor frame."""

    force: Floats3
    """Force from below on the ankle [N]: + z when standing."""
    moment: Floats3
    """Moment about the sensor origin [N m]."""


class RobotMode(StrEnum):
    """Modes of the robot's command gate."""

    OFF = "off"
    HOLD = "hold"
    ACTIVE = "active"
    FAULT = "fault"


class RobotStatus(Message, frozen=True, kw_only=True):
    """What the robot's gate does and why."""

    PER_JOINT: ClassVar[tuple[str, ...]] = ("q_command",)

    mode: RobotMode
    fault: str
    """Why the robot is in FAULT; empty otherwise."""
    reason: str
    """Why the last command or request was refused or changed; may be empty."""
    commander: str
    """Who holds the lease; empty when nobody does."""
    command_age_s: float
    """Age of the command in use [s]; -1 before the first."""
    q_command: Floats
    """Posture the servos follow now [rad]."""
    refused: dict[str, int]
    """Refused commands so far, by reason."""
    clipped: dict[str, int]
    """Commands clipped to a limit so far, by limit."""
    deadline_misses: int
    """Ticks that went on without their command."""


class JointCommand(Message, frozen=True, kw_only=True):
    """Joint positions to follow; ``tick`` is the tick it answers."""

    PER_JOINT: ClassVar[tuple[str, ...]] = ("q",)

    q: Floats
    """Commanded position [rad]."""
    commander: str
    """Identity that holds the lease."""
    sequence: int
    """Strictly growing per commander."""


class FootReference(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where a foot belongs relative to the base in the reference stance."""

    position: Floats3
    """Sole origin in the reference frame between the feet [m]."""
    quat_xyzw: Floats4


class Reference(Message, frozen=True, kw_only=True):
    """What a planner asks of the stabilizer; standing when it says nothing.

    Vectors are in the stance frame: origin midway between the soles, x forward,
    z up, yaw of the stance.
    """

    PER_JOINT: ClassVar[tuple[str, ...]] = ("posture",)

    com: Floats3
    """Centre of mass [m]."""
    com_velocity: Floats3
    com_acceleration: Floats3
    base_quat_xyzw: Floats4
    posture: Floats
    """Joint posture [rad]."""
    feet: list[FootReference]
    """Left and right foot; empty for the present stance."""


class StabilizerStatus(Message, frozen=True, kw_only=True):
    """What the stabilizer wants, measures and how it fares."""

    controller: str
    state: str
    """One word: waiting, active, degraded, hold."""
    reason: str
    com: Floats3
    """Estimated centre of mass in the stance frame [m]."""
    com_reference: Floats3
    F_id_left: Floats6
    F_id_right: Floats6
    F_meas_left: Floats6
    F_meas_right: Floats6
    in_contact: list[bool]
    """Left, right."""
    qp_status: str
    """Outcome of the two QPs of this tick: ``ok`` or which failed and how."""
    tick_median_ms: float
    tick_p99_ms: float
    tick_max_ms: float


class PlatformTruth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A moving platform as the simulator has it."""

    position: Floats3
    """Top centre in the world [m]."""
    quat_xyzw: Floats4


class Truth(Message, frozen=True, kw_only=True):
    """Simulator only: for plots and tests, never for control."""

    base_position: Floats3
    base_quat_xyzw: Floats4
    com: Floats3
    com_velocity: Floats3
    sole_left: Floats3
    sole_right: Floats3
    F_left: Floats6
    """Contact wrench at the left sole, in the sole frame [N, N m]."""
    F_right: Floats6
    normal_force: Pair
    platforms: list[PlatformTruth]


class ModeRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Asked on srv/mode: enable, hold, disable or reset."""

    schema: int
    action: str
    commander: str


class LeaseRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Asked on srv/lease: take or release command."""

    schema: int
    action: str
    commander: str


class EstopRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Asked on srv/estop by anyone: stop now."""

    schema: int
    source: str


class ServiceReply(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Answer of every service."""

    schema: int
    accepted: bool
    reason: str
    mode: RobotMode
    commander: str
    q_command: Floats
    """Posture the servos follow: what a new commander starts from [rad]."""
