"""Finds soles, force-torque sensors and the IMU in a URDF."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from surefoot.robot_files.clean_urdf import foot_links
from surefoot.robot_files.draft import Draft, Note, listed
from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.urdf_check import end
from surefoot.schemas.robot_file import Foot, Side
from surefoot.stabilizer.stance.legs import Body, Directions
from surefoot.stabilizer.stance.sole import Sole, Tag, fit_sole, surface_points

_FT = re.compile(
    r"(?:^|[_\W])(?:fts?|force|wrench|loadcell)(?:[_\W\d]|$)|force_?torque", re.I
)
_IMU = re.compile(r"(?:^|[_\W])imu|gyro|acceleromet|ahrs|inertial", re.I)
"""Names with these words; whole words, since every ``left_foot`` contains ``ft``."""
SAME_PLACE_M, SAME_TURN_RAD = 1e-3, 1e-3
"""A link this near to the sole's middle and attitude serves as its frame."""


@dataclass(frozen=True)
class FoundFoot:
    """A foot, and the sole that was measured for it.

    Attributes:
        foot: entry of the robot file.
        sole: rectangle in the base link, with all joints at zero.
    """

    foot: Foot
    sole: Sole


def find_foot(
    draft: Draft,
    body: Body,
    *,
    side: Side,
    link: str,
    sensor: str | None,
    directions: Directions,
) -> FoundFoot:
    """Measure a sole, find the sensor above it, and add the sole's frame.

    Raises:
        RobotFileError: the foot has no shape that could be a sole, or the sensor is
            not above it.
    """
    links = foot_links(draft, link)
    sole, tag = measure_sole(draft, link, side=side, directions=directions)
    ft_link, how = _sensor(draft, link, sensor, side=side)
    frame = _bare_frame_at(draft, body, links, sole, below=ft_link)
    if frame is None:
        T = body.placement(ft_link)
        place = T.rotation.T @ (sole.centre - T.translation)
        frame = draft.add_frame(
            f"{side}_sole", parent=ft_link, place=place, R=T.rotation.T @ sole.R
        )
        draft.note("changed", f"link {frame!r} added in the middle of the {side} sole")
    draft.note(
        "found",
        f"{side} sole: {2e3 * sole.half_length:.0f} x {2e3 * sole.half_width:.0f} mm, "
        f"the largest rectangle in the {tag} shape of {listed(links[:3])} that touches "
        f"flat ground ({100.0 * sole.share:.0f} % of it)",
    )
    draft.notes.append(how)
    foot = Foot(
        side=side,
        sole_frame=frame,
        ft_link=ft_link,
        half_length_m=round(sole.half_length, 4),
        half_width_m=round(sole.half_width, 4),
    )
    return FoundFoot(foot, sole)


def measure_sole(
    draft: Draft, link: str, *, side: str, directions: Directions
) -> tuple[Sole, Tag]:
    """Return the rectangle of a foot, and the kind of shapes that show it.

    Raises:
        RobotFileError: the foot has no shape that could be a sole.
    """
    links = foot_links(draft, link)
    tags: tuple[Tag, ...] = ("collision", "visual")
    words = "none of them has a shape (box, sphere, cylinder or mesh);"
    lost = [draft.lost[name] for name in links if name in draft.lost]
    if lost:
        words = (
            f"their mesh {lost[0]} is not there; say where it is with --package-dir, or"
        )
    for tag in tags:
        try:
            points = surface_points(draft.root, links, tag=tag, down=-directions.up)
            if not len(points):
                continue
            return fit_sole(points, up=directions.up, ahead=directions.ahead), tag
        except RobotFileError as error:
            words = f"{error} ({tag} shapes);"
    raise RobotFileError(
        f"{draft.path}: {side} foot, links {listed(links)}: {words} give one "
        "of them a <collision> box of the size of the sole"
    )


def _sensor(
    draft: Draft, link: str, given: str | None, *, side: str
) -> tuple[str, Note]:
    """Return the link below the sensor, and a note on it."""
    joints = []
    for joint in draft.chain(link):
        joints.append(joint)
        if joint.get("type") != "fixed":
            break
    above = [end(j, "child") for j in joints]
    if given is not None:
        return _given_sensor(draft, above, link, given, side=side)
    masses = {name: _mass_below(draft, name) for name in above}
    for joint, name in zip(joints, above, strict=True):
        named = _FT.search(name) or _FT.search(joint.get("name", ""))
        if joint.get("type") == "fixed" and named and masses[name] > 0.0:
            return name, Note(
                "found",
                f"{side} force-torque sensor: above {name!r}, which weighs "
                f"{masses[name]:.3g} kg with what hangs on it",
            )
    top = above[-1]
    return top, Note(
        "guessed",
        f"{side} force-torque sensor: none found; taken to sit at the ankle, above "
        f"{top!r}, which weighs {masses[top]:.3g} kg; name its link with --{side}-ft",
    )


def _given_sensor(
    draft: Draft, above: list[str], link: str, given: str, *, side: str
) -> tuple[str, Note]:
    draft.find_link(given, option=f"--{side}-ft")
    chain = set(above)
    name = given
    while name not in chain:
        carrier = draft.above.get(name)
        if carrier is None or carrier.get("type") != "fixed":
            raise RobotFileError(
                f"{draft.path}: --{side}-ft {given}: sole {link!r} does not hang on "
                f"it, with nothing that moves between; above the sole are "
                f"{listed(above)}"
            )
        name = end(carrier, "parent")
    told = "as named" if name == given else f"which {given!r} is fixed to"
    return name, Note(
        "found",
        f"{side} force-torque sensor: above {name!r}, {told}; it weighs "
        f"{_mass_below(draft, name):.3g} kg with what hangs on it",
    )


def _mass_below(draft: Draft, link: str) -> float:
    joint = draft.above.get(link)
    return 0.0 if joint is None else draft.carried_kg(joint)


def _bare_frame_at(
    draft: Draft, body: Body, links: list[str], sole: Sole, *, below: str
) -> str | None:
    """Return a link without mass or shape at the sole's frame; None without one."""
    inside = set(draft.below(below)) - {below}
    for name in links:
        if name not in inside or len(draft.links[name]) or len(draft.below(name)) > 1:
            continue
        T = body.placement(name)
        off = float(np.abs(T.translation - sole.centre).max())
        turned = float(np.abs(T.rotation - sole.R).max())
        if off < SAME_PLACE_M and turned < SAME_TURN_RAD:
            return name
    return None


def find_imu(draft: Draft, given: str | None) -> str:
    """Return the link whose frame the IMU reads in.

    Raises:
        RobotFileError: the named link moves relative to the base.
    """
    base = draft.base
    if given is not None:
        draft.find_link(given, option="--imu")
        moving = _moving_above(draft, given)
        if moving:
            raise RobotFileError(
                f"{draft.path}: --imu {given}: it moves against the base {base!r}, by "
                f"{listed(moving)}; name a link that is fixed to it, or fix these "
                f"joints: --fix {moving[0]}"
            )
        draft.note("found", f"inertial unit: {given!r}, as named")
        return given
    named = sorted(
        (n for n in draft.links if _IMU.search(n)),
        key=lambda n: ("imu" not in n.lower(), len(n)),
    )
    for name in named:
        if not _moving_above(draft, name):
            draft.note("found", f"inertial unit: {name!r}, fixed to the base {base!r}")
            return name
    if named:
        joints = listed(_moving_above(draft, named[0]))
        words = f"{named[0]!r} moves against it, by {joints}"
    else:
        words = "no link is named like one"
    draft.note(
        "guessed",
        f"inertial unit: taken to sit in the frame of the base {base!r}, as {words}; "
        "name its link with --imu",
    )
    return base


def _moving_above(draft: Draft, link: str) -> list[str]:
    return [j.get("name", "") for j in draft.chain(link) if j.get("type") != "fixed"]
