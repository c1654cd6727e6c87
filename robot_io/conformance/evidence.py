"""Evidence of the conformance checks: sensor recordings, URDF data and findings."""

from __future__ import annotations

from typing import Any, NamedTuple

import msgspec
import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.urdf_check import Urdf
from surefoot.schemas.arrays import Array
from surefoot.schemas.codec import decode
from surefoot.schemas.errors import MessageError
from surefoot.schemas.robot_file import Foot
from surefoot.schemas.topics import TICK_SENSORS, topic


class CheckResult(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the run."""

    name: str
    """Name of the check, such as ``imu.gravity``."""
    passed: bool
    got: str
    """What was observed."""
    expected: str
    """What should have been observed."""


class ConformanceReport(msgspec.Struct, frozen=True, kw_only=True):
    """All results of a run."""

    robot: str
    passed: bool
    """Whether every finding passed."""
    findings: list[CheckResult]


class RunBrokenOffError(Exception):
    """Nothing further can be checked; the last finding says why."""


class Findings:
    """Collects findings in the order of the run."""

    def __init__(self) -> None:
        """Start empty."""
        self.all: list[CheckResult] = []

    def add(self, name: str, passed: bool, *, got: str, expected: str) -> bool:
        """Record a finding; return whether it passed."""
        passed = bool(passed)
        self.all.append(
            CheckResult(name=name, passed=passed, got=got, expected=expected)
        )
        return passed

    def need(self, name: str, passed: bool, *, got: str, expected: str) -> None:
        """Record a finding that all later checks depend on.

        Raises:
            RunBrokenOffError: the finding did not pass.
        """
        if not self.add(name, passed, got=got, expected=expected):
            raise RunBrokenOffError(name)


class Skeleton:
    """Reads masses and joint chains from a robot's URDF."""

    def __init__(self, robot: Robot) -> None:
        """Read the URDF, which the loader has checked."""
        self._robot, self._urdf = robot, Urdf(robot.urdf_path)
        self.mass_kg = sum(map(self._urdf.mass_of, self._urdf.links))

    def mass_below_sensor_kg(self, foot: Foot) -> float:
        """Return the mass below a foot's sensor, not carried by the sensor [kg]."""
        return sum(
            self._urdf.mass_of(link)
            for link in self._urdf.links
            if foot.ft_link in self._urdf.up(link)
        )

    def sole_height_rates(self, foot: Foot, q: Array) -> Array:
        """Return the derivative of a sole's height by each joint, the base upright.

        Args:
            foot: the foot of the sole.
            q: (n_a,) joint positions [rad].

        Returns:
            (n_a,) dz/dq [m/rad], zero for joints outside the leg.
        """
        from scipy.optimize import approx_fprime

        robot = self._robot

        def height(q: Array) -> float:
            posture = dict(zip(robot.joint_names, q.tolist(), strict=True))
            place, _ = self._urdf.pose_below_root(foot.sole_frame, posture)
            return float(robot.R_upright_base[2] @ place)

        rates: Array = approx_fprime(q, height)
        return rates


class Read(NamedTuple):
    """Messages read from one channel.

    Attributes:
        messages: readable messages in order of arrival.
        malformed: number of unreadable messages.
        error: what was wrong with the last unreadable one.
    """

    messages: list[Any]
    malformed: int
    error: str


class Recording:
    """Sensor messages by channel, in order of arrival.

    They are decoded only on request. A busy computer could not decode all of them in
    time while the robot waits for an answer.
    """

    def __init__(self, *, joint_count: int) -> None:
        """Begin empty."""
        self._joint_count = joint_count
        self._payloads: dict[str, list[bytes]] = {name: [] for name in TICK_SENSORS}
        self._read: dict[str, Read] = {}

    def add(self, channel: str, payload: bytes) -> None:
        """Keep a message, undecoded."""
        self._payloads[channel].append(payload)

    def read(self, channel: str) -> Read:
        """Decode all messages of a channel; nothing more may be added to it."""
        if channel not in self._read:
            messages, malformed, error = [], 0, ""
            kind = topic(channel).message
            for payload in self._payloads[channel]:
                try:
                    messages.append(
                        decode(payload, kind, joint_count=self._joint_count)
                    )
                except MessageError as why:
                    malformed, error = malformed + 1, str(why)
            self._read[channel] = Read(messages, malformed, error)
        return self._read[channel]

    def column(self, channel: str, name: str) -> Array:
        """Return one field of a channel's messages: (messages,) or (messages, size)."""
        return np.array([getattr(m, name) for m in self.read(channel).messages])

    def mean(self, channel: str, name: str) -> Array:
        """Return the mean of one field over the recording."""
        mean: Array = self.column(channel, name).mean(axis=0)
        return mean
