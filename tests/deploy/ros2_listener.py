"""A ROS 2 node like a recorder or RViz; prints what it heard as JSON at its end."""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2] / "deploy" / "driver"))
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros2_node import ros2_node
from ros2_publisher import Ros2Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from surefoot.robot_io.client_side.observer import LatestMessages
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot import load_robot
from surefoot.schemas import messages
from surefoot.view.scene_state import state_of

KINDS = {
    "/diagnostics": DiagnosticArray,
    "/surefoot/base_pose": PoseStamped,
    "/surefoot/joint_commands": JointState,
    "/surefoot/joint_states": JointState,
    "/surefoot/left_sole/desired": WrenchStamped,
    "/surefoot/left_sole/measured": WrenchStamped,
    "/surefoot/right_sole/measured": WrenchStamped,
    "/surefoot/robot_description": String,
}


class Ear:
    """Counts messages, and keeps those that the test checks."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.newest: dict[str, Any] = {}
        self.said: dict[str, set[str]] = {}

    def hear(self, topic: str, message: Any) -> None:
        self.counts[topic] += 1
        self.newest[topic] = message
        if topic == "/diagnostics":
            for status in message.status:
                fields = {pair.key: pair.value for pair in status.values}
                words = [status.message, fields.get("lost_sensors", "")]
                self.said.setdefault(status.name, set()).update(words)

    def report(self) -> dict[str, Any]:
        wrench = {
            topic: [getattr(message.wrench.force, axis) for axis in "xyz"]
            for topic, message in self.newest.items()
            if isinstance(message, WrenchStamped)
        }
        joints = self.newest.get("/surefoot/joint_states")
        text = self.newest.get("/surefoot/robot_description")
        return {
            "counts": self.counts,
            "force": wrench,
            "names": joints.name if joints else [],
            "description": text.data if text else "",
            "said": {name: sorted(words) for name, words in self.said.items()},
        }


def nominal_frames(robot_name: str, node: Any) -> list[tuple[str, str, list[float]]]:
    """Return the transforms of the nominal posture: parent, child, x y z [m]."""
    robot = load_robot(robot_name)
    stood = messages.JointState(
        schema=messages.SCHEMA_VERSION,
        tick=0,
        stamp_ns=0,
        q=robot.nominal.tolist(),
        dq=[0.0] * robot.n_a,
        effort=[0.0] * robot.n_a,
    )
    publisher = Ros2Publisher(robot, node)
    publisher.show({}, has_stabilizer=False)
    state = state_of(LatestMessages(joints=stood), robot, publisher.shape)
    return [
        (
            found.header.frame_id,
            found.child_frame_id,
            [getattr(found.transform.translation, axis) for axis in "xyz"],
        )
        for found in publisher.transforms(state)
    ]


def main() -> None:
    ear, stop = Ear(), StopRequest()
    keep = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    with stop.on_signals(), ros2_node("listener") as node:
        for topic, kind in KINDS.items():
            node.create_subscription(
                kind,
                topic,
                lambda message, topic=topic: ear.hear(topic, message),
                keep if kind is String else 10,
            )
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not stop.is_set and rclpy.ok():
            executor.spin_once(timeout_sec=0.1)
        report = ear.report()
        report["frames"] = nominal_frames(sys.argv[1], node)
    print(json.dumps(report))


if __name__ == "__main__":
    main()
