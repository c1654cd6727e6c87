"""Bus messages.

Every message is a MessagePack map with string keys; all fields are required on the
wire, unknown ones are refused. Units are SI and radians. ``F`` is always the wrench
[force; moment] of the ground on the robot at the sole, in the sole frame. The
force-torque messages carry the sensor's reading in the sensor frame, same sign.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, ClassVar

import msgspec

from surefoot.schemas.arrays import Floats, Floats3, Floats4, Floats6, Pair
from surefoot.schemas.reasons import (
    EndReason,
    ModeCause,
    RequestRefusal,
    SensorTrouble,
    StabilizerState,
)

SCHEMA_VERSION = 3
Count = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
"""Range of a signed 64-bit integer, which any language has."""


class Message(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Fields that every sample has."""

    PER_JOINT: ClassVar[tuple[str, ...]] = ()
    """Names of the fields that hold one number per joint."""

    schema: int
    """Version of this format; see SCHEMA_VERSION."""
    tick: Count
    """The robot's control tick this sample belongs to."""
    stamp_ns: Count
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
    """Reading of the IMU in its own frame."""

    quat_xyzw: Floats4
    """The IMU's own attitude estimate (world from IMU); its yaw is arbitrary."""
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
    """State of the robot's command gate and its reason."""

    PER_JOINT: ClassVar[tuple[str, ...]] = ("q_command",)

    mode: RobotMode
    """Mode of the gate."""
    cause: ModeCause
    """Why the gate is in this mode; in FAULT the first fault."""
    detail: str
    """The same in words, for people; may be empty."""
    notice: str
    """Last refusal or clipping, in words; empty before the first."""
    commander: str
    """Who holds the lease; empty when nobody does."""
    command_age_s: float
    """Age of the command in use [s]; -1 before the first."""
    q_command: Floats
    """Posture the servos follow now [rad]."""
    refused: dict[str, Count]
    """Refused commands so far, by reason."""
    clipped: dict[str, Count]
    """Commands clipped to a limit so far, by limit."""
    deadline_misses: Count
    """Ticks that went on without their command."""

    @property
    def is_farewell(self) -> bool:
        """Whether the robot ends: nobody commands it, and nobody asked for OFF."""
        off = self.mode is RobotMode.OFF and self.cause is not ModeCause.REQUESTED
        return not self.commander and (off or self.mode is RobotMode.FAULT)


class JointCommand(Message, frozen=True, kw_only=True):
    """Joint positions to follow; ``tick`` is the tick it answers."""

    PER_JOINT: ClassVar[tuple[str, ...]] = ("q",)

    q: Floats
    """Commanded position [rad]."""
    commander: str
    """Identity that holds the lease."""
    sequence: Count
    """Strictly growing per commander."""


class FootReference(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Pose of a foot in the reference stance."""

    position: Floats3
    """Sole origin in the stance frame [m]."""
    quat_xyzw: Floats4
    """Orientation of the sole in the stance frame."""


class Reference(Message, frozen=True, kw_only=True):
    """What a planner asks of the stabilizer; without one the robot stands.

    Vectors are in the stance frame: origin midway between the soles, x forward,
    z up, yaw of the stance.
    """

    PER_JOINT: ClassVar[tuple[str, ...]] = ("posture",)

    com: Floats3
    """Centre of mass [m]."""
    com_velocity: Floats3
    """Velocity of the centre of mass [m/s]."""
    com_acceleration: Floats3
    """Acceleration of the centre of mass, fed forward [m/s^2]."""
    base_quat_xyzw: Floats4
    """Orientation of the base link, stance from base."""
    posture: Floats
    """Joint posture [rad]."""
    feet: Annotated[list[FootReference], msgspec.Meta(max_length=2)]
    """Left and right foot; empty for the present stance."""

    def __post_init__(self) -> None:
        """Refuse a reference for one foot only."""
        if len(self.feet) == 1:
            raise ValueError("`feet` has 1 entry, expected left and right, or none")


class StabilizerStatus(Message, frozen=True, kw_only=True):
    """What the stabilizer desires and measures, and how it is doing."""

    controller: str
    """Name of the control law."""
    state: StabilizerState
    """State of the stabilizer."""
    end: EndReason
    """Why the stabilizer gives up or ends; ``none`` while it goes on."""
    lost_sensors: dict[str, SensorTrouble]
    """Sensors that are not trusted, by channel, and why."""
    detail: str
    """Why the stabilizer is not active, in words; empty when it is."""
    com: Floats3
    """Estimated centre of mass in the stance frame [m]."""
    com_reference: Floats3
    """Reference of the centre of mass, same frame [m]."""
    F_id_left: Floats6
    """Wrench desired by the first QP at the left sole [N, N m]."""
    F_id_right: Floats6
    """The same at the right sole [N, N m]."""
    F_meas_left: Floats6
    """Measured wrench, compensated to the left sole [N, N m]."""
    F_meas_right: Floats6
    """The same at the right sole [N, N m]."""
    in_contact: Annotated[list[bool], msgspec.Meta(min_length=2, max_length=2)]
    """Contact of left and right foot."""
    qp_status: str
    """Outcome of both QPs in this tick: ``ok``, or which one failed and how."""
    tick_median_ms: float
    """Median compute time of a tick, from snapshot to command [ms]."""
    tick_p99_ms: float
    """99th percentile of that time [ms]."""
    tick_max_ms: float
    """Maximum of that time [ms]."""


class PlatformTruth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """True pose of a moving platform in the simulator."""

    position: Floats3
    """Centre of the platform's top in the world [m]."""
    quat_xyzw: Floats4
    """World from platform."""


class GroundBlock(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A block of ground whose top the robot may stand on."""

    position: Floats3
    """Middle of its top, from the world or from the platform's top centre [m]."""
    quat_xyzw: Floats4
    """Orientation of the block, from the world or from its platform."""
    size: Floats3
    """Length, width and thickness along its own axes [m]."""
    platform: int
    """Number of the platform that carries the block, in the order of the scenario file,
    seesaws last; -1 for a fixed block."""


class Truth(Message, frozen=True, kw_only=True):
    """The simulator's true state: for plots and tests, never for control."""

    base_position: Floats3
    """Base link in the world [m]."""
    base_quat_xyzw: Floats4
    """World from base."""
    com: Floats3
    """Centre of mass in the world [m]."""
    com_velocity: Floats3
    """Velocity of the centre of mass, world axes [m/s]."""
    sole_left: Floats3
    """Origin of the left sole in the world [m]."""
    sole_right: Floats3
    """The same of the right sole [m]."""
    F_left: Floats6
    """Contact wrench at the left sole, in the sole frame [N, N m]."""
    F_right: Floats6
    """The same at the right sole [N, N m]."""
    normal_force: Pair
    """Normal force of left and right sole [N]."""
    platforms: list[PlatformTruth]
    """Moving platforms, in the order of the scenario file."""
    ground: list[GroundBlock]
    """All blocks of ground: of platforms, tiles and floor."""


class ModeRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Request on srv/mode: enable, hold, disable or reset."""

    schema: int
    """Version of this format."""
    action: str
    """``enable``, ``hold``, ``disable`` or ``reset``."""
    commander: str
    """Identity of who asks."""


class LeaseRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Request on srv/lease: take or release command."""

    schema: int
    """Version of this format."""
    action: str
    """``take`` or ``release``."""
    commander: str
    """Identity of who asks."""
    robot: str
    """Instance of the addressed robot, from its liveliness token."""
    description: str
    """Digest of the robot description that the commander uses."""


class EstopRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Request on srv/estop: stop now; anyone may send it."""

    schema: int
    """Version of this format."""
    source: str
    """Who stops the robot, for the log."""


class ServiceReply(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Answer of every service."""

    PER_JOINT: ClassVar[tuple[str, ...]] = ("q_command",)

    schema: int
    """Version of this format."""
    accepted: bool
    """Whether the request was done."""
    refusal: RequestRefusal
    """Why not; ``none`` when accepted."""
    detail: str
    """The same in words, for people; may be empty when accepted."""
    mode: RobotMode
    """Mode of the gate after the request."""
    commander: str
    """Who holds the lease now; empty when nobody does."""
    q_command: Floats
    """Posture the servos follow, from which a new commander starts [rad]."""
    instance: str
    """Instance of the robot's process, as in its liveliness token; one per start."""
    description: str
    """Digest of the robot's description, as in its liveliness token."""
    pace: str
    """``lockstep``: the robot waits for the answer to each tick; ``realtime``: it keeps
    its own clock."""


class SettingsRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Request on srv/settings of the stabilizer: change gains during the run."""

    schema: int
    """Version of this format."""
    source: str
    """Who asks, for the log."""
    changes: dict[str, Floats]
    """Setting to new value, such as ``tsid.com_kp``: one number for all axes, or one
    per axis. Empty: only return the present values."""


class ControlRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Request on srv/control of the stabilizer: hold or resume."""

    schema: int
    """Version of this format."""
    source: str
    """Who asks, for the log."""
    action: str
    """``hold``: keep the posture; ``resume``: balance again."""


class StabilizerReply(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Answer of the stabilizer's services."""

    schema: int
    """Version of this format."""
    accepted: bool
    """Whether the request is done."""
    refusal: RequestRefusal
    """Why not; ``none`` when accepted."""
    detail: str
    """The same in words, for people; may be empty when accepted."""
    tick: Count
    """The robot's tick at which the answer takes effect."""
    settings: dict[str, Floats]
    """Settings that can be changed during the run, with their values; while a ramp is
    under way, the values at its end."""


class SettingsChange(Message, frozen=True, kw_only=True):
    """Sent by the stabilizer when a change of settings begins to act at ``tick``."""

    source: str
    """Who asked for the change."""
    before: dict[str, Floats]
    """Values of the changed settings before, one number per axis."""
    after: dict[str, Floats]
    """Values at the end of the ramp."""
    ramp_s: float
    """Duration of the linear ramp from ``before`` to ``after`` [s]."""


class PushRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Request on srv/push of a simulated robot: a force on a link for a while."""

    schema: int
    """Version of this format."""
    source: str
    """Who pushes, for the log."""
    body: str
    """Link of the URDF."""
    force_n: Floats3
    """Force at the link's centre of mass, world axes [N]."""
    duration_s: float
    """How long it acts [s]."""


class PushEvent(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A push that was requested during a run."""

    tick: Count
    """First control tick in which the push acts."""
    source: str
    """Who pushed."""
    body: str
    """Link of the URDF."""
    force_n: Floats3
    """Force, world axes [N]."""
    duration_s: float
    """How long it acts."""
