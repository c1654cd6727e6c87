"""The one loader of robots: TOML and URDF, held together and checked.

Simulator and stabilizer build their own models from what this returns, so both
speak of the same joints in the same order.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from robot_io.errors import RobotFileError
from schemas.arrays import Array
from schemas.errors import FileFormatError
from schemas.robot_file import Foot, RobotFile, ServoProfile
from schemas.toml_file import load
from schemas.topics import resolve_keys

ROBOTS_DIR = Path(__file__).parent / "robots"
EFFORT_TOLERANCE_NM = 1e-6


@dataclass(frozen=True)
class Robot:
    """A robot as its files describe it.

    Attributes:
        file: the TOML, typed.
        path: where the TOML stands.
        urdf_path: where the URDF stands.
        keys: channel name to bus key, overrides applied.
        lower: (n_a,) lower end of the joint ranges [rad].
        upper: (n_a,) upper end [rad].
    """

    file: RobotFile
    path: Path
    urdf_path: Path
    keys: dict[str, str]
    lower: Array
    upper: Array

    @property
    def joint_names(self) -> list[str]:
        """Joint names in bus order."""
        return [joint.name for joint in self.file.joint]

    @property
    def n_a(self) -> int:
        """Number of actuated joints."""
        return len(self.file.joint)

    @property
    def period_s(self) -> float:
        """Control period [s]."""
        return 1.0 / self.file.rate_hz

    @property
    def left(self) -> Foot:
        """Left foot."""
        return self.file.foot[0]

    @property
    def right(self) -> Foot:
        """Right foot."""
        return self.file.foot[1]

    @property
    def servo_profile(self) -> ServoProfile:
        """The servo profile in use."""
        return self.file.servo.profiles[self.file.servo.profile]

    @cached_property
    def nominal(self) -> Array:
        """(n_a,) nominal posture [rad]."""
        return self._column("nominal_rad")

    @cached_property
    def kp(self) -> Array:
        """(n_a,) servo stiffness [N m/rad]."""
        return self._column("kp_nm_rad")

    @cached_property
    def kd(self) -> Array:
        """(n_a,) servo damping [N m s/rad]."""
        return self._column("kd_nm_s_rad")

    @cached_property
    def armature(self) -> Array:
        """(n_a,) rotor inertia at the joint [kg m^2]."""
        return self._column("armature_kg_m2")

    @cached_property
    def damping(self) -> Array:
        """(n_a,) passive joint damping [N m s/rad]."""
        return self._column("damping_nm_s_rad")

    @cached_property
    def torque_limit(self) -> Array:
        """(n_a,) [N m]."""
        return self._column("torque_limit_nm")

    @cached_property
    def velocity_limit(self) -> Array:
        """(n_a,) [rad/s]."""
        return self._column("velocity_limit_rad_s")

    def _column(self, name: str) -> Array:
        column = np.array([getattr(joint, name) for joint in self.file.joint])
        column.setflags(write=False)
        return column


def find_robot(name_or_path: str) -> Path:
    """Path of a robot file: a shipped name, or a path to a TOML.

    Raises:
        RobotFileError: there is no such robot; the message lists the shipped ones.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml":
        if path.is_file():
            return path
        raise RobotFileError(f"{path}: no such robot file")
    shipped = ROBOTS_DIR / name_or_path / f"{name_or_path}.toml"
    if shipped.is_file():
        return shipped
    names = sorted(
        p.name for p in ROBOTS_DIR.iterdir() if (p / f"{p.name}.toml").is_file()
    )
    raise RobotFileError(
        f"no robot named {name_or_path!r}; shipped are {', '.join(names)}, "
        "or give the path of a robot file (.toml)"
    )


def load_robot(name_or_path: str, *, servo_profile: str | None = None) -> Robot:
    """Loads a robot by shipped name or path.

    Args:
        name_or_path: ``walker`` or ``path/to/robot.toml``.
        servo_profile: a profile of the file to use instead of its own choice.

    Raises:
        RobotFileError: no such robot, or TOML and URDF contradict each other.
        FileFormatError: the TOML is malformed.
    """
    path = find_robot(name_or_path)
    file = load(path, RobotFile)
    if servo_profile is not None:
        file = _with_profile(file, servo_profile)
    urdf_path = (path.parent / file.urdf).resolve()
    if not urdf_path.is_file():
        raise RobotFileError(f"{path}: urdf: no such file {urdf_path}")
    _check_file(file, path)
    lower, upper = _check_urdf(file, path, urdf_path)
    return Robot(
        file=file,
        path=path.resolve(),
        urdf_path=urdf_path,
        keys=resolve_keys(file.keys),
        lower=lower,
        upper=upper,
    )


def _with_profile(file: RobotFile, profile: str) -> RobotFile:
    import msgspec

    servo = msgspec.structs.replace(file.servo, profile=profile)
    return msgspec.structs.replace(file, servo=servo)


def _check_file(file: RobotFile, path: Path) -> None:
    if [foot.side for foot in file.foot] != ["left", "right"]:
        raise FileFormatError(
            f"{path}: foot: got sides {[foot.side for foot in file.foot]}, "
            "expected left, then right",
            field="foot",
        )
    if file.servo.profile not in file.servo.profiles:
        raise FileFormatError(
            f"{path}: servo.profile: got {file.servo.profile!r}, the file has "
            f"{sorted(file.servo.profiles)}",
            field="servo.profile",
        )
    names = [joint.name for joint in file.joint]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise FileFormatError(f"{path}: joint: listed twice: {twice}", field="joint")


def _check_urdf(file: RobotFile, path: Path, urdf_path: Path) -> tuple[Array, Array]:
    """Compares TOML and URDF and reads the joint ranges."""
    try:
        root = ElementTree.parse(urdf_path).getroot()
    except ElementTree.ParseError as error:
        raise RobotFileError(f"{urdf_path}: not valid XML: {error}") from error
    links = {link.get("name") for link in root.iter("link")}
    wanted = {"base_link": file.base_link, "imu.frame": file.imu.frame}
    for foot in file.foot:
        wanted[f"foot.{foot.side}.sole_frame"] = foot.sole_frame
        wanted[f"foot.{foot.side}.ft_link"] = foot.ft_link
    for key, link in wanted.items():
        if link not in links:
            raise RobotFileError(
                f"{path}: {key}: {urdf_path.name} has no link {link!r}"
            )
    movable = {
        joint.get("name"): joint
        for joint in root.findall("joint")
        if joint.get("type") in ("revolute", "continuous", "prismatic")
    }
    listed = [joint.name for joint in file.joint]
    if set(listed) != set(movable):
        raise RobotFileError(
            f"{path}: joint: not in {urdf_path.name}: "
            f"{sorted(set(listed) - set(movable))}; missing here: "
            f"{sorted(str(n) for n in set(movable) - set(listed))}"
        )
    lower, upper = np.empty(len(listed)), np.empty(len(listed))
    for index, joint in enumerate(file.joint):
        limit = movable[joint.name].find("limit")
        if limit is None or limit.get("lower") is None or limit.get("upper") is None:
            raise RobotFileError(
                f"{urdf_path}: joint {joint.name!r} needs a limit with lower and upper"
            )
        lower[index] = float(limit.get("lower", "nan"))
        upper[index] = float(limit.get("upper", "nan"))
        effort = float(limit.get("effort", "nan"))
        if abs(effort - joint.torque_limit_nm) > EFFORT_TOLERANCE_NM:
            raise RobotFileError(
                f"{path}: joint {joint.name!r}: torque_limit_nm "
                f"{joint.torque_limit_nm} but effort {effort} in {urdf_path.name}; "
                "make them equal"
            )
        if not lower[index] <= joint.nominal_rad <= upper[index]:
            raise RobotFileError(
                f"{path}: joint {joint.name!r}: nominal_rad {joint.nominal_rad} is "
                f"outside [{lower[index]}, {upper[index]}] of {urdf_path.name}"
            )
    lower.setflags(write=False)
    upper.setflags(write=False)
    return lower, upper
