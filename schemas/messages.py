"""Bus messages.

Every message is a MessagePack map with string keys; all fields are required on
the wire, unknown ones are refused. SI units and radians. ``F`` is always the
wrench [force; moment] of the ground on the robot at the sole, in the sole frame;
the force-torque messages carry what the sensor reports, in the sensor's frame,
with the same sign (ground on robot).
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
"""What a signed 64-bit integer holds, in any language."""


class Message(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What every sample carries."""

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
    """Mode of the gate."""
    cause: ModeCause
    """Why it is in this mode; in FAULT the first fault."""
    detail: str
    """The same in words, for people; may be empty."""
    notice: str
    """What was last refused or cut to a limit, in words; empty before anything was."""
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
    """Where a foot belongs relative to the base in the reference stance."""

    position: Floats3
    """Sole origin in the reference frame between the feet [m]."""
    quat_xyzw: Floats4
    """Orientation of the sole there."""


class Reference(Message, frozen=True, kw_only=True):
    """What a planner asks of the stabilizer; standing when it says nothing.

    Vectors are in the stance frame: origin midway between the soles, x forward,
    z up, yaw of the stance.
    """

    PER_JOINT: ClassVar[tuple[str, ...]] = ("posture",)

    com: Floats3
    """Centre of mass [m]."""
    com_velocity: Floats3
    """Its velocity [m/s]."""
    com_acceleration: Floats3
    """Its acceleration, fed forward [m/s^2]."""
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
    """What the stabilizer wants, measures and how it fares."""

    controller: str
    """Name of the control law."""
    state: StabilizerState
    """What it is doing."""
    end: EndReason
    """Why it gives up or ends; ``none`` while it goes on."""
    lost_sensors: dict[str, SensorTrouble]
    """Sensors that are not believed, by channel, and why."""
    detail: str
    """Why it is not active, in words for people; empty when it is."""
    com: Floats3
    """Estimated centre of mass in the stance frame [m]."""
    com_reference: Floats3
    """Where it should be, same frame [m]."""
    F_id_left: Floats6
    """Wrench the first QP wants at the left sole [N, N m]."""
    F_id_right: Floats6
    """The same at the right sole [N, N m]."""
    F_meas_left: Floats6
    """Measured wrench, compensated to the left sole [N, N m]."""
    F_meas_right: Floats6
    """The same at the right sole [N, N m]."""
    in_contact: Annotated[list[bool], msgspec.Meta(min_length=2, max_length=2)]
    """Left, right."""
    qp_status: str
    """Outcome of the two QPs of this tick: ``ok`` or which failed and how."""
    tick_median_ms: float
    """Compute time of a tick, snapshot to command [ms]."""
    tick_p99_ms: float
    """Its 99th percentile [ms]."""
    tick_max_ms: float
    """Its maximum [ms]."""


class PlatformTruth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A moving platform as the simulator has it."""

    position: Floats3
    """Top centre in the world [m]."""
    quat_xyzw: Floats4
    """World from platform."""


class GroundBlock(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A block whose top the robot may stand on."""

    position: Floats3
    """Middle of its top: in the world, or from the top centre of its platform [m]."""
    quat_xyzw: Floats4
    """Of the block: from the world, or from its platform."""
    size: Floats3
    """Length, width and thickness along its own axes [m]."""
    platform: int
    """Which platform it is, in the order of the scenario file, seesaws after them; -1:
    it stands fast."""


class Truth(Message, frozen=True, kw_only=True):
    """Simulator only: for plots and tests, never for control."""

    base_position: Floats3
    """Base link in the world [m]."""
    base_quat_xyzw: Floats4
    """World from base."""
    com: Floats3
    """Centre of mass in the world [m]."""
    com_velocity: Floats3
    """Its velocity, world axes [m/s]."""
    sole_left: Floats3
    """Origin of the left sole in the world [m]."""
    sole_right: Floats3
    """The same of the right sole [m]."""
    F_left: Floats6
    """Contact wrench at the left sole, in the sole frame [N, N m]."""
    F_right: Floats6
    """The same at the right sole [N, N m]."""
    normal_force: Pair
    """Along the soles' normals, left and right [N]."""
    platforms: list[PlatformTruth]
    """In the order of the scenario file."""
    ground: list[GroundBlock]
    """All ground there is: of platforms, tiles and floor."""


class ModeRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Asked on srv/mode: enable, hold, disable or reset."""

    schema: int
    """Version of this format."""
    action: str
    """``enable``, ``hold``, ``disable`` or ``reset``."""
    commander: str
    """Identity of who asks."""


class LeaseRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Asked on srv/lease: take or release command."""

    schema: int
    """Version of this format."""
    action: str
    """``take`` or ``release``."""
    commander: str
    """Identity of who asks."""
    robot: str
    """Instance of the robot that is meant, from its liveliness token."""
    description: str
    """Digest of the robot description that the commander goes by."""


class EstopRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Asked on srv/estop by anyone: stop now."""

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
    """Whether it was done."""
    refusal: RequestRefusal
    """Why not; ``none`` when accepted."""
    detail: str
    """The same in words, for people; may be empty when accepted."""
    mode: RobotMode
    """Mode of the gate after it."""
    commander: str
    """Who holds the lease now; empty when nobody does."""
    q_command: Floats
    """Posture the servos follow: what a new commander starts from [rad]."""
    instance: str
    """Of the robot's process, as in its liveliness token; another at every start."""
    description: str
    """Digest of the robot's description, as in its liveliness token."""
    pace: str
    """``lockstep``: the robot waits for the answer to each tick; ``realtime``: it goes
    by the clock."""


class SettingsRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Asked on srv/settings of the stabilizer: change gains while it runs."""

    schema: int
    """Version of this format."""
    source: str
    """Who asks, for the log."""
    changes: dict[str, Floats]
    """Setting to new value, such as ``tsid.com_kp``: one number for all axes, or one
    per axis. Empty to ask only for the present values."""


class ControlRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Asked on srv/control of the stabilizer, which commands the robot."""

    schema: int
    """Version of this format."""
    source: str
    """Who asks, for the log."""
    action: str
    """``hold``: the robot keeps its posture; ``resume``: balance again."""


class StabilizerReply(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Answer of the stabilizer's services."""

    schema: int
    """Version of this format."""
    accepted: bool
    """Whether it is done."""
    refusal: RequestRefusal
    """Why not; ``none`` when accepted."""
    detail: str
    """The same in words, for people; may be empty when accepted."""
    tick: Count
    """The robot's tick from which on it counts."""
    settings: dict[str, Floats]
    """Settings that can be changed while it runs, and their values; those of the
    end of the ramp while one is under way."""


class SettingsChange(Message, frozen=True, kw_only=True):
    """Told by the stabilizer when a change of settings begins to act at ``tick``."""

    source: str
    """Who asked for it."""
    before: dict[str, Floats]
    """Values of the settings concerned, one number per axis."""
    after: dict[str, Floats]
    """Values at the end of the ramp."""
    ramp_s: float
    """Time from the one to the other, linearly [s]."""


class PushRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Asked on srv/push of a simulated robot: a force on a link for a while."""

    schema: int
    """Version of this format."""
    source: str
    """Who pushes, for the log."""
    body: str
    """Link of the URDF."""
    force_n: Floats3
    """Force at its centre of mass, world axes [N]."""
    duration_s: float
    """How long it acts [s]."""


class PushEvent(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A push somebody asked for during a run."""

    tick: Count
    """First control tick in which it acts."""
    source: str
    """Who pushed."""
    body: str
    """Link of the URDF."""
    force_n: Floats3
    """World axes [N]."""
    duration_s: float
    """How long it acts."""
