"""What a conformance run must know of a robot's body: masses, and legs."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.schemas.robot_file import Foot

GRAVITY_M_S2 = 9.81


class Skeleton:
    """Reads masses and joint chains from a robot's URDF.

    Attributes:
        mass_kg: of the whole robot.
    """

    def __init__(self, robot: Robot) -> None:
        """Read the URDF, which the loader has checked."""
        root = ElementTree.parse(robot.urdf_path).getroot()
        self._robot = robot
        self._joints = {_child(joint): joint for joint in root.findall("joint")}
        self._masses = {
            str(link.get("name")): float(mass.get("value", "0"))
            for link in root.findall("link")
            if (mass := link.find("inertial/mass")) is not None
        }
        self.mass_kg = sum(self._masses.values())

    def mass_below_sensor_kg(self, foot: Foot) -> float:
        """Return the mass below a foot's sensor, which the sensor does not carry."""
        return sum(
            mass
            for link, mass in self._masses.items()
            if foot.ft_link in self._up(link)
        )

    def sole_height_rates(self, foot: Foot, q: Array) -> Array:
        """Return the derivative of a sole's height in the base frame by each joint.

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
        for link in reversed(self._up(foot.sole_frame)):
            joint = self._joints.get(link)
            if joint is None:
                continue
            offset, turn = _origin(joint)
            p, turned = p + turned @ offset, turned @ turn
            i = index.get(str(joint.get("name")))
            if i is not None:
                axis = _numbers(joint.find("axis"), "xyz", "1 0 0")
                moved.append((i, turned @ axis, p.copy()))
                turned = turned @ _rotation(axis, float(q[i]))
        rates = np.zeros(robot.n_a)
        for i, axis_in_base, p_joint in moved:
            rates[i] = np.cross(axis_in_base, p - p_joint)[2]
        return rates

    def _up(self, link: str) -> list[str]:
        """Return a link and all links above it."""
        chain = [link]
        while (joint := self._joints.get(chain[-1])) is not None:
            parent = joint.find("parent")
            assert parent is not None
            chain.append(str(parent.get("link")))
        return chain


def _child(joint: ElementTree.Element) -> str:
    child = joint.find("child")
    assert child is not None
    return str(child.get("link"))


def _numbers(element: ElementTree.Element | None, name: str, default: str) -> Vec3:
    text = default if element is None else element.get(name, default)
    return np.array([float(word) for word in text.split()])


def _origin(joint: ElementTree.Element) -> tuple[Vec3, Mat]:
    origin = joint.find("origin")
    roll, pitch, yaw = _numbers(origin, "rpy", "0 0 0")
    turn = (
        _rotation(np.array([0.0, 0.0, 1.0]), yaw)
        @ _rotation(np.array([0.0, 1.0, 0.0]), pitch)
        @ _rotation(np.array([1.0, 0.0, 0.0]), roll)
    )
    return _numbers(origin, "xyz", "0 0 0"), turn


def _rotation(axis: Vec3, angle: float) -> Mat:
    """Return a rotation by Rodrigues' formula."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: Mat = np.eye(3) + np.sin(angle) * cross
    turned += (1.0 - np.cos(angle)) * (cross @ cross)
    return turned
