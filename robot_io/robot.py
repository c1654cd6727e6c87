"""Loads a robot from its files: TOML, URDF and the offsets of its ankle sensors.

The offsets are in a file beside the robot file. The robot's driver subtracts them
before readings enter the bus, so stabilizer, recorder and checks never see them. The
simulated robot takes its offsets from the scenario and has no such file.

Simulator and stabilizer both build their models from :class:`Robot`, so they use the
same joints in the same order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
import tomli_w

from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.robot_check import check_robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array, Mat, Vec6
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.robot_file import Foot, RobotFile, ServoProfile, Side
from surefoot.schemas.toml_file import (
    FileStruct,
    atomic_file,
    convert,
    find_toml,
    read_toml,
)
from surefoot.schemas.topics import resolve_keys
from surefoot.schemas.validation import nearest

Offsets = Annotated[list[float], msgspec.Meta(min_length=6, max_length=6)]
EXTENDS = "extends"
"""Key of a robot file: path of the file that it changes, relative to its own."""


class Tare(FileStruct, frozen=True, kw_only=True):
    """Offsets of both ankle sensors, [force; moment] in the sensor's own frame."""

    left: Offsets = msgspec.field(default_factory=lambda: [0.0] * 6)
    """Left ankle [N, N m]."""
    right: Offsets = msgspec.field(default_factory=lambda: [0.0] * 6)
    """Right ankle [N, N m]."""
    robot: str = ""
    """Name of the robot."""
    measured_on: str = ""
    """Day of the last measurement."""
    instance: str = ""
    """The robot's process at the last measurement."""
    left_in_use: Offsets = msgspec.field(default_factory=lambda: [0.0] * 6)
    """Offsets that this process subtracts, as read at its start: left [N, N m]."""
    right_in_use: Offsets = msgspec.field(default_factory=lambda: [0.0] * 6)
    """The same for the right ankle [N, N m]."""

    @property
    def is_zero(self) -> bool:
        """Whether there is nothing to subtract."""
        return not any((*self.left, *self.right))

    def measured(
        self, found: dict[Side, Vec6], *, robot: str, instance: str, day: str
    ) -> Tare:
        """Return the offsets updated by a new measurement.

        The measurement found the offsets that the robot's process does not subtract.
        That process subtracts the offsets of its start, however often it is measured.

        Args:
            found: remaining offsets by side, of each measured foot [N, N m].
            robot: name of the robot.
            instance: the robot's process.
            day: day of the measurement.
        """
        is_same = instance == self.instance
        in_use = {
            "left": self.left_in_use if is_same else self.left,
            "right": self.right_in_use if is_same else self.right,
        }
        new = {
            side: (np.array(in_use[side]) + extra).round(4).tolist()
            for side, extra in found.items()
        }
        return Tare(
            left=new.get("left", self.left),
            right=new.get("right", self.right),
            robot=robot,
            measured_on=day,
            instance=instance,
            left_in_use=in_use["left"],
            right_in_use=in_use["right"],
        )

    def taken_off(self, snapshot: Snapshot) -> Snapshot:
        """Return a reading with the offsets subtracted."""
        if self.is_zero:
            return snapshot
        return replace(
            snapshot,
            ft_left=snapshot.ft_left - np.array(self.left),
            ft_right=snapshot.ft_right - np.array(self.right),
        )


def tare_path(robot_path: Path) -> Path:
    """Return the path of the offsets file of a robot."""
    return robot_path.with_name(f"{robot_path.stem}.tare.toml")


def load_tare(robot_path: Path) -> Tare:
    """Read the offsets beside a robot file; zero when there is no such file.

    Raises:
        FileFormatError: the file is malformed.
    """
    path = tare_path(robot_path)
    if not path.exists():
        return Tare()
    return convert(read_toml(path), Tare, source=str(path))


def save_tare(robot_path: Path, tare: Tare, *, overwrite: bool = True) -> Path:
    """Write the offsets, all at once or not at all; return the path.

    Args:
        robot_path: of the robot file that they stand beside.
        tare: the offsets.
        overwrite: in place of those that are there, which stay otherwise.

    Raises:
        OSError: the file cannot be written.
    """
    path = tare_path(robot_path)
    if path.exists() and not overwrite:
        return path
    with atomic_file(path) as file:
        tomli_w.dump(msgspec.to_builtins(tare), file)
    return path


ROBOTS_DIR = Path(__file__).parent / "robots"


@dataclass(frozen=True)
class Robot:
    """A robot, as its files describe it.

    Attributes:
        file: the typed TOML.
        path: path of the TOML.
        urdf_path: path of the URDF.
        keys: bus key of each channel, with overrides applied.
        lower: (n_a,) lower end of the joint ranges [rad].
        upper: (n_a,) upper end of the joint ranges [rad].
        sole_normals: (2, 3) upward normal of each sole, in its force sensor's frame.
        R_upright_base: (3, 3) rotation from the base link in the nominal posture to a
            frame with z up and x forward along the soles.
    """

    file: RobotFile
    path: Path
    urdf_path: Path
    keys: dict[str, str]
    lower: Array
    upper: Array
    sole_normals: Array
    R_upright_base: Mat

    def __repr__(self) -> str:
        """Return a short text; the file's content would fill pages."""
        file = self.file
        return (
            f"<Robot {file.name}: {self.n_a} joints, {file.rate_hz:g} Hz, "
            f"{file.servo.profile}>"
        )

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
        """(n_a,) joint torque limits [N m]."""
        return self._column("torque_limit_nm")

    @cached_property
    def velocity_limit(self) -> Array:
        """(n_a,) joint velocity limits [rad/s]."""
        return self._column("velocity_limit_rad_s")

    @cached_property
    def command_reach(self) -> Array:
        """(n_a,) largest change of a command from one tick to the next [rad]."""
        by_speed = self.velocity_limit * self.period_s
        reach: Array = np.minimum(by_speed, self.file.gate.step_limit_rad)
        return reach

    @cached_property
    def soft_lower(self) -> Array:
        """(n_a,) lower end of the ranges that the controller uses [rad]."""
        return self._soft("soft_lower_rad", self.lower)

    @cached_property
    def soft_upper(self) -> Array:
        """(n_a,) upper end of the ranges that the controller uses [rad]."""
        return self._soft("soft_upper_rad", self.upper)

    def _soft(self, name: str, hard: Array) -> Array:
        wanted = [getattr(joint, name) for joint in self.file.joint]
        pairs = zip(wanted, hard, strict=True)
        limits = np.array([own if soft is None else soft for soft, own in pairs])
        clipped: Array = np.clip(limits, self.lower, self.upper)
        clipped.setflags(write=False)
        return clipped

    def _column(self, name: str) -> Array:
        column = np.array([getattr(joint, name) for joint in self.file.joint])
        column.setflags(write=False)
        return column


def list_robots() -> list[str]:
    """Return the names of the shipped robots, sorted."""
    return sorted(
        p.name for p in ROBOTS_DIR.iterdir() if (p / f"{p.name}.toml").is_file()
    )


def find_robot(name_or_path: str | Path) -> Path:
    """Return the path of a robot file, given a shipped name or a path.

    Raises:
        RobotFileError: there is no such robot; the message lists the shipped ones.
    """
    shipped = {name: ROBOTS_DIR / name / f"{name}.toml" for name in list_robots()}
    return find_toml(name_or_path, shipped, what="robot", error=RobotFileError)


def load_robot(name_or_path: str | Path, *, servo_profile: str | None = None) -> Robot:
    """Load a robot by shipped name or path.

    Args:
        name_or_path: ``walker`` or ``path/to/robot.toml``.
        servo_profile: a profile of the file to use instead of its own choice.

    Raises:
        RobotFileError: no such robot, or TOML and URDF contradict each other.
        FileFormatError: the TOML is malformed.
    """
    path = find_robot(name_or_path)
    file, urdf_folder = _read(path)
    if servo_profile is not None:
        file = with_servo_profile(file, servo_profile, path=path)
    urdf_path = urdf_folder / file.urdf
    if not urdf_path.is_file():
        raise RobotFileError(f"{path}: urdf: no such file: {urdf_path}")
    return make_robot(file, path=path, urdf_path=urdf_path)


def with_servo_profile(file: RobotFile, profile: str, *, path: Path) -> RobotFile:
    """Return a robot file with another choice among its servo profiles.

    Raises:
        FileFormatError: the file has no such profile.
    """
    if profile not in file.servo.profiles:
        raise FileFormatError(
            f"--servo-profile: got {profile!r}{nearest(profile, file.servo.profiles)}; "
            f"{path} has {', '.join(sorted(file.servo.profiles)) or 'none'}",
            field="servo.profile",
        )
    servo = msgspec.structs.replace(file.servo, profile=profile)
    return msgspec.structs.replace(file, servo=servo)


def make_robot(file: RobotFile, *, path: Path, urdf_path: Path) -> Robot:
    """Make a robot from a robot file already read; check it against its URDF.

    Args:
        file: resolved: extensions merged, servo profile chosen.
        path: path of the file, for messages.
        urdf_path: path of its URDF.

    Raises:
        RobotFileError: TOML and URDF contradict each other.
        FileFormatError: the TOML contradicts itself.
    """
    facts = check_robot(file, path, urdf_path)
    return Robot(
        file=file,
        path=path.resolve(),
        urdf_path=urdf_path.resolve(),
        keys=_bus_keys(file, path),
        lower=facts.lower,
        upper=facts.upper,
        sole_normals=facts.sole_normals,
        R_upright_base=facts.R_upright_base,
    )


def _read(path: Path) -> tuple[RobotFile, Path]:
    """Read the file merged over the one it extends; return it and the URDF's folder."""
    table = read_toml(path)
    folder = path.parent
    if EXTENDS in table:
        below = table.pop(EXTENDS)
        if not isinstance(below, str):
            raise FileFormatError(
                f"{path}: {EXTENDS}: got {below!r}, expected the path of a robot file, "
                "relative to this one, or the name of a shipped robot",
                field=EXTENDS,
            )
        table, folder = _extended(path, table, below=extended_file(path, below))
    return convert(table, RobotFile, source=str(path)), folder


def extended_file(path: Path, below: str) -> Path:
    """Return the robot file that another one names under ``extends``.

    Args:
        path: the file that extends.
        below: a path relative to it, or else the name of a shipped robot.
    """
    near = path.parent / below
    is_shipped = not near.exists() and below in list_robots()
    return find_robot(below) if is_shipped else near


def _extended(
    path: Path, table: dict[str, Any], *, below: Path
) -> tuple[dict[str, Any], Path]:
    """Lay a table over another file's; return it with the folder of its URDF."""
    try:
        base = read_toml(below)
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {EXTENDS}: {error}", field=EXTENDS) from error
    if below.samefile(path):
        raise FileFormatError(
            f"{path}: {EXTENDS}: names this file itself; name the one that it changes",
            field=EXTENDS,
        )
    if EXTENDS in base:
        raise FileFormatError(
            f"{path}: {EXTENDS}: {below} itself extends another file; extend that one",
            field=EXTENDS,
        )
    return _merged(base, table), path.parent if "urdf" in table else below.parent


def _merged(below: Any, above: Any) -> Any:
    """Merge tables, and those in them; all else is replaced."""
    if not (isinstance(below, dict) and isinstance(above, dict)):
        return above
    laid = {name: _merged(below.get(name), value) for name, value in above.items()}
    return {**below, **laid}


def _bus_keys(file: RobotFile, path: Path) -> dict[str, str]:
    try:
        return resolve_keys(file.keys)
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}", field=error.field) from error
