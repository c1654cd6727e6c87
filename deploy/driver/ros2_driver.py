"""A driver for a robot that speaks ROS 2: its topics put behind the bus.

python deploy/driver/ros2_driver.py deploy/loopback.toml deploy/driver/ros2.toml walker
"""

from __future__ import annotations

import logging
import sys
import time
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from ros2_node import RELIABILITY, ros2_node
from ros2_settings import Ros2Settings, load_settings

from surefoot.errors import UsageError, complain
from surefoot.robot_io.errors import RobotFileError, RobotUnreachableError
from surefoot.robot_io.realtime import TimingLog
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.robot_io.robot_side.driver import drive
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.endpoints import load_endpoints
from surefoot.schemas.topics import TICK_SENSORS

_LOG = logging.getLogger("surefoot.ros2")
NS_PER_S = 1_000_000_000
BACKLOG = 5
"""Joint states kept while the driver is late, one tick each; as a clocked loop does."""
POLLS_PER_TICK = 10
JOINT_STATE = ("position", "velocity", "effort")


class Topic:
    """A subscription that is asked, from the driver's own thread.

    An executor would cost some hundred microseconds per message, a good part of a tick.
    """

    def __init__(self, node: Any, kind: type, name: str, qos: Any) -> None:
        """Subscribe."""
        self.kind, self.name, self.qos = kind, name, qos
        self._handle = node.create_subscription(kind, name, _never, qos).handle

    def take(self) -> Any | None:
        """Return the next message, without waiting; None when there is none."""
        with self._handle:
            taken = self._handle.take_message(self.kind, False)
        return None if taken is None else taken[0]


class Ros2Adapter:
    """Turns ROS's messages into snapshots and postures into its commands.

    Attributes:
        missing: channels whose newest message is older than allowed.
        ages: from stamp in the header of joint states until they are read.
        periods: from one of these stamps to the next.
    """

    def __init__(self, robot: Robot, settings: Ros2Settings, node: Any) -> None:
        """Subscribe, and wait until every topic has said something sound.

        Raises:
            RobotUnreachableError: a topic is silent; says what is known of it.
            RobotFileError: joint names, sizes or stamps are not as they must be.
        """
        from geometry_msgs.msg import WrenchStamped
        from rclpy.qos import QoSProfile
        from sensor_msgs.msg import Imu, JointState
        from std_msgs.msg import Float64MultiArray

        self._robot, self._settings, self._node = robot, settings, node
        kinds = {"joints": JointState, "imu": Imu}
        self._topics = {
            name: Topic(
                node,
                kinds.get(name, WrenchStamped),
                entry.topic,
                QoSProfile(
                    depth=BACKLOG if name == "joints" else 1,
                    reliability=RELIABILITY[entry.reliability],
                ),
            )
            for name, entry in settings.sensors.items()
        }
        self._by_name = settings.command.type == "sensor_msgs/JointState"
        self._command = JointState() if self._by_name else Float64MultiArray()
        self._publisher = node.create_publisher(
            type(self._command),
            settings.command.topic,
            QoSProfile(depth=1, reliability=RELIABILITY[settings.command.reliability]),
        )
        names = settings.ros_names(robot)
        order = settings.command.joints or names
        self._to_ros = np.array([names.index(name) for name in order])
        if self._by_name:
            self._command.name = order
        self._max_age_ns = round(settings.clock.max_age_s * NS_PER_S)
        self.missing: tuple[str, ...] = ()
        self.ages, self.periods = TimingLog(), TimingLog()
        self._taken_ns = dict.fromkeys(self._topics, 0)
        self._fresh: Any | None = None
        self._newest: dict[str, Any] = {}
        self._layout: tuple[Any, ...] = ()
        self._passed_over = ""
        self._q = self._dq = self._effort = robot.nominal
        self._stamp_ns = 0
        self._wait_for_all()

    def wait(self) -> None:
        """Return once there are new joint states, or when they have been silent.

        Then a tick passes all the same: requests are served, the watchdog runs, and
        the stabilizer learns what is missing. Joint states of somebody else, such as a
        gripper, are passed over.
        """
        end_s = time.monotonic() + self._settings.clock.max_age_s
        pause_s = self._robot.period_s / POLLS_PER_TICK
        joints = self._topics["joints"]
        while self._fresh is None and time.monotonic() < end_s:
            message = joints.take()
            if message is None:
                time.sleep(pause_s)  # DDS offers nothing cheaper to Python
            elif not (why := self._why_not_ours(message)):
                self._fresh = message
            elif why != self._passed_over:
                self._passed_over = why
                _LOG.warning("%s; passed over", why)

    def read(self, tick: int, stamp_ns: int) -> Snapshot:
        """Join the joint states last taken with the newest of the other topics."""
        for name, topic in self._topics.items():
            message = self._fresh if name == "joints" else topic.take()
            if message is not None:
                self._newest[name] = message
                # A stamp ahead of now, as a step of a clock makes, would hide for as
                # long that the sensor has fallen silent.
                measured_ns = min(self._measured_ns(message, stamp_ns), stamp_ns)
                self._taken_ns[name] = max(measured_ns, self._taken_ns[name])
        is_new, self._fresh = self._fresh is not None, None
        if not is_new:
            self._stamp_ns = max(stamp_ns, self._stamp_ns + 1)
        else:
            self._take_joints(self._newest["joints"], stamp_ns)
        self._taken_ns["joints"] = self._stamp_ns
        self.missing = tuple(
            name
            for name, taken_ns in self._taken_ns.items()
            if stamp_ns - taken_ns > self._max_age_ns
            or (name == "joints" and not is_new)
        )
        imu = self._newest["imu"]
        ages_ns = [
            self._stamp_ns - self._taken_ns.get(name, self._stamp_ns)
            for name in TICK_SENSORS
        ]
        speed = self._settings.clock.speed  # ages count in the robot's time
        measured_ns = [self._stamp_ns - round(age_ns * speed) for age_ns in ages_ns]
        return Snapshot(
            tick=tick,
            stamp_ns=self._stamp_ns,
            q=self._q,
            dq=self._dq,
            effort=self._effort,
            quat_xyzw=_numbers(imu.orientation, "xyzw"),
            angular_velocity=_numbers(imu.angular_velocity),
            linear_acceleration=_numbers(imu.linear_acceleration),
            ft_left=self._wrench("left_ankle_ft"),
            ft_right=self._wrench("right_ankle_ft"),
            measured_ns=tuple(measured_ns),
        )

    def write(self, q_command: Array) -> None:
        """Publish joint positions; the gate has already checked them."""
        numbers = array("d", q_command[self._to_ros].tobytes())
        if self._by_name:
            self._command.position = numbers
            self._command.header.stamp = self._node.get_clock().now().to_msg()
        else:
            self._command.data = numbers
        self._publisher.publish(self._command)

    def _wrench(self, name: str) -> Array:
        """Of the ground on the robot; zeros of an ankle without sensor."""
        if name not in self._topics:
            return np.zeros(6)
        wrench = self._newest[name].wrench
        F = np.concatenate((_numbers(wrench.force), _numbers(wrench.torque)))
        return self._settings.signs[name] * F

    def _measured_ns(self, message: Any, now_ns: int) -> int:
        """When a message was measured, on the monotonic clock."""
        if self._settings.clock.stamps == "receipt":
            return now_ns
        stamp = message.header.stamp
        age_ns = time.time_ns() - (stamp.sec * NS_PER_S + stamp.nanosec)
        return now_ns - age_ns

    def _take_joints(self, message: Any, now_ns: int) -> None:
        measured_ns = self._taken_ns["joints"]
        self.ages.add(now_ns - measured_ns)
        if self._stamp_ns:
            self.periods.add(max(measured_ns - self._stamp_ns, 0))
        # Two readings never share a stamp, whatever steps the robot's clock makes.
        self._stamp_ns = max(measured_ns, self._stamp_ns + 1)
        q = np.array(message.position)[self._from_ros]
        velocity, effort = message.velocity, message.effort
        if velocity:
            self._dq = np.array(velocity)[self._from_ros]
        else:
            self._dq = (q - self._q) / self._robot.period_s
        self._effort = (
            np.array(effort)[self._from_ros] if effort else np.zeros(self._robot.n_a)
        )
        self._q = q

    def _why_not_ours(self, message: Any) -> str:
        """Find the joints of the robot file among those of the message.

        Returns:
            Why they cannot be read there; empty when they can.
        """
        sizes = {part: len(getattr(message, part)) for part in JOINT_STATE}
        layout = (message.name, *sizes.values())
        if layout == self._layout:
            return ""
        topic = self._settings.joint_states.topic
        names = self._settings.ros_names(self._robot)
        absent = [name for name in names if name not in message.name]
        if absent:
            return (
                f"{topic}: no joint {', '.join(absent)}; it has "
                f"{', '.join(message.name)}; say in [joints] what ROS calls them"
            )
        for part, size in sizes.items():
            if size != len(message.name) and (size or part == "position"):
                return (
                    f"{topic}: got {size} numbers of {part} for {len(message.name)} "
                    "names, expected one each"
                )
        self._from_ros = np.array([message.name.index(name) for name in names])
        self._layout = layout
        return ""

    def _wait_for_all(self) -> None:
        limit_s = self._settings.clock.start_s
        end_s = time.monotonic() + limit_s
        why = ""
        while len(self._newest) < len(self._topics):
            for name, topic in self._topics.items():
                message = topic.take()
                if message is None:
                    continue
                why = self._why_not_ours(message) if name == "joints" else why
                if name != "joints" or not why:
                    self._newest[name] = message
            if time.monotonic() > end_s:
                if why and "joints" not in self._newest:
                    raise RobotFileError(why)
                raise RobotUnreachableError(
                    f"{self._describe_silent()}; waited {limit_s:g} s ([clock] start_s)"
                )
            time.sleep(self._robot.period_s)  # take() does not wait
        self._check_first()
        self._fresh = self._newest["joints"]
        self._q = self._robot.nominal
        if not self._publisher.get_subscription_count():
            _LOG.warning(
                "%s: nobody listens yet; is the controller active, and its type %s?",
                *(self._settings.command.topic, self._settings.command.type),
            )

    def _check_first(self) -> None:
        now_ns = time.monotonic_ns()
        for name, message in self._newest.items():
            age_s = (now_ns - self._measured_ns(message, now_ns)) / NS_PER_S
            # Best effort and a slow start: a first message may have waited for us.
            if age_s < -self._settings.clock.max_age_s or age_s > 60.0:
                raise RobotFileError(
                    f"{self._topics[name].name}: its stamp is {age_s:g} s old; the "
                    "clocks of the two computers disagree, or the robot does not "
                    'stamp: keep both by chrony, or set [clock] stamps = "receipt"'
                )
        imu = self._newest["imu"]
        if imu.orientation_covariance[0] < 0.0 or not np.any(
            _numbers(imu.orientation, "xyzw")
        ):
            raise RobotFileError(
                f"{self._settings.imu.topic}: it reports no orientation; put a filter "
                "such as imu_filter_madgwick in between, and name its topic in [imu]"
            )

    def _describe_silent(self) -> str:
        """Word what ROS knows of the silent topics, those of one kind together."""
        reasons: dict[str, list[str]] = {}
        for name, topic in self._topics.items():
            if name not in self._newest:
                reasons.setdefault(self._describe(topic), []).append(topic.name)
        return "; ".join(f"{', '.join(n)}: {why}" for why, n in reasons.items())

    def _describe(self, topic: Topic) -> str:
        """Word what ROS knows of a silent topic."""
        from rclpy.qos import QoSCompatibility, qos_check_compatible

        wanted = f"{topic.kind.__module__.split('.')[0]}/msg/{topic.kind.__name__}"
        found = self._node.get_publishers_info_by_topic(topic.name)
        if not found:
            return (
                "nobody publishes it; is the robot up, and in the same ROS_DOMAIN_ID "
                "and discovery range?"
            )
        if all(info.topic_type != wanted for info in found):
            return f"is {found[0].topic_type}, expected {wanted}"
        for info in found:
            verdict, why = qos_check_compatible(info.qos_profile, topic.qos)
            if verdict == QoSCompatibility.ERROR:
                return f"{why.strip()}; set its reliability in the TOML"
        return "its publisher sends nothing"


def _never(message: object) -> None:
    """Subscriptions need a callback; ours are asked instead."""


def _numbers(value: Any, names: str = "xyz") -> Array:
    return np.array([getattr(value, name) for name in names])


@contextmanager
def ros2_adapter(robot: Robot, settings: Ros2Settings) -> Iterator[Ros2Adapter]:
    """A connected adapter, and what ROS did to the readings told at the end."""
    with ros2_node(settings.node) as node:
        adapter = Ros2Adapter(robot, settings, node)
        try:
            yield adapter
        finally:
            age, period = adapter.ages.distribution(), adapter.periods.distribution()
            _LOG.info(
                "ROS 2: joint states %.3f ms old when read, p99 %.3f, max %.3f; "
                "%.3f ms from one to the next, p99 %.3f, max %.3f",
                *(age.median, age.p99, age.max, period.median, period.p99, period.max),
            )


def main() -> None:
    """Serve the robot until Ctrl-C: endpoint file, ROS 2 file, robot."""
    if len(sys.argv) not in (3, 4):
        raise UsageError("usage: ros2_driver.py ENDPOINTS.toml ROS2.toml [ROBOT]")
    robot = load_robot(sys.argv[3] if len(sys.argv) > 3 else "walker")
    endpoints = load_endpoints(Path(sys.argv[1]))
    with ros2_adapter(robot, load_settings(Path(sys.argv[2]), robot)) as adapter:
        drive(adapter, robot, endpoints=endpoints)


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    complain(main)
