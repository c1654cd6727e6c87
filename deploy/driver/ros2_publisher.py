"""Shows a robot of Surefoot's bus to ROS 2: RViz, rosbag, rqt.

python deploy/driver/ros2_publisher.py deploy/loopback.toml walker

It only listens: to end it changes nothing for the robot. Everything is below
``/surefoot``, link frames too, so that it never contends with the robot's own topics.
"""

from __future__ import annotations

import argparse
import logging
import sys
import xml.etree.ElementTree as ElementTree
from array import array
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parent))
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import (
    PointStamped,
    PoseStamped,
    TransformStamped,
    WrenchStamped,
)
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros2_node import ros2_node
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String

from surefoot.errors import complain
from surefoot.robot_io.client_side.observer import (
    VIEWER_CHANNELS,
    LatestMessages,
    Observer,
)
from surefoot.robot_io.realtime import Pacer, StopRequest, TimingLog
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.robot_io.urdf_check import read_urdf_element
from surefoot.schemas.arrays import Array, Mat
from surefoot.schemas.endpoints import load_endpoints
from surefoot.schemas.messages import (
    ForceTorque,
    RobotMode,
    RobotStatus,
    StabilizerStatus,
)
from surefoot.schemas.reasons import EndReason, StabilizerState
from surefoot.schemas.sensors import of_kind
from surefoot.view.robot_shape import RobotShape
from surefoot.view.scene_state import SceneState, state_of

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None

PREFIX = "surefoot"
WORLD = f"{PREFIX}/world"
ANKLES = tuple(entry.name for entry in of_kind(ForceTorque))
_LOG = logging.getLogger("surefoot.ros2")


def description_of(robot: Robot) -> str:
    """The URDF, with addresses of meshes that RViz can open from anywhere."""
    root = read_urdf_element(robot.urdf_path)
    meshes = list(root.iter("mesh"))
    if not meshes:
        return robot.urdf_path.read_text(encoding="utf-8")
    for mesh in meshes:
        name = mesh.get("filename", "")
        if "://" not in name:
            mesh.set("filename", (robot.urdf_path.parent / name).resolve().as_uri())
    return ElementTree.tostring(root, encoding="unicode")


class Ros2Publisher:
    """Says in ROS's messages what the bus said last."""

    def __init__(self, robot: Robot, node: Any) -> None:
        """Declare topics and send the robot's description.

        Raises:
            RobotFileError: its shapes cannot be read.
        """
        self._robot, self._node = robot, node
        self.shape = RobotShape(robot)
        self._publishers: dict[str, Any] = {}
        keep = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        description = node.create_publisher(String, f"{PREFIX}/robot_description", keep)
        description.publish(String(data=description_of(robot)))
        if TFMessage is None:
            _LOG.warning(
                "no tf: tf2_msgs is not installed, it has no wheel; a ROS 2 from apt "
                "or conda brings it"
            )

    def show(self, seen: dict[str, msgspec.Struct], *, has_stabilizer: bool) -> None:
        """Publish what is known now.

        Args:
            seen: newest message of each channel.
            has_stabilizer: whether one is on the bus; what one said before is old.
        """
        if not has_stabilizer:
            seen.pop("stabilizer", None)
        self._stamp = self._node.get_clock().now().to_msg()
        sight = LatestMessages(**{name: seen.get(name) for name in VIEWER_CHANNELS})
        if sight.joints is not None:
            self._joints("joint_states", sight.joints.q, sight.joints)
        if sight.status is not None:
            self._joints("joint_commands", sight.status.q_command)
        if sight.imu is not None:
            self._imu(sight.imu)
        for name, foot in zip(ANKLES, self._robot.file.foot, strict=True):
            if (ankle := seen.get(name)) is not None:
                F = np.array(ankle.force + ankle.moment)
                self._wrench(name, F, frame=foot.ft_link)
        state = state_of(sight, self._robot, self.shape)
        if state is not None:
            self._scene(state)
        self._diagnostics(sight)

    def _send(self, name: str, message: Any) -> None:
        publisher = self._publishers.get(name)
        if publisher is None:
            topic = name if name.startswith("/") else f"{PREFIX}/{name}"
            publisher = self._node.create_publisher(type(message), topic, 10)
            self._publishers[name] = publisher
        publisher.publish(message)

    def _stamped(self, message: Any, frame: str) -> Any:
        message.header.stamp = self._stamp
        message.header.frame_id = frame
        return message

    def _joints(self, name: str, q: list[float], measured: Any = None) -> None:
        message = self._stamped(JointState(name=self._robot.joint_names), "")
        message.position = array("d", q)
        if measured is not None:
            message.velocity = array("d", measured.dq)
            message.effort = array("d", measured.effort)
        self._send(name, message)

    def _imu(self, reading: Any) -> None:
        message = self._stamped(Imu(), f"{PREFIX}/{self._robot.file.imu.frame}")
        _fill(message.orientation, reading.quat_xyzw, "xyzw")
        _fill(message.angular_velocity, reading.angular_velocity)
        _fill(message.linear_acceleration, reading.linear_acceleration)
        self._send("imu", message)

    def _wrench(self, name: str, F: Array, *, frame: str) -> None:
        message = self._stamped(WrenchStamped(), f"{PREFIX}/{frame}")
        _fill(message.wrench.force, F[:3])
        _fill(message.wrench.torque, F[3:])
        self._send(name, message)

    def _scene(self, state: SceneState) -> None:
        """Publish what has a place in the world: base, links, CoM, sole wrenches."""
        base = self._stamped(PoseStamped(), WORLD)
        _fill(base.pose.position, state.base[:3, 3])
        _fill(base.pose.orientation, _quat_xyzw(state.base), "xyzw")
        self._send("base_pose", base)
        for name, point in (("com", state.com), ("com_reference", state.com_reference)):
            if point is not None:
                message = self._stamped(PointStamped(), WORLD)
                _fill(message.point, point)
                self._send(name, message)
        for word, wrenches in (("measured", state.F_meas), ("desired", state.F_id)):
            if wrenches is not None:
                for foot, F in zip(
                    self._robot.file.foot, (wrenches[:6], wrenches[6:]), strict=True
                ):
                    name = f"{foot.side}_sole/{word}"
                    self._wrench(name, F, frame=foot.sole_frame)
        if TFMessage is not None:
            self._send("/tf", TFMessage(transforms=self.transforms(state)))

    def transforms(self, state: SceneState) -> list[Any]:
        """Every link below the base, and the base below the world."""
        base_link = self._robot.file.base_link
        found = [self._transform(WORLD, base_link, state.base)]
        for link, pose in self.shape.poses(state.q).items():
            if link != base_link:
                found.append(self._transform(f"{PREFIX}/{base_link}", link, pose))
        return found

    def _transform(self, parent: str, link: str, pose: Mat) -> Any:
        message = self._stamped(TransformStamped(), parent)
        message.child_frame_id = f"{PREFIX}/{link}"
        _fill(message.transform.translation, pose[:3, 3])
        _fill(message.transform.rotation, _quat_xyzw(pose), "xyzw")
        return message

    def _diagnostics(self, sight: LatestMessages) -> None:
        message = self._stamped(DiagnosticArray(), "")
        name = self._robot.file.name
        message.status = [
            _diagnosis(f"{name}: command gate", sight.status, _gate_level),
            _diagnosis(f"{name}: stabilizer", sight.stabilizer, _stabilizer_level),
        ]
        self._send("/diagnostics", message)


def _gate_level(status: RobotStatus) -> tuple[bytes, str]:
    levels = {
        RobotMode.FAULT: DiagnosticStatus.ERROR,
        RobotMode.OFF: DiagnosticStatus.WARN,
    }
    text = f"{status.mode}: {status.cause} {status.detail}".strip()
    return levels.get(status.mode, DiagnosticStatus.OK), text


def _stabilizer_level(status: StabilizerStatus) -> tuple[bytes, str]:
    text = f"{status.state} {status.detail}".strip()
    if status.end is not EndReason.NONE:
        return DiagnosticStatus.ERROR, f"{status.end}: {text}"
    is_active = status.state is StabilizerState.ACTIVE
    return (DiagnosticStatus.OK if is_active else DiagnosticStatus.WARN), text


def _diagnosis(name: str, status: Any, level_of: Any) -> DiagnosticStatus:
    """Word a status for rqt: its level, a line, and every field but long arrays."""
    if status is None:
        return DiagnosticStatus(
            name=name, level=DiagnosticStatus.STALE, message="not on the bus"
        )
    level, text = level_of(status)
    fields = {
        field: value
        for field, value in msgspec.to_builtins(status).items()
        if not isinstance(value, list) or len(value) <= len("xyzrpy")
    }
    values = [KeyValue(key=field, value=str(value)) for field, value in fields.items()]
    return DiagnosticStatus(name=name, level=level, message=text, values=values)


def _quat_xyzw(pose: Mat) -> Array:
    quat: Array = Rotation.from_matrix(pose[:3, :3]).as_quat()
    return quat


def _fill(target: Any, numbers: Any, names: str = "xyz") -> None:
    for name, number in zip(names, numbers, strict=True):
        setattr(target, name, float(number))


def main() -> None:
    """Publish until the robot has left, or Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("endpoints", type=Path)
    parser.add_argument("robot", nargs="?", default="walker")
    parser.add_argument("--rate", type=float, default=100.0, help="messages a second")
    parser.add_argument("--wait", type=float, default=30.0, help="for the robot [s]")
    words = parser.parse_args()
    robot, stop = load_robot(words.robot), StopRequest()
    pacer = Pacer(1.0 / words.rate, lateness=TimingLog())
    channels = (*VIEWER_CHANNELS, *ANKLES)
    seen: dict[str, msgspec.Struct] = {}
    with (
        ros2_node("surefoot_publisher") as node,
        Observer(
            robot, endpoints=load_endpoints(words.endpoints), channels=channels
        ) as observer,
    ):
        publisher = Ros2Publisher(robot, node)
        observer.connect(timeout_s=words.wait)
        with stop.on_signals():
            while not (stop.is_set or observer.has_left()):
                seen.update(observer.latest())
                publisher.show(seen, has_stabilizer=bool(observer.stabilizers))
                pacer.wait()


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    complain(main)
