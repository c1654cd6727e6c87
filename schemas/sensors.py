"""Sensor table: every sensor of a robot, and all that the rest must know of it.

Topics, snapshot, delivery, health, faults, noise, recorder, relay, digest and
conformance checks are derived from this table; a further sensor is a further entry.
"""

from __future__ import annotations

import re
from enum import StrEnum
from typing import Any, get_args

import msgspec

from surefoot.schemas import messages
from surefoot.schemas.robot_file import RobotFile, Side

PER_JOINT = 0
"""Size of what holds one number per joint."""


class Reach(StrEnum):
    """What a number is held against, to tell whether it can have been measured."""

    UNLIMITED = "unlimited"
    """Nothing but that it is a number."""
    SETTING = "setting"
    """From minus to plus the setting that ``range`` names."""
    JOINT_RANGE = "joint range"
    """The joint's range, widened at both ends by the setting that ``range`` names."""
    JOINT_SPEED = "joint speed"
    """A multiple of the joint's velocity limit."""
    UNIT_NORM = "unit norm"
    """The numbers together are a unit quaternion."""


class Loss(StrEnum):
    """What it means to lose a sensor."""

    HOLD = "hold"
    """Nothing works without it: the last posture is held."""
    DEGRADE = "degrade"
    """A controller that can leave it out goes on without it."""
    REPORT = "report"
    """No controller needs it; that it is lost is told, no more."""


class Noise(msgspec.Struct, frozen=True, kw_only=True):
    """How the simulator disturbs a quantity; settings are of a scenario's [sensors]."""

    stem: str
    """Begins the names of its settings: ``force`` of ``force_noise_n``."""
    unit: str
    """Ends them: ``n``."""
    stream: int
    """Number of its random numbers' stream, the sensor's own. To change one changes
    every noisy run."""

    @property
    def deviation(self) -> str:
        """Setting with the standard deviation."""
        return f"{self.stem}_noise_{self.unit}"

    @property
    def bias(self) -> str:
        """Setting with the constant offset."""
        return f"{self.stem}_bias_{self.unit}"

    @property
    def scale(self) -> str:
        """Setting with the scale."""
        return f"{self.stem}_scale"

    @property
    def drift(self) -> str:
        """Setting with the growth of the offset per minute."""
        return f"{self.stem}_drift_{self.unit}_min"


class Quantity(msgspec.Struct, frozen=True, kw_only=True):
    """Numbers of one kind in a sensor's message."""

    attribute: str
    """Of the message."""
    field: str
    """Of the snapshot. Quantities that share one stand in it one after the other."""
    size: int = PER_JOINT
    """How many numbers; PER_JOINT for one per joint."""
    reach: Reach = Reach.UNLIMITED
    """What it is held against."""
    range: str = ""
    """Setting of [safety] that ``reach`` speaks of."""
    jump: str = ""
    """Setting of [safety] with the largest change in one tick; empty for none."""
    trembles: bool = True
    """Whether its last digits move while the sensor lives: when none of these do, the
    sensor is frozen."""
    noise: Noise | None = None
    """How the simulator disturbs it; None for not at all."""


class Offset(msgspec.Struct, frozen=True, kw_only=True):
    """What the fault ``jump`` adds to a reading."""

    attribute: str
    """Of the message."""
    axis: int | None = None
    """Which of its numbers; None for all."""
    size: float
    """How much, in its unit, where the scenario does not say."""


class Sensor(msgspec.Struct, frozen=True, kw_only=True):
    """One sensor: a channel of the bus and a part of the snapshot."""

    name: str
    """Of its channel."""
    key: str
    """Of its channel, relative to the robot's namespace."""
    description: str
    """For the table of topics."""
    message: type[messages.Message]
    """What it sends."""
    rate: str = "every tick"
    """How often."""
    frame: str = ""
    """Where the robot file names the URDF link it sits on; empty for the joints."""
    side: Side | None = None
    """Of the foot it measures; None for what belongs to no foot."""
    loss: Loss
    """What it means to lose it."""
    offset: Offset
    """What a jump of it touches."""
    quantities: tuple[Quantity, ...]
    """What it measures, in the order of the snapshot."""

    @property
    def attributes(self) -> tuple[str, ...]:
        """Attributes of its message that hold its readings."""
        return tuple(quantity.attribute for quantity in self.quantities)

    @property
    def fields(self) -> tuple[str, ...]:
        """Fields of the snapshot that hold its readings."""
        return tuple(dict.fromkeys(quantity.field for quantity in self.quantities))

    def place(self, attribute: str) -> tuple[str, slice]:
        """Find where an attribute stands in the snapshot.

        Returns:
            The field and the part of it.

        Raises:
            KeyError: the sensor has no such attribute.
        """
        begins: dict[str, int] = {}
        for quantity in self.quantities:
            begin = begins.get(quantity.field, 0)
            end = begin + quantity.size if quantity.size else None
            if quantity.attribute == attribute:
                return quantity.field, slice(begin, end)
            begins[quantity.field] = begin + quantity.size
        raise KeyError(f"{self.name} has no {attribute!r}, but {self.attributes}")

    def link(self, file: RobotFile) -> str:
        """Find the URDF link that the robot file names for it."""
        value: Any = file
        for word in re.findall(r"\w+", self.frame):
            value = value[int(word)] if word.isdigit() else getattr(value, word)
        return str(value)


def _imu(prefix: str, *, gyro_stream: int, accel_stream: int) -> tuple[Quantity, ...]:
    """What an IMU measures."""
    return (
        Quantity(
            attribute="quat_xyzw",
            field=f"{prefix}quat_xyzw",
            size=4,
            reach=Reach.UNIT_NORM,
            trembles=False,
        ),
        Quantity(
            attribute="angular_velocity",
            field=f"{prefix}angular_velocity",
            size=3,
            reach=Reach.SETTING,
            range="gyro_range_rad_s",
            jump="gyro_jump_rad_s",
            noise=Noise(stem="gyro", unit="rad_s", stream=gyro_stream),
        ),
        Quantity(
            attribute="linear_acceleration",
            field=f"{prefix}linear_acceleration",
            size=3,
            reach=Reach.SETTING,
            range="accel_range_m_s2",
            jump="accel_jump_m_s2",
            noise=Noise(stem="accel", unit="m_s2", stream=accel_stream),
        ),
    )


def _force_torque(field: str, *, stream: int) -> tuple[Quantity, ...]:
    """What a six-axis sensor measures."""
    return tuple(
        Quantity(
            attribute=kind,
            field=field,
            size=3,
            reach=Reach.SETTING,
            range=f"{kind}_range_{unit}",
            jump=f"{kind}_jump_{unit}",
            noise=Noise(stem=kind, unit=unit, stream=stream),
        )
        for kind, unit in (("force", "n"), ("moment", "nm"))
    )


SENSORS: tuple[Sensor, ...] = (
    Sensor(
        name="joints",
        key="state/joints",
        description="measured joint positions, velocities and efforts",
        message=messages.JointState,
        loss=Loss.HOLD,
        offset=Offset(attribute="q", size=0.3),
        quantities=(
            Quantity(
                attribute="q",
                field="q",
                reach=Reach.JOINT_RANGE,
                range="joint_margin_rad",
                jump="joint_jump_rad",
                trembles=False,
            ),
            Quantity(attribute="dq", field="dq", reach=Reach.JOINT_SPEED),
            Quantity(attribute="effort", field="effort"),
        ),
    ),
    Sensor(
        name="imu",
        key="state/imu",
        description="gyroscope, accelerometer and the unit's own attitude",
        message=messages.ImuState,
        frame="imu.frame",
        loss=Loss.HOLD,
        offset=Offset(attribute="angular_velocity", axis=0, size=5.0),
        quantities=_imu("", gyro_stream=2, accel_stream=3),
    ),
    *(
        Sensor(
            name=f"{side}_ankle_ft",
            key=f"state/ft/{side}_ankle",
            description=f"{side} ankle force-torque sensor",
            message=messages.ForceTorque,
            frame=f"foot[{index}].ft_link",
            side=side,
            loss=Loss.DEGRADE,
            offset=Offset(attribute="force", axis=2, size=2500.0),
            quantities=_force_torque(f"ft_{side}", stream=index),
        )
        for index, side in enumerate(get_args(Side))
    ),
)
"""In the order in which the messages of a tick are sent, and of everything that is
told per sensor. The joints come first: their stamp is that of the snapshot."""

SNAPSHOT_FIELDS = tuple(field for sensor in SENSORS for field in sensor.fields)
"""All readings of a snapshot, in order."""


def sensor(name: str) -> Sensor:
    """Find a sensor by its channel.

    Raises:
        KeyError: no such sensor; the message lists the valid names.
    """
    for entry in SENSORS:
        if entry.name == name:
            return entry
    raise KeyError(f"no sensor {name!r}; there are {[s.name for s in SENSORS]}")


def of_kind(message: type[messages.Message]) -> tuple[Sensor, ...]:
    """All sensors that send messages of a kind."""
    return tuple(entry for entry in SENSORS if entry.message is message)


def ankle_sensor(side: Side) -> Sensor:
    """The force-torque sensor of a foot."""
    (entry,) = (entry for entry in SENSORS if entry.side == side)
    return entry
