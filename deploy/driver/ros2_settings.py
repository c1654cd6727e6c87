"""What a TOML says about a ROS 2 robot: topics, quality of service, names, clocks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec

from surefoot.robot_io.robot import Robot
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.toml_file import FileStruct, load
from surefoot.schemas.validation import nearest

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
TopicName = Annotated[str, msgspec.Meta(pattern=r"^/?[A-Za-z_][A-Za-z0-9_/]*$")]
Reliability = Literal["best_effort", "reliable"]


class SensorTopic(FileStruct, frozen=True, kw_only=True):
    """A topic that the robot publishes."""

    topic: TopicName
    """Its name."""
    reliability: Reliability = "best_effort"
    """Best effort hears every publisher; reliable has what was lost sent again."""


class WrenchTopic(SensorTopic, frozen=True, kw_only=True):
    """A topic with the wrench of an ankle, in the frame of the robot file's sensor."""

    sign: Literal["ground_on_robot", "robot_on_ground"] = "ground_on_robot"
    """Whose force it is; standing, the first pushes up."""


class CommandTopic(FileStruct, frozen=True, kw_only=True):
    """A topic that the robot takes joint positions from."""

    topic: TopicName
    """Its name."""
    type: Literal["std_msgs/Float64MultiArray", "sensor_msgs/JointState"]
    """An array for a forward position controller, or joint states by name."""
    joints: list[str] = []
    """Order of the array, in ROS's names; the robot file's when empty."""
    reliability: Reliability = "reliable"
    """What this publisher offers."""


class Clock(FileStruct, frozen=True, kw_only=True):
    """Whose time the readings carry."""

    stamps: Literal["header", "receipt"] = "header"
    """``header``: when measured, if both computers' clocks agree; ``receipt``: when
    taken in here."""
    max_age_s: Positive = 0.05
    """A reading older than this is not passed on [s]."""
    speed: Positive = 1.0
    """How fast the robot's time passes: other than 1 for a simulated robot only."""
    start_s: Positive = 10.0
    """How long the topics may take to appear [s]."""


class Ros2Settings(FileStruct, frozen=True, kw_only=True):
    """A ROS 2 robot."""

    node: str = "surefoot_driver"
    """Name of the driver's node."""
    joint_states: SensorTopic
    """sensor_msgs/JointState; it sets the pace: one tick per message."""
    imu: SensorTopic
    """sensor_msgs/Imu, in the frame of the robot file's IMU."""
    left_ankle_ft: WrenchTopic | None = None
    """geometry_msgs/WrenchStamped of the left ankle; absent for a robot file with
    [virtual_ft], whose ankles have no sensors."""
    right_ankle_ft: WrenchTopic | None = None
    """The same of the right ankle."""
    command: CommandTopic
    """Joint positions."""
    joints: dict[str, str] = {}
    """Joint of the robot file to its name in ROS, where they differ."""
    clock: Clock = Clock()
    """Time."""

    @property
    def sensors(self) -> dict[str, SensorTopic]:
        """The robot's topics by the channel of the sensor table."""
        every = {
            "joints": self.joint_states,
            "imu": self.imu,
            "left_ankle_ft": self.left_ankle_ft,
            "right_ankle_ft": self.right_ankle_ft,
        }
        return {name: entry for name, entry in every.items() if entry is not None}

    @property
    def signs(self) -> dict[str, float]:
        """What a wrench is multiplied by to be the ground's on the robot."""
        ankles = {"left_ankle_ft": self.left_ankle_ft}
        ankles["right_ankle_ft"] = self.right_ankle_ft
        return {
            name: 1.0 if entry.sign == "ground_on_robot" else -1.0
            for name, entry in ankles.items()
            if entry is not None
        }

    def ros_names(self, robot: Robot) -> list[str]:
        """Return ROS's names of the joints, in the order of the robot file."""
        return [self.joints.get(name, name) for name in robot.joint_names]


def load_settings(path: Path, robot: Robot) -> Ros2Settings:
    """Read the TOML and hold it against the robot.

    Raises:
        FileFormatError: it cannot be used; the message names file, key and fix.
    """
    settings = load(path, Ros2Settings)
    for name in settings.joints:
        if name not in robot.joint_names:
            near = nearest(name, robot.joint_names)
            raise _refused(
                path, f"joints.{name}", f"{robot.path} has no such joint{near}"
            )
    names = settings.ros_names(robot)
    for name in names:
        if names.count(name) > 1:
            text = f"{name!r} stands for two joints; expected one name each"
            raise _refused(path, "joints", text)
    order = settings.command.joints or names
    if sorted(order) != sorted(names):
        unknown = sorted(set(order) - set(names)) or "none"
        absent = sorted(set(names) - set(order)) or "none"
        raise _refused(
            path,
            "command.joints",
            f"expected each of the {len(names)} joints once, by ROS's names; got "
            f"{len(order)} (absent: {absent}, unknown: {unknown})",
        )
    is_virtual = robot.file.virtual_ft is not None
    for name in ("left_ankle_ft", "right_ankle_ft"):
        if (name in settings.sensors) is is_virtual:
            text = f"{robot.path} has [virtual_ft]: leave the ankle's topic out"
            if not is_virtual:
                text = "missing: the ankle's topic; or [virtual_ft] in the robot file"
            raise _refused(path, name, text)
    topics = [entry.topic for entry in settings.sensors.values()]
    for topic in topics:
        if topics.count(topic) > 1:
            raise _refused(path, "topic", f"{topic!r} is used twice; one sensor each")
    return settings


def _refused(path: Path, field: str, text: str) -> FileFormatError:
    return FileFormatError(f"{path}: {field}: {text}", field=field)
