"""Compares a robot's TOML with its URDF: same links, joints, efforts and soles."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.urdf_check import MOVABLE, Urdf
from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.robot_file import Foot, Joint, RobotFile
from surefoot.schemas.sensors import SENSORS
from surefoot.schemas.topics import is_key
from surefoot.schemas.validation import nearest

EFFORT_TOLERANCE_NM = 1e-6
SOLE_TOLERANCE_M = 1e-6
UPRIGHT_TOLERANCE = 1e-6
HEIGHT_SHARE, LEAST_HEIGHT_M = 0.1, 0.1
"""Largest error of the base height: a share of it, and least height for that [m]."""


class UrdfFacts(NamedTuple):
    """Facts from a robot's URDF, in the order of its TOML; read-only.

    For shapes and units see :class:`surefoot.robot_io.robot.Robot`.
    """

    lower: Array
    upper: Array
    sole_normals: Array
    R_upright_base: Mat


def check_robot(file: RobotFile, path: Path, urdf_path: Path) -> UrdfFacts:
    """Compare a robot's TOML with itself and with its URDF.

    Returns:
        The facts of the URDF.

    Raises:
        FileFormatError: the TOML contradicts itself.
        RobotFileError: the URDF is broken or contradicts the TOML.
    """
    _check_file(file, path)
    urdf = Urdf(urdf_path)
    _check_links(file, path, urdf)
    for foot in file.foot:
        _check_foot(foot, path, urdf)
        _check_sole(foot, path, urdf)
    urdf.check_masses()
    movable = _movable_joints(file, path, urdf)
    ranges = [
        _joint_range(joint, path, movable[joint.name], urdf) for joint in file.joint
    ]
    upright = _upright(file, urdf)
    _check_height(file, path, urdf, upright)
    _check_margin(file, path, ranges)
    bounds = np.array(ranges, dtype=np.float64).T.copy()
    normals = np.array([_sole_normal(foot, urdf) for foot in file.foot])
    for array in (bounds, normals, upright):
        array.setflags(write=False)
    return UrdfFacts(
        lower=bounds[0],
        upper=bounds[1],
        sole_normals=normals,
        R_upright_base=upright,
    )


def _check_file(file: RobotFile, path: Path) -> None:
    sides = [foot.side for foot in file.foot]
    if sides != ["left", "right"]:
        raise FileFormatError(
            f"{path}: foot: got sides {sides}, expected left, then right", field="foot"
        )
    if file.servo.profile not in file.servo.profiles:
        raise FileFormatError(
            f"{path}: servo.profile: got {file.servo.profile!r}, the file has "
            f"{', '.join(sorted(file.servo.profiles)) or 'none'}",
            field="servo.profile",
        )
    tick_s = 1.0 / file.rate_hz
    for limit in ("hold_after_s", "max_command_age_s", "max_loop_delay_s", "lease_s"):
        value = getattr(file.gate, limit)
        if value is not None and value < tick_s * (1.0 - 1e-6):
            raise FileFormatError(
                f"{path}: gate.{limit}: got {value:g} s, expected a tick of the robot "
                f"or more ({tick_s:g} s at rate_hz = {file.rate_hz:g}): no command "
                "could be in time",
                field=f"gate.{limit}",
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
    if not is_key(namespace):
        raise FileFormatError(
            f"{path}: namespace: got {namespace!r}, expected a key such as 'walker' "
            "without wildcards, blanks, @, outer or double slashes",
            field="namespace",
        )


def _check_links(file: RobotFile, path: Path, urdf: Urdf) -> None:
    wanted = {"base_link": file.base_link}
    wanted |= {entry.frame: entry.link(file) for entry in SENSORS if entry.frame}
    for index, foot in enumerate(file.foot):
        wanted[f"foot[{index}].sole_frame"] = foot.sole_frame
    for key, link in wanted.items():
        if link not in urdf.links:
            raise RobotFileError(
                f"{path}: {key}: {file.urdf} has no link {link!r}"
                f"{nearest(link, urdf.links)}"
            )
    if file.base_link != urdf.root:
        raise RobotFileError(
            f"{path}: base_link: {file.base_link!r} hangs on a joint; name the link "
            f"that all others hang on, {urdf.root!r}"
        )
    if urdf.fixed_to(file.imu.frame)[-1] != file.base_link:
        raise RobotFileError(
            f"{path}: imu.frame: {file.imu.frame!r} moves against the base "
            f"{file.base_link!r}; name a link that is fixed to it"
        )
    left, right = file.foot
    for key in ("sole_frame", "ft_link"):
        if getattr(left, key) == getattr(right, key):
            raise RobotFileError(
                f"{path}: foot: both feet have the {key} {getattr(left, key)!r}; name "
                "one for each side"
            )


def _check_foot(foot: Foot, path: Path, urdf: Urdf) -> None:
    """Check that the sole is a bare link, fixed below the link of the sensor."""
    place = f"{path}: {foot.side} foot: sole_frame {foot.sole_frame!r}"
    if foot.sole_frame == foot.ft_link:
        raise RobotFileError(
            f"{place} is the ft_link too; give the sole a link of its own, without "
            "mass, fixed below it"
        )
    if foot.ft_link not in urdf.fixed_to(foot.sole_frame):
        is_above = foot.sole_frame in urdf.fixed_to(foot.ft_link)
        how = "stands above" if is_above else "is not fixed below"
        raise RobotFileError(
            f"{place} {how} ft_link {foot.ft_link!r}; the sensor must carry the sole, "
            "with nothing that moves between them"
        )
    mass = urdf.mass_of(foot.sole_frame)
    if mass > 0.0:
        raise RobotFileError(
            f"{place} weighs {mass:g} kg; it must weigh nothing, as what presses on "
            "it would count as its weight: put the mass into ft_link"
        )


def _nominal_soles(file: RobotFile, urdf: Urdf) -> list[tuple[Vec3, Mat]]:
    """Return place [m] and orientation of left and right sole in the base link."""
    posture = {joint.name: joint.nominal_rad for joint in file.joint}
    return [urdf.pose_below_root(foot.sole_frame, posture) for foot in file.foot]


def _upright(file: RobotFile, urdf: Urdf) -> Mat:
    """Return R_upright_base, (3, 3); see :class:`UrdfFacts`."""
    soles = [turned for _, turned in _nominal_soles(file, urdf)]
    z = soles[0][:, 2] + soles[1][:, 2]
    ahead = soles[0][:, 0] + soles[1][:, 0]
    z /= np.linalg.norm(z)
    x = ahead - (ahead @ z) * z
    x /= np.linalg.norm(x)
    upright: Mat = np.vstack((x, np.cross(z, x), z))
    if np.abs(upright - np.eye(3)).max() < UPRIGHT_TOLERANCE:
        upright = np.eye(3)  # no rounding errors of a chain of joints
    return upright


def _check_height(file: RobotFile, path: Path, urdf: Urdf, upright: Mat) -> None:
    """Check that the soles lie as far below the base as the file says."""
    below_m = [-float((upright @ p)[2]) for p, _ in _nominal_soles(file, urdf)]
    mean_m = 0.5 * sum(below_m)
    most_m = HEIGHT_SHARE * max(abs(mean_m), LEAST_HEIGHT_M)
    if abs(mean_m - file.nominal_base_height_m) > most_m:
        raise RobotFileError(
            f"{path}: nominal_base_height_m: got {file.nominal_base_height_m:g}, but "
            f"in the nominal posture the soles of {file.urdf} lie {mean_m:.4g} below "
            f"{file.base_link!r}; are lengths in metres and angles in radians?"
        )


def _sole_normal(foot: Foot, urdf: Urdf) -> Array:
    """Return the upward normal of a sole in its sensor's frame, (3,)."""
    sole, sensor = (
        urdf.pose_below_root(link, {})[1] for link in (foot.sole_frame, foot.ft_link)
    )
    normal: Array = sensor.T @ sole[:, 2]
    return normal


def _check_sole(foot: Foot, path: Path, urdf: Urdf) -> None:
    """Check that a box under the sensor, which touches the ground, equals the sole."""
    boxes = urdf.links[foot.ft_link].findall("collision/geometry/box")
    if len(boxes) != 1:
        return
    size = urdf.vector(boxes[0], "size", f"link {foot.ft_link!r}: collision box")
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
    file: RobotFile, path: Path, urdf: Urdf
) -> dict[str, ElementTree.Element]:
    movable = {
        name: joint
        for name, joint in urdf.joints.items()
        if joint.get("type") in MOVABLE
    }
    listed = {joint.name for joint in file.joint}
    if listed != set(movable):
        raise RobotFileError(
            f"{path}: joint: not in {file.urdf}: {sorted(listed - set(movable))}; "
            f"in {file.urdf} but not here: {sorted(set(movable) - listed)}"
        )
    return movable


def _joint_range(
    joint: Joint, path: Path, element: ElementTree.Element, urdf: Urdf
) -> tuple[float, float]:
    limit = element.find("limit")
    assert limit is not None  # as the URDF was checked
    place = f"joint {joint.name!r}: limit"
    lower, upper, effort = (
        urdf.number(limit, name, place) for name in ("lower", "upper", "effort")
    )
    if not abs(effort - joint.torque_limit_nm) <= EFFORT_TOLERANCE_NM:
        raise RobotFileError(
            f"{path}: joint {joint.name!r}: torque_limit_nm {joint.torque_limit_nm} "
            f"but effort {effort} in {urdf.path.name}; make them equal"
        )
    if not lower <= joint.nominal_rad <= upper:
        raise RobotFileError(
            f"{path}: joint {joint.name!r}: nominal_rad {joint.nominal_rad} is "
            f"outside [{lower}, {upper}] of {urdf.path.name}"
        )
    _check_soft_range(joint, path, lower=lower, upper=upper)
    return lower, upper


def _check_margin(
    file: RobotFile, path: Path, ranges: Sequence[tuple[float, float]]
) -> None:
    """Check that the gate lets the nominal posture pass."""
    margin = file.gate.position_margin_rad
    for joint, (lower, upper) in zip(file.joint, ranges, strict=True):
        if not lower + margin <= joint.nominal_rad <= upper - margin:
            raise RobotFileError(
                f"{path}: gate.position_margin_rad: got {margin:g}, but joint "
                f"{joint.name!r} stands at {joint.nominal_rad:g} rad of [{lower:g}, "
                f"{upper:g}]; expected a margin that the nominal posture keeps"
            )


def _check_soft_range(joint: Joint, path: Path, *, lower: float, upper: float) -> None:
    soft_lower = lower if joint.soft_lower_rad is None else joint.soft_lower_rad
    soft_upper = upper if joint.soft_upper_rad is None else joint.soft_upper_rad
    if not lower <= soft_lower <= joint.nominal_rad <= soft_upper <= upper:
        raise RobotFileError(
            f"{path}: joint {joint.name!r}: soft range [{soft_lower}, {soft_upper}] "
            f"must lie inside the joint range [{lower}, {upper}] and hold nominal_rad "
            f"{joint.nominal_rad}"
        )
