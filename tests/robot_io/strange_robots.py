"""Robots that could be mistaken for the Walker."""

from __future__ import annotations

from pathlib import Path

import msgspec

from surefoot.robot_io.robot import Robot, load_robot, make_robot
from surefoot.schemas.robot_file import RobotFile

WALKER = load_robot("walker")


def _other_side(name: str) -> str:
    for this, other in (("left_", "right_"), ("right_", "left_")):
        if name.startswith(this):
            return other + name.removeprefix(this)
    return name


def changed(**changes: object) -> Robot:
    """Return the Walker with changed entries in its robot file."""
    return remade(msgspec.structs.replace(WALKER.file, **changes))


def remade(file: RobotFile, urdf_path: Path = WALKER.urdf_path) -> Robot:
    return make_robot(file, path=WALKER.path, urdf_path=urdf_path)


def mirrored() -> Robot:
    """Exchange left and right joints and feet."""
    by_name = {joint.name: joint for joint in WALKER.file.joint}
    left, right = WALKER.file.foot
    return changed(
        joint=[by_name[_other_side(joint.name)] for joint in WALKER.file.joint],
        foot=[
            msgspec.structs.replace(right, side="left"),
            msgspec.structs.replace(left, side="right"),
        ],
    )


MIRRORED = mirrored()


def mirrored_feet_file(folder: Path) -> Path:
    """Return a robot file that exchanges the feet."""
    path = folder / "mirrored.toml"
    feet = "".join(
        f'[[foot]]\nside = "{side}"\nsole_frame = "{other}_sole"\n'
        f'ft_link = "{other}_foot_plate"\nhalf_length_m = 0.1357\n'
        "half_width_m = 0.0774\n"
        for side, other in (("left", "right"), ("right", "left"))
    )
    path.write_text(f'extends = "{WALKER.path}"\n{feet}')
    return path
