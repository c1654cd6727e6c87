"""Sensor table: every sensor of a robot and all that other code must know of it.

Topics, snapshot, delivery, health, faults, noise, recorder, relay, digest and
conformance checks are derived from this table. A new sensor is a new entry.
"""

from __future__ import annotations

import re
from enum import StrEnum
from typing import Any, get_args

import msgspec

from surefoot.schemas import messages
from surefoot.schemas.robot_file import RobotFile, Side

PER_JOINT = 0
"""Size of a quantity with one number per joint."""


class Reach(StrEnum):
    """Limit by which a number is judged to be possible."""

    UNLIMITED = "unlimited"
    """No limit; the number must only be finite."""
    SETTING = "setting"
    """From minus to plus the value of the setting that ``range`` names."""
    JOINT_RANGE = "joint range"
    """The joint's range, widened at both ends by the setting that ``range`` names."""
    JOINT_SPEED = "joint speed"
    """A multiple of the joint's velocity limit."""
    UNIT_NORM = "unit norm"
    """The numbers together are a unit quaternion."""


class Loss(StrEnum):
    """What it means to lose a sensor."""

    HOLD = "hold"
    """Nothing works without it: the last posture is then held."""
    DEGRADE = "degrade"
    """A controller that can do without it goes on."""
    REPORT = "report"
    """No controller needs it; its loss is only reported."""


class Noise(msgspec.Struct, frozen=True, kw_only=True):
    """Noise of a quantity in the simulator, set in a scenario's [sensors]."""

    stem: str
    """Beginning of its settings' names: ``force`` of ``force_noise_n``."""
    unit: str
    """End of their names: ``n``."""
    stream: int
    """Number of the sensor's own stream of random numbers. Changing one changes every
    noisy run."""

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
    """Attribute of the message."""
    field: str
    """Field of the snapshot. Quantities that share a field follow one another in it."""
    size: int = PER_JOINT
    """Count of numbers; PER_JOINT for one per joint."""
    reach: Reach = Reach.UNLIMITED
    """Limit by which it is judged."""
    range: str = ""
    """Setting of [safety] that ``reach`` refers to."""
    jump: str = ""
    """Setting of [safety] with the largest change in one tick; empty for none."""
    trembles: bool = True
    """Whether its last digits change while the sensor works. The sensor is frozen if no
    such quantity changes."""
    noise: Noise | None = None
    """Noise in the simulator; None for none."""


class Offset(msgspec.Struct, frozen=True, kw_only=True):
    """Offset that the fault ``jump`` adds to a reading."""

    attribute: str
    """Attribute of the message."""
    axis: int | None = None
    """Index of the number in it; None for all."""
    size: float
    """Default size in the attribute's unit, if the scenario gives none."""


class Sensor(msgspec.Struct, frozen=True, kw_only=True):
    """One sensor: a channel of the bus and a part of the snapshot."""

    name: str
    """Name of the channel."""
    key: str
    """Key of the channel, relative to the robot's namespace."""
    description: str
    """Text for the table of topics."""
    message: type[messages.Message]
    """Kind of message that the sensor sends."""
    rate: str = "every tick"
    """How often it sends, in words."""
    frame: str = ""
    """Path in the robot file to the URDF link it sits on; empty for the joints."""
    side: Side | None = None
    """Side of the foot it measures; None if it belongs to no foot."""
    loss: Loss
    """Consequence of its loss."""
    offset: Offset
    """Attribute that the fault ``jump`` changes."""
    quantities: tuple[Quantity, ...]
    """Its quantities, in the order of the snapshot."""

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
"""All sensors. Messages of a tick are sent in this order, and whatever is given per
sensor follows it. The joints come first: their stamp is the snapshot's."""

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
