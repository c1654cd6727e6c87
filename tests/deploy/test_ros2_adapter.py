"""The ROS 2 driver with topics that have more, or less, than it needs."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deploy.driver.ros2_settings import Ros2Settings, load_settings
from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.robot import load_robot
from tests.deploy.made_up_ros2 import (
    DRIVER,
    NS_PER_S,
    Node,
    imu,
    joint_states,
    made_up_ros2,
    say_all,
)

WALKER = load_robot("walker")
GRIPPER = ["left_finger", "right_finger"]
SHIPPED = DRIVER / "ros2.toml"


@pytest.fixture
def node() -> Node:
    return Node()


@pytest.fixture
def driver() -> Iterator[Any]:
    with made_up_ros2() as module:
        yield module


@pytest.fixture
def adapter(driver: Any, node: Node) -> Any:
    say_all(node, WALKER, time.time_ns())
    adapter = driver.Ros2Adapter(WALKER, load_settings(SHIPPED, WALKER), node)
    adapter.read(0, time.monotonic_ns())
    return adapter


def settings_that_wait(folder: Path, start_s: float) -> Ros2Settings:
    text = SHIPPED.read_text().replace("[clock]", f"[clock]\nstart_s = {start_s}")
    path = folder / "ros2.toml"
    path.write_text(text)
    return load_settings(path, WALKER)


def test_joint_states_of_a_gripper_are_passed_over(
    adapter: Any, node: Node, caplog: pytest.LogCaptureFixture
) -> None:
    topic = node.topics["/joint_states"].messages
    others = joint_states(GRIPPER, np.zeros(2), time.time_ns())
    cut = joint_states(WALKER.joint_names, WALKER.nominal[:5], time.time_ns())
    moved = WALKER.nominal + 0.01
    topic += [others, others, cut, joint_states(WALKER.joint_names, moved, 1)]
    with caplog.at_level(logging.WARNING):
        adapter.wait()
    snapshot = adapter.read(1, time.monotonic_ns())
    np.testing.assert_array_equal(snapshot.q, moved)
    assert "no joint head_yaw" in caplog.messages[0]
    assert "got 5 numbers of position" in caplog.messages[1]
    assert len(caplog.messages) == 2  # each kind once


def test_only_joint_states_of_others_are_none(adapter: Any, node: Node) -> None:
    others = joint_states(GRIPPER, np.zeros(2), time.time_ns())
    node.topics["/joint_states"].messages.append(others)
    adapter.wait()
    adapter.read(1, time.monotonic_ns())
    assert "joints" in adapter.missing


def test_a_gripper_that_speaks_first_delays_no_start(driver: Any, node: Node) -> None:
    others = joint_states(GRIPPER, np.zeros(2), time.time_ns())
    node.topics["/joint_states"].messages.append(others)
    say_all(node, WALKER, time.time_ns())
    adapter = driver.Ros2Adapter(WALKER, load_settings(SHIPPED, WALKER), node)
    snapshot = adapter.read(0, time.monotonic_ns())
    np.testing.assert_array_equal(snapshot.q, WALKER.nominal)


def test_without_ours_the_start_says_what_the_others_have(
    driver: Any, node: Node, tmp_path: Path
) -> None:
    say_all(node, WALKER, time.time_ns())
    topic = node.topics["/joint_states"].messages
    topic.clear()
    topic.append(joint_states(GRIPPER, np.zeros(2), time.time_ns()))
    with pytest.raises(RobotFileError, match="it has left_finger, right_finger"):
        driver.Ros2Adapter(WALKER, settings_that_wait(tmp_path, 0.05), node)


def test_a_stamp_of_tomorrow_does_not_hide_a_sensor_that_dies(
    adapter: Any, node: Node
) -> None:
    tomorrow_ns = time.time_ns() + 86_400 * NS_PER_S
    node.topics["/imu/data"].messages.append(imu(tomorrow_ns))
    now_ns = time.monotonic_ns()
    snapshot = adapter.read(1, now_ns)
    assert "imu" not in adapter.missing
    assert all(then <= snapshot.stamp_ns for then in snapshot.measured_ns)
    adapter.read(2, now_ns + NS_PER_S)
    assert "imu" in adapter.missing
