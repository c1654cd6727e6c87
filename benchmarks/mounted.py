"""The Walker with other frames of sensors and base; its body stays the same.

Frames are turned and shifted in its URDF; joints and links may be listed in another
order. The content of a moved frame stays in its place.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin

from surefoot.robot_io.robot import find_robot, load_robot

JOINT = "[[joint]]\n"
_PLACED = ("inertial", "visual", "collision")


def placement(
    xyz: tuple[float, float, float], rpy: tuple[float, float, float]
) -> pin.SE3:
    """Return a frame in the one it replaces: position [m], fixed-axis angles [rad]."""
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))


@dataclass(frozen=True)
class Drawing:
    """New frames, each given in the Walker's frame of the same name.

    Attributes:
        base: of the floating link.
        imu: of the inertial unit.
        feet: of the left and the right force-torque sensor.
    """

    base: pin.SE3 = field(default_factory=pin.SE3.Identity)
    imu: pin.SE3 = field(default_factory=pin.SE3.Identity)
    feet: tuple[pin.SE3, pin.SE3] = field(
        default_factory=lambda: (pin.SE3.Identity(), pin.SE3.Identity())
    )


def write_mounted(
    folder: Path,
    drawing: Drawing,
    *,
    joints: Sequence[int] | None = None,
    elements: Sequence[int] | None = None,
) -> Path:
    """Write robot file and URDF of such a robot; return the robot file's path.

    Args:
        folder: gets the files, which have its name.
        drawing: the new frames.
        joints: the Walker's joints in the new order; None for the old order.
        elements: elements of the URDF, likewise.
    """
    walker, name = load_robot("walker"), folder.name
    tree = ElementTree.parse(walker.urdf_path)
    root = tree.getroot()
    _move_frame(root, walker.file.base_link, drawing.base)
    _move_frame(root, walker.file.imu.frame, drawing.imu)
    for foot, moved in zip(walker.file.foot, drawing.feet, strict=True):
        _move_frame(root, foot.ft_link, moved)
    if elements is not None:
        root[:] = [root[i] for i in elements]
    tree.write(folder / f"{name}.urdf")
    head, *each = find_robot("walker").read_text().split(JOINT)
    height = walker.file.nominal_base_height_m
    head = head.replace('"walker.urdf"', f'"{name}.urdf"').replace(
        f"nominal_base_height_m = {height}",
        f"nominal_base_height_m = {height + drawing.base.translation[2]}",
    )
    order = range(len(each)) if joints is None else joints
    path = folder / f"{name}.toml"
    path.write_text(JOINT.join([head, *(each[i].strip() + "\n" for i in order)]))
    return path


def _move_frame(root: ElementTree.Element, link: str, moved: pin.SE3) -> None:
    """Give a link another frame, and leave its content in its place.

    Args:
        root: root of the URDF.
        link: name of the link; it is the base, or fixed to its parent.
        moved: the new frame in the old one.
    """
    (body,) = root.findall(f"link[@name='{link}']")
    back = moved.inverse()
    inside = [part for kind in _PLACED for part in body.findall(kind)]
    inside += root.findall(f"joint/parent[@link='{link}']/..")
    for part in inside:
        _write_origin(part, back * _read_origin(part))
    for joint in root.findall(f"joint/child[@link='{link}']/.."):
        assert joint.get("type") == "fixed", "its axis would have to turn along"
        _write_origin(joint, _read_origin(joint) * moved)


def _read_origin(element: ElementTree.Element) -> pin.SE3:
    origin = element.find("origin")
    given = {} if origin is None else origin.attrib
    xyz, rpy = (
        np.array(given.get(name, "0 0 0").split(), dtype=float)
        for name in ("xyz", "rpy")
    )
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _write_origin(element: ElementTree.Element, pose: pin.SE3) -> None:
    origin = element.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(element, "origin")
    for name, values in (
        ("xyz", pose.translation),
        ("rpy", pin.rpy.matrixToRpy(pose.rotation)),
    ):
        origin.set(name, " ".join(repr(float(value)) for value in values))
