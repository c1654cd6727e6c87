"""Identity of a robot: the instance of its process and a digest of its description.

The digest covers everything that both sides must agree on, from all the robot's files.
It consists of parts, so that two different digests show what differs.
"""

from __future__ import annotations

import hashlib
import json
import secrets
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec
import numpy as np

from surefoot.robot_io.errors import RobotMismatchError
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.urdf_check import INERTIA
from surefoot.schemas.arrays import Array
from surefoot.schemas.topics import ALIVE_ROBOT

SAME_FILE = (
    "give both sides the same robot file and servo profile (--robot, --servo-profile)"
)
UNKNOWN = "version of Surefoot"
"""Name for the difference when a digest has other parts than ours."""
_INSTANCE_BYTES = 4
_HASH_DIGITS = 8
_SEPARATOR = "-"


class RobotIdentity(NamedTuple):
    """Identity of a robot on the bus.

    Attributes:
        instance: name of the process; new at every start. Empty if the robot does not
            report it.
        description: digest of the robot's files, see :func:`describe`.
    """

    instance: str
    description: str

    @property
    def token(self) -> str:
        """Key of the liveliness token, relative to the namespace."""
        return f"{ALIVE_ROBOT}/{self.instance}/{self.description}"


def new_identity(robot: Robot) -> RobotIdentity:
    """Return the identity of a robot process that starts now."""
    return RobotIdentity(secrets.token_hex(_INSTANCE_BYTES), describe(robot))


def parse_token(key: str) -> RobotIdentity:
    """Return the identity in a robot's liveliness token.

    Args:
        key: with or without the namespace; parts that it lacks are left empty.
    """
    told = key.rpartition(ALIVE_ROBOT)[2].strip("/").split("/")
    return RobotIdentity(told[0], told[1] if len(told) > 1 else "")


def describe(robot: Robot) -> str:
    """Return the digest of everything that both sides of the bus must agree on.

    The same robot has the same digest on every machine: SHA-256 over JSON with shortest
    numbers, cut to eight hexadecimal digits per part. Comments, pictures and collision
    shapes of the URDF do not count. Values that only one side uses do not count either:
    limits of the gate, soft joint ranges, the travel of the CoM.

    Returns:
        One word with the hashes of :data:`PARTS` in order, fit for a chunk of a key.
    """
    return _SEPARATOR.join(_hash(content(robot)) for content in _CONTENT.values())


def differing(ours: str, theirs: str) -> list[str]:
    """Return the names of the parts in which two descriptions differ; may be empty."""
    told = theirs.split(_SEPARATOR)
    if len(told) != len(PARTS):
        return [UNKNOWN]
    pairs = zip(PARTS, ours.split(_SEPARATOR), told, strict=True)
    return [name for name, our, their in pairs if our != their]


def check_description(robot: Robot, ours: str, theirs: str) -> None:
    """Compare the description of a robot on the bus with our own.

    Raises:
        RobotMismatchError: they differ; the message names the parts.
    """
    parts = differing(ours, theirs)
    if not parts:
        return
    namespace = robot.file.namespace
    if parts == [UNKNOWN]:
        raise RobotMismatchError(
            f"the robot {namespace!r} on the bus does not tell its description as this "
            f"version of Surefoot does: got {theirs or 'nothing'}, expected "
            f"{len(PARTS)} hashes; use the same version on both sides"
        )
    raise RobotMismatchError(
        f"the robot {namespace!r} on the bus is not ours: its robot description "
        f"differs in: {', '.join(parts)}; {SAME_FILE}"
    )


def _limits(robot: Robot) -> Any:
    arrays = robot.lower, robot.upper, robot.velocity_limit, robot.torque_limit
    return _by_joint(robot, *arrays)


def _posture(robot: Robot) -> Any:
    return [robot.file.nominal_base_height_m, _by_joint(robot, robot.nominal)]


def _feet(robot: Robot) -> Any:
    feet = [msgspec.to_builtins(foot) for foot in robot.file.foot]
    virtual = robot.file.virtual_ft
    return feet if virtual is None else [*feet, msgspec.to_builtins(virtual)]


def _servo(robot: Robot) -> Any:
    return [
        robot.file.servo.profile,
        msgspec.to_builtins(robot.servo_profile),
        _by_joint(robot, robot.kp, robot.kd, robot.armature, robot.damping),
    ]


def _by_joint(robot: Robot, *columns: Array) -> dict[str, list[float]]:
    """Return rows by joint name, so that another order changes only ``joints``."""
    rows = np.stack(columns, axis=1).tolist()
    return dict(zip(robot.joint_names, rows, strict=True))


def _model(robot: Robot) -> Any:
    """Return links with their inertia and joints with their place, by name."""
    root = ElementTree.parse(robot.urdf_path).getroot()
    return [
        robot.file.base_link,
        sorted((_link(link) for link in root.findall("link")), key=_name),
        sorted((_joint(joint) for joint in root.findall("joint")), key=_name),
    ]


def _name(entry: list[Any]) -> str:
    return str(entry[0])


def _link(link: ElementTree.Element) -> list[Any]:
    inertial = link.find("inertial")
    if inertial is None:
        return [link.get("name")]
    inertia = inertial.find("inertia")
    return [
        link.get("name"),
        _origin(inertial),
        _words(inertial.find("mass"), "value", "0"),
        {name: _words(inertia, name, "0") for name in INERTIA},
    ]


def _joint(joint: ElementTree.Element) -> list[Any]:
    kind = joint.get("type")
    return [
        joint.get("name"),
        kind,
        *(_attribute(joint.find(end), "link") for end in ("parent", "child")),
        _origin(joint),
        [] if kind == "fixed" else _words(joint.find("axis"), "xyz", "1 0 0"),
        _attribute(joint.find("mimic"), "joint"),
    ]


def _origin(element: ElementTree.Element) -> list[Any]:
    origin = element.find("origin")
    return [_words(origin, name, "0 0 0") for name in ("xyz", "rpy")]


def _attribute(element: ElementTree.Element | None, name: str) -> str:
    return "" if element is None else element.get(name, "")


def _words(element: ElementTree.Element | None, name: str, absent: str) -> list[Any]:
    """Return the words of an attribute; numbers as floats, however written."""
    text = absent if element is None else element.get(name, absent)
    return [_number(word) for word in text.split()]


def _number(word: str) -> float | str:
    try:
        return float(word)
    except ValueError:
        return word


_CONTENT: dict[str, Callable[[Robot], Any]] = {
    "joints": lambda robot: robot.joint_names,
    "limits": _limits,
    "rate": lambda robot: robot.file.rate_hz,
    "posture": _posture,
    "feet": _feet,
    "imu": lambda robot: msgspec.to_builtins(robot.file.imu),
    "servo": _servo,
    "keys": lambda robot: robot.keys,
    "model": _model,
}
PARTS = tuple(_CONTENT)
"""Names of the parts of a description, in the order of the digest."""


def _hash(content: Any) -> str:
    text = json.dumps(_positive_zero(content), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:_HASH_DIGITS]


def _positive_zero(content: Any) -> Any:
    """Return the content with 0.0 for -0.0: equal numbers, but different texts."""
    if isinstance(content, dict):
        return {name: _positive_zero(value) for name, value in content.items()}
    if isinstance(content, list | tuple):
        return [_positive_zero(value) for value in content]
    return content + 0.0 if isinstance(content, float) else content
