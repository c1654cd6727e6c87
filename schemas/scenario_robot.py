"""Scenario settings of the robot itself, its sensors, and rods that touch it."""

from __future__ import annotations

from typing import Annotated

import msgspec

from surefoot.schemas.arrays import Floats3, Pair
from surefoot.schemas.robot_file import NonNegative, Positive, Side
from surefoot.schemas.toml_file import FileStruct

DelayMs = Annotated[float, msgspec.Meta(ge=0.0, le=1000.0)]
Scale = Annotated[float, msgspec.Meta(ge=0.01, le=10.0)]
"""One quantity over another, such as reading over truth."""
Play = Annotated[float, msgspec.Meta(ge=0.0, le=0.5)]
EncoderStep = Annotated[float, msgspec.Meta(ge=0.0, le=0.1)]
EncoderOffset = Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]
Friction = Annotated[float, msgspec.Meta(ge=0.0, le=1000.0)]


class Start(FileStruct, frozen=True, kw_only=True):
    """How the robot stands at tick 0."""

    yaw_deg: float = 0.0
    """Heading, from x to the left. Platforms under single feet turn with it; their
    motions stay along the world's axes."""
    position_m: Pair = msgspec.field(default_factory=lambda: [0.0, 0.0])
    """Place of the base, x and y in the world. Platforms move with it, under the feet;
    tiles stay."""
    posture: dict[str, float] = {}
    """Joint positions, nominal unless named here; the soles must be level [rad]."""
    settle_s: Annotated[float, msgspec.Meta(ge=0.0, le=60.0)] = 2.0
    """Time for which the posture is held on still ground before tick 0."""


Near3 = Annotated[
    list[Annotated[float, msgspec.Meta(ge=-3.0, le=3.0)]],
    msgspec.Meta(min_length=3, max_length=3),
]


class Payload(FileStruct, frozen=True, kw_only=True):
    """A mass on a link, unknown to the controller."""

    link: str
    """Link of the URDF."""
    mass_kg: Positive
    """Mass, as a ball of twice the density of water."""
    offset_m: Near3 = msgspec.field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Middle of the ball in the link's frame, up to 3 m off along each axis."""
    start_s: NonNegative = 0.0
    """Time at which it is grasped; 0: carried from before the start."""


class ModelError(FileStruct, frozen=True, kw_only=True):
    """Differences between the robot and the controller's model of it."""

    mass_scale: Scale = 1.0
    """True mass of the robot over the modelled one."""
    servo_kp_scale: Scale = 1.0
    """True stiffness of the servos over the modelled one."""
    servo_lag_scale: Scale = 1.0
    """True lag of the servos over that of their profile."""
    com_offset_m: Near3 = msgspec.field(default_factory=lambda: [0.0, 0.0, 0.0])
    """True CoM of the whole robot minus the modelled one: ahead, left and up. The mass
    of the base link is shifted to get it."""
    backlash_rad: Play | dict[str, Play] = 0.0
    """Play between servo and joint, end to end, within which no torque passes: one
    number for all joints, or by joint. Encoders sit on the joint's side."""
    joint_friction_nm: Friction | dict[str, Friction] = 0.0
    """Dry friction: one number for all joints, or by joint."""
    gravity_m_s2: Annotated[float, msgspec.Meta(ge=1.0, le=30.0)] = 9.81
    """True gravity; the controller assumes 9.81."""


class _Rod(FileStruct, frozen=True, kw_only=True):
    """Fields of all rods; a rod touches a link at its centre of mass."""

    body: str
    """Link of the URDF."""
    direction_deg: float = 0.0
    """Horizontal direction in world axes: 0 along x, 90 along y."""
    start_s: NonNegative = 0.0
    """When it begins."""


class _DrivenRod(_Rod, frozen=True, kw_only=True):
    """A rod that follows a course."""

    frequency_hz: Positive | None = None
    """Frequency of a sine that fades in over its first period."""
    rise_s: Positive | None = None
    """Instead of a sine: time in which the rod moves to its end, where it stays."""

    def __post_init__(self) -> None:
        """Check that exactly one course is given."""
        if (self.frequency_hz is None) == (self.rise_s is None):
            raise ValueError("needs either `frequency_hz` or `rise_s`, not both")


class ForceRod(_DrivenRod, frozen=True, kw_only=True, tag="force", tag_field="kind"):
    """Pushes and pulls with a given force, wherever the link goes."""

    amplitude_n: Positive
    """Amplitude of the force."""


class DisplacementRod(
    _DrivenRod, frozen=True, kw_only=True, tag="displacement", tag_field="kind"
):
    """Leads the link along a given course, by a stiff spring and a damper."""

    amplitude_m: Positive
    """Amplitude, from the link's place when the rod begins."""
    stiffness_n_m: Positive = 1e5
    """Stiffness between rod and link."""
    damping_n_s_m: NonNegative = 1.5e3
    """Damping between rod and link."""


class StrikeRod(_Rod, frozen=True, kw_only=True, tag="strike", tag_field="kind"):
    """A free mass that meets the link once, with a pad between, as a pendulum does."""

    mass_kg: Positive
    """Mass of the striker."""
    speed_m_s: Positive
    """Speed with which the striker arrives."""
    stiffness_n_m: Positive = 2e4
    """Stiffness of the pad."""


Rod = ForceRod | DisplacementRod | StrikeRod


Deviations3 = Annotated[list[NonNegative], msgspec.Meta(min_length=3, max_length=3)]
Axes = float | Floats3
"""One number for all axes, or x, y and z."""
DeviationAxes = NonNegative | Deviations3


class Sides(FileStruct, frozen=True, kw_only=True):
    """A value for each side; 0 where it is not given."""

    left: Axes = 0.0
    """Value of the left foot."""
    right: Axes = 0.0
    """Value of the right foot."""


class DeviationSides(FileStruct, frozen=True, kw_only=True):
    """A standard deviation for each side; 0 where it is not given."""

    left: DeviationAxes = 0.0
    """Value of the left foot."""
    right: DeviationAxes = 0.0
    """Value of the right foot."""


ScaleAxes = Scale | Annotated[list[Scale], msgspec.Meta(min_length=3, max_length=3)]
"""Reading over truth: one number for all axes, or x, y and z."""


class ScaleSides(FileStruct, frozen=True, kw_only=True):
    """A scale for each side; 1 where it is not given."""

    left: ScaleAxes = 1.0
    """Value of the left foot."""
    right: ScaleAxes = 1.0
    """Value of the right foot."""


class SensorDelays(FileStruct, frozen=True, kw_only=True):
    """A delay for each kind of sensor [ms]."""

    imu: DelayMs = 0.0
    """Delay of the IMU."""
    force_torque: DelayMs = 0.0
    """Delay of both ankle sensors."""
    joints: DelayMs = 0.0
    """Delay of positions, velocities and efforts."""


class Sensors(FileStruct, frozen=True, kw_only=True):
    """Errors and rates of the sensors; without any of it they are exact.

    An error is one number for all axes and sides, ``[x, y, z]`` in the sensor's own
    frame, or, for the ankles, ``{ left = ..., right = ... }`` of either. A sensor
    reports scale x truth + bias + drift x time + noise. A sensor with a rate measures
    at that rate. In between it repeats its reading, stamped with the time of measuring.
    """

    force_noise_n: DeviationAxes | DeviationSides = 0.0
    """Ankle forces: standard deviation per sample."""
    moment_noise_nm: DeviationAxes | DeviationSides = 0.0
    """Ankle moments: standard deviation per sample."""
    gyro_noise_rad_s: DeviationAxes = 0.0
    """Gyroscope: standard deviation per sample."""
    accel_noise_m_s2: DeviationAxes = 0.0
    """Accelerometer: standard deviation per sample."""
    gyro_bias_rad_s: Axes = 0.0
    """Gyroscope: constant offset."""
    accel_bias_m_s2: Axes = 0.0
    """Accelerometer: constant offset."""
    force_bias_n: Axes | Sides = 0.0
    """Ankle forces: constant offset."""
    moment_bias_nm: Axes | Sides = 0.0
    """Ankle moments: constant offset."""
    force_scale: ScaleAxes | ScaleSides = 1.0
    """Ankle forces: reading over truth [1]."""
    moment_scale: ScaleAxes | ScaleSides = 1.0
    """Ankle moments: reading over truth [1]."""
    gyro_scale: ScaleAxes = 1.0
    """Gyroscope: reading over truth [1]."""
    accel_scale: ScaleAxes = 1.0
    """Accelerometer: reading over truth [1]."""
    force_drift_n_min: Axes | Sides = 0.0
    """Ankle forces: growth of the offset [N/min]."""
    moment_drift_nm_min: Axes | Sides = 0.0
    """Ankle moments: growth of the offset [N m/min]."""
    gyro_drift_rad_s_min: Axes = 0.0
    """Gyroscope: growth of the offset [rad/s/min]."""
    accel_drift_m_s2_min: Axes = 0.0
    """Accelerometer: growth of the offset [m/s^2/min]."""
    encoder_resolution_rad: EncoderStep = 0.0
    """Step size of the joint position readings. Velocities are low-passed differences
    of them; exact when 0."""
    encoder_offset_rad: EncoderOffset | dict[str, EncoderOffset] = 0.0
    """Reading minus true position: one number for all joints, or by joint."""
    force_torque_rate_hz: Positive | None = None
    """Rate of the ankle sensors; absent: every tick."""
    imu_rate_hz: Positive | None = None
    """Rate of gyroscope, accelerometer and attitude; absent: every tick. The
    accelerometer reports the mean since its last reading."""
    joints_rate_hz: Positive | None = None
    """Rate of positions, velocities and efforts; absent: every tick."""

    def axes(self, key: str, side: Side | None) -> list[float]:
        """Return x, y and z of a key.

        Args:
            key: name of a field of this struct.
            side: of the foot; None for what belongs to no foot.
        """
        value = getattr(self, key)
        if isinstance(value, (Sides, DeviationSides, ScaleSides)):
            value = value.left if side == "left" else value.right
        return list(value) if isinstance(value, list) else [float(value)] * 3


class Delay(FileStruct, frozen=True, kw_only=True):
    """Transport delays, in whole ticks of the robot."""

    sensor_ms: DelayMs | SensorDelays = 0.0
    """Delay from measuring to sending: one number for all sensors, or ``{ imu = ...,
    force_torque = ..., joints = ... }``."""
    jitter_ms: DelayMs = 0.0
    """Largest additional random delay of each kind of sensor, evenly distributed; a
    reading never overtakes an earlier one."""
    command_ms: DelayMs | None = None
    """Delay from a tick's sensors to the servos; absent: one tick of the robot."""

    def of(self, kind: str) -> float:
        """Return the delay of a kind of sensor [ms].

        Args:
            kind: ``imu``, ``force_torque`` or ``joints``.
        """
        if isinstance(self.sensor_ms, SensorDelays):
            value: float = getattr(self.sensor_ms, kind)
            return value
        return self.sensor_ms

    @property
    def shared_ms(self) -> float:
        """By how much all sensors are late together, which no stamp shows [ms]."""
        return min(self.of(kind.name) for kind in msgspec.structs.fields(SensorDelays))
