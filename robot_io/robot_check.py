"""Holds a robot's TOML and URDF together: same links, joints, efforts and soles."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import NamedTuple

import numpy as np

from surefoot.robot_io.errors import RobotFileError
from surefoot.schemas.arrays import Array
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.robot_file import Foot, Joint, RobotFile
from surefoot.schemas.sensors import SENSORS

EFFORT_TOLERANCE_NM = 1e-6
SOLE_TOLERANCE_M = 1e-6
_MOVABLE = ("revolute", "continuous", "prismatic")


class JointRanges(NamedTuple):
    """Ends of the joint ranges, each (n_a,) [rad], read-only."""

    lower: Array
    upper: Array


def check_robot(file: RobotFile, path: Path, urdf_path: Path) -> JointRanges:
    """Compare a robot's TOML with itself and with its URDF.

    Args:
        file: the TOML.
        path: where it stands, for messages.
        urdf_path: the URDF it names.

    Returns:
        The joint ranges of the URDF in the order of the TOML.

    Raises:
        FileFormatError: the TOML contradicts itself.
        RobotFileError: the URDF is broken or says something else than the TOML.
    """
    _check_file(file, path)
    root = _parse(urdf_path)
    _check_links(file, path, root)
    for foot in file.foot:
        _check_sole(foot, path, root)
    movable = _movable_joints(file, path, root)
    ranges = [
        _joint_range(joint, path, movable[joint.name], urdf_path)
        for joint in file.joint
    ]
    bounds = np.array(ranges, dtype=np.float64).T.copy()
    bounds.setflags(write=False)
    return JointRanges(lower=bounds[0], upper=bounds[1])


def _check_file(file: RobotFile, path: Path) -> None:
    sides = [foot.side for foot in file.foot]
    if sides != ["left", "right"]:
        raise FileFormatError(
            f"{path}: foot: got sides {sides}, expected left, then right", field="foot"
        )
    if file.servo.profile not in file.servo.profiles:
        raise FileFormatError(
            f"{path}: servo.profile: got {file.servo.profile!r}, the file has "
            f"{', '.join(sorted(file.servo.profiles))}",
            field="servo.profile",
        )
    names = [joint.name for joint in file.joint]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise FileFormatError(f"{path}: joint: listed twice: {twice}", field="joint")
    lowest, highest = file.com_travel_m
    if not lowest <= 0.0 <= highest:
        raise FileFormatError(
            f"{path}: com_travel_m: got [{lowest}, {highest}], expected how far the "
            "CoM may sink (negative) and rise (positive)",
            field="com_travel_m",
        )
    namespace = file.namespace
    if (
        not namespace.strip("/")
        or any(c in namespace for c in "*$?# ")
        or (namespace != namespace.strip("/"))
    ):
        raise FileFormatError(
            f"{path}: namespace: got {namespace!r}, expected a key such as 'walker' "
            "without wildcards, blanks or outer slashes",
            field="namespace",
        )


def _parse(urdf_path: Path) -> ElementTree.Element:
    try:
        return ElementTree.parse(urdf_path).getroot()
    except OSError as error:
        raise RobotFileError(f"{urdf_path}: cannot be read ({error})") from error
    except ElementTree.ParseError as error:
        raise RobotFileError(f"{urdf_path}: not valid XML: {error}") from error


def _check_links(file: RobotFile, path: Path, root: ElementTree.Element) -> None:
    links = {link.get("name") for link in root.iter("link")}
    wanted = {"base_link": file.base_link}
    wanted |= {entry.frame: entry.link(file) for entry in SENSORS if entry.frame}
    for index, foot in enumerate(file.foot):
        wanted[f"foot[{index}].sole_frame"] = foot.sole_frame
    for key, link in wanted.items():
        if link not in links:
            raise RobotFileError(f"{path}: {key}: {file.urdf} has no link {link!r}")


def _check_sole(foot: Foot, path: Path, root: ElementTree.Element) -> None:
    """Check that the box under the sensor, which touches the ground, is the sole."""
    boxes = root.findall(f"link[@name='{foot.ft_link}']/collision/geometry/box")
    if len(boxes) != 1:
        return
    size = _numbers(boxes[0], "size", 3, f"{foot.ft_link}: collision box")
    for key, half, full in (
        ("half_length_m", foot.half_length_m, size[0]),
        ("half_width_m", foot.half_width_m, size[1]),
    ):
        if abs(2.0 * half - full) > SOLE_TOLERANCE_M:
            raise RobotFileError(
                f"{path}: {foot.side} foot: {key} {half} but the collision box of "
                f"{foot.ft_link!r} has {full / 2.0}; make them equal"
            )


def _movable_joints(
    file: RobotFile, path: Path, root: ElementTree.Element
) -> dict[str, ElementTree.Element]:
    movable = {
        str(joint.get("name")): joint
        for joint in root.findall("joint")
        if joint.get("type") in _MOVABLE
    }
    listed = {joint.name for joint in file.joint}
    if listed != set(movable):
        raise RobotFileError(
            f"{path}: joint: not in {file.urdf}: {sorted(listed - set(movable))}; "
            f"in {file.urdf} but not here: {sorted(set(movable) - listed)}"
        )
    return movable


def _joint_range(
    joint: Joint, path: Path, element: ElementTree.Element, urdf_path: Path
) -> tuple[float, float]:
    limit = element.find("limit")
    if limit is None:
        raise RobotFileError(
            f"{urdf_path}: joint {joint.name!r} has no <limit>, expected one with "
            "lower, upper and effort"
        )
    place = f"{urdf_path}: joint {joint.name!r}: limit"
    lower, upper, effort = (
        _numbers(limit, name, 1, place)[0] for name in ("lower", "upper", "effort")
    )
    if not abs(effort - joint.torque_limit_nm) <= EFFORT_TOLERANCE_NM:
        raise RobotFileError(
            f"{path}: joint {joint.name!r}: torque_limit_nm {joint.torque_limit_nm} "
            f"but effort {effort} in {urdf_path.name}; make them equal"
        )
    if not lower <= joint.nominal_rad <= upper:
        raise RobotFileError(
            f"{path}: joint {joint.name!r}: nominal_rad {joint.nominal_rad} is "
            f"outside [{lower}, {upper}] of {urdf_path.name}"
        )
    _check_soft_range(joint, path, lower=lower, upper=upper)
    return lower, upper


def _check_soft_range(joint: Joint, path: Path, *, lower: float, upper: float) -> None:
    soft_lower = lower if joint.soft_lower_rad is None else joint.soft_lower_rad
    soft_upper = upper if joint.soft_upper_rad is None else joint.soft_upper_rad
    if not lower <= soft_lower <= joint.nominal_rad <= soft_upper <= upper:
        raise RobotFileError(
            f"{path}: joint {joint.name!r}: soft range [{soft_lower}, {soft_upper}] "
            f"must lie inside the joint range [{lower}, {upper}] and hold nominal_rad "
            f"{joint.nominal_rad}"
        )


def _numbers(
    element: ElementTree.Element, name: str, count: int, place: str
) -> list[float]:
    text = element.get(name, "")
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.all(np.isfinite(numbers)):
        raise RobotFileError(f"{place}: {name}: got {text!r}, expected {count} numbers")
    return numbers
