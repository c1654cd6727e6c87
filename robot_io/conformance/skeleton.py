"""What a conformance check says, and how one is made."""

from __future__ import annotations

import msgspec
import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.urdf_check import Urdf, rotation
from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.robot_file import Foot

GRAVITY_M_S2 = 9.81


class CheckResult(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the run."""

    name: str
    """What was checked, such as ``imu.gravity``."""
    passed: bool
    got: str
    """What was seen."""
    expected: str
    """What should have been."""


class ConformanceReport(msgspec.Struct, frozen=True, kw_only=True):
    """A whole run."""

    robot: str
    passed: bool
    """Whether every finding did."""
    findings: list[CheckResult]


class RunBrokenOffError(Exception):
    """Nothing further can be checked; the last finding says why."""


class Findings:
    """Collects findings in the order of the run."""

    def __init__(self) -> None:
        """Start empty."""
        self.all: list[CheckResult] = []

    def add(self, name: str, passed: bool, *, got: str, expected: str) -> bool:
        """Note a finding; returns whether it passed."""
        passed = bool(passed)
        self.all.append(
            CheckResult(name=name, passed=passed, got=got, expected=expected)
        )
        return passed

    def need(self, name: str, passed: bool, *, got: str, expected: str) -> None:
        """Note a finding that the rest depends on.

        Raises:
            RunBrokenOffError: it did not pass.
        """
        if not self.add(name, passed, got=got, expected=expected):
            raise RunBrokenOffError(name)


class Skeleton:
    """Reads masses and joint chains from a robot's URDF.

    Attributes:
        mass_kg: of the whole robot.
    """

    def __init__(self, robot: Robot) -> None:
        """Read the URDF, which the loader has checked."""
        self._robot, self._urdf = robot, Urdf(robot.urdf_path)
        self.mass_kg = sum(map(self._urdf.mass_of, self._urdf.links))

    def mass_below_sensor_kg(self, foot: Foot) -> float:
        """Return the mass below a foot's sensor, which the sensor does not carry."""
        return sum(
            self._urdf.mass_of(link)
            for link in self._urdf.links
            if foot.ft_link in self._urdf.up(link)
        )

    def sole_height_rates(self, foot: Foot, q: Array) -> Array:
        """Return the derivative of a sole's height by each joint, the base upright.

        Args:
            foot: which one.
            q: (n_a,) [rad].

        Returns:
            (n_a,) dz/dq, zero for joints outside the leg [m/rad].
        """
        robot = self._robot
        index = {name: i for i, name in enumerate(robot.joint_names)}
        turned, p = np.eye(3), np.zeros(3)
        moved: list[tuple[int, Vec3, Vec3]] = []
        for link in reversed(self._urdf.up(foot.sole_frame)):
            joint = self._urdf.joint_above(link)
            if joint is None:
                continue
            offset, turn = self._urdf.origin(joint)
            p, turned = p + turned @ offset, turned @ turn
            i = index.get(str(joint.get("name")))
            if i is not None:
                axis = self._urdf.axis(joint)
                moved.append((i, turned @ axis, p.copy()))
                turned = turned @ rotation(axis, float(q[i]))
        rates = np.zeros(robot.n_a)
        for i, axis_in_base, p_joint in moved:
            rates[i] = robot.R_upright_base[2] @ np.cross(axis_in_base, p - p_joint)
        return rates
