"""A stand-in for the parts of ROS 2 that the adapter uses; a test fills its topics."""

from __future__ import annotations

import sys
from collections import defaultdict, deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, Self

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot

DRIVER = Path(__file__).parents[2] / "deploy" / "driver"
NS_PER_S = 1_000_000_000


class Handle:
    """Messages that a subscription has received; a test appends to them."""

    def __init__(self) -> None:
        self.messages: deque[Any] = deque()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Release nothing."""

    def take_message(self, kind: type, raw: bool) -> tuple[Any] | None:
        return (self.messages.popleft(),) if self.messages else None


class Node:
    """A node that stores the topics it subscribes to."""

    def __init__(self) -> None:
        self.topics: dict[str, Handle] = defaultdict(Handle)

    def create_subscription(
        self, kind: type, name: str, callback: object, qos: object
    ) -> Any:
        return SimpleNamespace(handle=self.topics[name])

    def create_publisher(self, kind: type, name: str, qos: object) -> Any:
        return SimpleNamespace(get_subscription_count=lambda: 1)


def header(stamp_ns: int) -> Any:
    sec, nanosec = divmod(stamp_ns, NS_PER_S)
    return SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec))


def vector(x: float, y: float, z: float, **more: float) -> Any:
    return SimpleNamespace(x=x, y=y, z=z, **more)


def joint_states(names: list[str], positions: np.ndarray, stamp_ns: int) -> Any:
    return SimpleNamespace(
        header=header(stamp_ns),
        name=list(names),
        position=positions.tolist(),
        velocity=[],
        effort=[],
    )


def imu(stamp_ns: int) -> Any:
    return SimpleNamespace(
        header=header(stamp_ns),
        orientation=vector(0.0, 0.0, 0.0, w=1.0),
        orientation_covariance=[0.0] * 9,
        angular_velocity=vector(0.0, 0.0, 0.0),
        linear_acceleration=vector(0.0, 0.0, 9.81),
    )


def wrench(stamp_ns: int) -> Any:
    force, torque = vector(0.0, 0.0, 300.0), vector(0.0, 0.0, 0.0)
    return SimpleNamespace(
        header=header(stamp_ns), wrench=SimpleNamespace(force=force, torque=torque)
    )


def say_all(node: Node, robot: Robot, stamp_ns: int) -> None:
    """Publish one message on each topic of the shipped file."""
    states = joint_states(robot.joint_names, robot.nominal, stamp_ns)
    node.topics["/joint_states"].messages.append(states)
    node.topics["/imu/data"].messages.append(imu(stamp_ns))
    for side in ("left", "right"):
        topic = f"/{side}_ankle_ft/wrench"
        node.topics[topic].messages.append(wrench(stamp_ns))


@contextmanager
def made_up_ros2() -> Iterator[Any]:
    """Replace ROS 2 by the stand-in; return the driver's module."""
    anything: Any = type("Anything", (), {"__init__": lambda self, **words: None})
    policy = SimpleNamespace(BEST_EFFORT=0, RELIABLE=1)
    offered: dict[str, dict[str, Any]] = {
        "rclpy": {},
        "rclpy.qos": {"ReliabilityPolicy": policy, "QoSProfile": anything},
        "rclpy.signals": {"SignalHandlerOptions": anything},
        "geometry_msgs": {},
        "geometry_msgs.msg": {"WrenchStamped": anything},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"Imu": anything, "JointState": anything},
        "std_msgs": {},
        "std_msgs.msg": {"Float64MultiArray": anything},
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, contents in offered.items():
            module = ModuleType(name)
            vars(module).update(contents)
            patch.setitem(sys.modules, name, module)
        patch.syspath_prepend(str(DRIVER))
        import ros2_driver

        try:
            yield ros2_driver
        finally:
            for name in ("ros2_driver", "ros2_node", "ros2_settings"):
                sys.modules.pop(name, None)
