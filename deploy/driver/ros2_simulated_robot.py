"""A ROS 2 robot to try the driver with: the simulated robot behind ROS 2 topics.

cd deploy/driver
python ros2_simulated_robot.py moving-platform-fast ros2.toml

It stands, and its scenario begins with the first command that moves. ``speed = 0.1`` in
the TOML's [clock] has its time pass at a tenth of ours.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
from array import array
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from ros2_driver import Topic
from ros2_node import RELIABILITY, ros2_node
from ros2_settings import Ros2Settings, load_settings

from surefoot.errors import complain
from surefoot.robot_io.realtime import Pacer, StopRequest, TimingLog, quiet_interpreter
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.scenario import Scenario
from surefoot.sim_robot.catalogue import load_scenario
from surefoot.sim_robot.simulated_robot import SimulatedRobot

MOVES_RAD = 1e-5
"""A command that differs by so much from the first one is somebody balancing."""


class Ros2Face:
    """What the robot shows to ROS 2: its sensors, and where it takes commands."""

    def __init__(self, robot: Robot, settings: Ros2Settings, node: Any) -> None:
        """Declare topics."""
        from geometry_msgs.msg import WrenchStamped
        from rclpy.qos import QoSProfile
        from sensor_msgs.msg import Imu, JointState
        from std_msgs.msg import Float64MultiArray

        self._node = node
        names = settings.ros_names(robot)
        self._joints, self._imu = JointState(name=names), Imu()
        self._signs = settings.signs
        self._wrenches = {name: WrenchStamped() for name in self._signs}
        self._imu.header.frame_id = robot.file.imu.frame
        for foot in robot.file.foot:
            if (message := self._wrenches.get(f"{foot.side}_ankle_ft")) is not None:
                message.header.frame_id = foot.ft_link
        self._publishers = {
            name: node.create_publisher(
                {"joints": JointState, "imu": Imu}.get(name, WrenchStamped),
                entry.topic,
                QoSProfile(depth=5, reliability=RELIABILITY[entry.reliability]),
            )
            for name, entry in settings.sensors.items()
        }
        self._by_name = settings.command.type == "sensor_msgs/JointState"
        order = settings.command.joints or names
        self._from_array = np.array([order.index(name) for name in names])
        self._commands = Topic(
            node,
            JointState if self._by_name else Float64MultiArray,
            settings.command.topic,
            QoSProfile(depth=1, reliability=RELIABILITY[settings.command.reliability]),
        )

    def publish(self, snapshot: Snapshot, *, missing: tuple[str, ...] = ()) -> None:
        """Send the sensors of a tick; the joints last, as they start the next one.

        Args:
            snapshot: all of them.
            missing: channels that a fault of the scenario silences.
        """
        stamp = self._node.get_clock().now().to_msg()
        imu = self._imu
        imu.header.stamp = stamp
        _fill(imu.orientation, snapshot.quat_xyzw, "xyzw")
        _fill(imu.angular_velocity, snapshot.angular_velocity)
        _fill(imu.linear_acceleration, snapshot.linear_acceleration)
        messages: dict[str, Any] = {"imu": imu}
        readings = {"left_ankle_ft": snapshot.ft_left}
        readings["right_ankle_ft"] = snapshot.ft_right
        for name, message in self._wrenches.items():
            F = self._signs[name] * readings[name]
            message.header.stamp = stamp
            _fill(message.wrench.force, F[:3])
            _fill(message.wrench.torque, F[3:])
            messages[name] = message
        joints = self._joints
        joints.header.stamp = stamp
        joints.position = array("d", snapshot.q.tobytes())
        joints.velocity = array("d", snapshot.dq.tobytes())
        joints.effort = array("d", snapshot.effort.tobytes())
        messages["joints"] = joints
        for name, message in messages.items():
            if name not in missing:
                self._publishers[name].publish(message)

    def command(self) -> Array | None:
        """Return the newest command; None when none has come."""
        message = self._commands.take()
        if message is None:
            return None
        if self._by_name:
            places = dict(zip(message.name, message.position, strict=True))
            return np.array([places[name] for name in self._joints.name])
        return np.array(message.data)[self._from_array]


def run_scenario(
    robot: Robot,
    scenario: Scenario,
    face: Ros2Face,
    *,
    speed: float,
    seed: int,
    stop: StopRequest,
) -> SimulatedRobot:
    """Stand until somebody balances, then go through the scenario."""
    run = SimulatedRobot(robot, scenario, seed=seed)
    first: Array | None = None
    q_command, has_begun = robot.nominal, False
    pacer = Pacer(robot.period_s / speed, lateness=TimingLog())
    with quiet_interpreter():
        while not (stop.is_set or run.finished):
            face.publish(run.sense(), missing=run.missing_sensors)
            pacer.wait()  # the answer has this tick's time to come
            command = face.command()
            if command is not None:
                first = command if first is None else first
                q_command = command
            if first is not None and not has_begun:
                has_begun = bool(np.abs(q_command - first).max() > MOVES_RAD)
            if has_begun:
                run.advance(q_command)
            else:
                run.wait(q_command)
    return run


def verdict(run: SimulatedRobot) -> dict[str, object]:
    """What became of the robot: its own truth, not what anybody measured."""
    times = TimingLog().distribution()
    result = run.result(
        real_time_factor=0.0,
        round_trip_ms=times,
        period_jitter_ms=times,
        deadline_misses=0,
        refused={},
        clipped={},
    )
    return {
        "fell": result.fell,
        "duration_s": result.duration_s,
        "com_error_max_mm": result.com_error_max_mm,
        "force_peak_n": result.force_peak_n,
        "base_tilt_max_deg": result.base_tilt_max_deg,
    }


def _fill(target: Any, numbers: Array, names: str = "xyz") -> None:
    for name, number in zip(names, numbers.tolist(), strict=True):
        setattr(target, name, number)


def main() -> None:
    """Run until the scenario is over or Ctrl-C; print what became of the robot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("ros2", type=Path, help="the TOML that the driver reads")
    parser.add_argument("--robot", default="walker")
    parser.add_argument("--seed", type=int, default=0)
    words = parser.parse_args()
    robot = load_robot(words.robot)
    settings = load_settings(words.ros2, robot)
    stop = StopRequest()
    with ros2_node("simulated_robot") as node, stop.on_signals():
        run = run_scenario(
            robot,
            load_scenario(words.scenario),
            Ros2Face(robot, settings, node),
            speed=settings.clock.speed,
            seed=words.seed,
            stop=stop,
        )
    print(json.dumps(verdict(run)))
    sys.exit(5 if run.fell else 0)


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    complain(main)
