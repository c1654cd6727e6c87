"""Makes a robot file from a URDF; guesses what the URDF does not tell."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surefoot.errors import UsageError
from surefoot.out_folder import (
    check_replaceable,
    make_out_folder,
    new_file,
    undone_on_error,
)
from surefoot.robot_files import clean_urdf
from surefoot.robot_files.draft import (
    Draft,
    Note,
    carry_meshes,
    check_copies,
    copy_meshes,
    find_meshes,
)
from surefoot.robot_files.frames import FoundFoot, find_foot, find_imu, measure_sole
from surefoot.robot_files.judge import default_settings
from surefoot.robot_files.robot_text import joint_lines, robot_text
from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.robot_io.urdf_check import Urdf, bare_text, drop
from surefoot.schemas.arrays import Array
from surefoot.schemas.robot_file import Side
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.control.drives import borne_delay
from surefoot.stabilizer.stance.legs import Body, Directions, find_directions, read_body
from surefoot.stabilizer.stance.nominal import NominalPosture, find_nominal

LOWEST_M, HIGHEST_M = 0.05, 3.0
"""Bounds for the height of the centre of mass above the soles [m]."""
SIGNATURE = "by surefoot new-robot"
BESIDE_M = 0.03
"""Least gap between the soles [m]."""
LONGEST_NAME = 100
"""Characters in a robot's name, which is part of file and folder names."""
UNLIKE = 1.2
"""Soles whose sizes differ by a larger factor are reported as unlike."""
NARROW_M = 0.03
"""Soles narrower than this are reported [m]."""


@dataclass(frozen=True)
class NewRobotOptions:
    """What the user may say about a robot beside its URDF.

    Attributes:
        left_sole: link of the left foot.
        right_sole: link of the right foot.
        left_ft: link below the left force-torque sensor.
        right_ft: link below the right force-torque sensor.
        imu: link whose frame the IMU reads in.
        name: name of the robot; the URDF's when None.
        fix: patterns of joints to fix.
        keep: patterns of joints not to fix.
        legs_only: fix all joints above the legs.
        package_dirs: folders that hold packages of meshes.
        repair_inertias: replace impossible inertias by possible ones.
        rise_m: how far the CoM should be able to rise over its feet [m].
        sink_m: how far it should be able to sink, positive [m].
        rate_hz: rate of the robot's control loop [Hz].
    """

    left_sole: str
    right_sole: str
    left_ft: str | None = None
    right_ft: str | None = None
    imu: str | None = None
    name: str | None = None
    fix: Sequence[str] = ()
    keep: Sequence[str] = ()
    legs_only: bool = False
    package_dirs: Sequence[Path] = ()
    repair_inertias: bool = False
    rise_m: float | None = None
    sink_m: float | None = None
    rate_hz: float = 1000.0


@dataclass(frozen=True)
class NewRobot:
    """The new robot, and the report on it."""

    robot: Robot
    notes: tuple[Note, ...]


def new_robot(
    urdf: Path, options: NewRobotOptions, *, out: Path, overwrite: bool = False
) -> NewRobot:
    """Write ``name.toml``, ``name.urdf`` and meshes for the robot of a URDF.

    All paths in them are relative, so that the folder can be moved.

    Args:
        urdf: the robot's URDF; it is not changed.
        options: what the user says beside it.
        out: folder for the files; it is made if missing.
        overwrite: replace files of these names that this function wrote.

    Returns:
        The robot and the report.

    Raises:
        RobotFileError: the URDF is broken, or no standing posture was found.
        UsageError: the files exist.
    """
    if options.left_sole == options.right_sole:
        raise UsageError(
            f"--left-sole and --right-sole are both {options.left_sole!r}; name one "
            "link of each foot"
        )
    draft = _cleaned(urdf, options)
    name = _name(options.name or draft.root.get("name") or urdf.stem)
    toml_path, urdf_path = out / f"{name}.toml", out / f"{name}.urdf"
    for path in (toml_path, urdf_path):
        if path.exists() and path.resolve() == urdf.resolve():
            raise UsageError(
                f"{path}: is the URDF itself; take another --name or --out"
            )
        check_replaceable(path, signature=SIGNATURE, overwrite=overwrite)
    checked = Urdf(urdf, draft.root)
    checked.check_masses()
    body = read_body(bare_text(draft.root), source=str(urdf))
    directions = _directions(draft, body, options)
    feet = _feet(draft, body, options, directions)
    _check_size(draft, _com_height(body, feet, directions))
    for link in draft.root.iter("link"):
        drop(link, ("collision",))  # in the simulator only soles touch the ground
    body = read_body(bare_text(draft.root), source=str(urdf))
    try:
        nominal = _posture(body, feet, options, directions)
    except RobotFileError as error:
        raise RobotFileError(f"{urdf}: {error}") from error
    _check_sides(draft, body, nominal, feet, directions)
    joints = joint_lines(
        draft,
        body,
        nominal,
        com_height_m=_com_height(body, feet, directions),
        up=directions.up,
    )
    text = robot_text(
        name=name,
        source=urdf.name,
        rate_hz=options.rate_hz,
        base_link=draft.base,
        base_height_m=_base_height(body, nominal, feet, directions),
        imu=find_imu(draft, options.imu),
        feet=[found.foot for found in feet],
        nominal=nominal,
        joints=joints,
    )
    _note_posture(draft, nominal)
    _note_soles(draft, feet)
    copies = carry_meshes(draft, out, folder=f"{name}_meshes")
    check_copies(copies)
    # A name must not end the comment: no new line, no two dashes.
    made = " ".join(f"{name}, {SIGNATURE} from {urdf.name}".split()).replace(
        "--", "- -"
    )
    contents = {
        toml_path: f"# {made}.\n{text}",
        urdf_path: f"<!-- {made}. -->\n{draft.text()}",
    }
    _try(contents, out=out)
    with undone_on_error() as note_new:
        for path in (*copies, *contents):
            note_new(path)
        make_out_folder(out, out=out)
        copy_meshes(copies)
        for path, content in reversed(contents.items()):
            with new_file(path, overwrite=overwrite) as file:
                file.write(content.encode())
    robot = load_robot(str(toml_path))
    unfit = default_settings(robot)
    if unfit.advice:
        draft.note("left to you", unfit.advice)
    return NewRobot(robot, tuple(draft.notes))


def _try(contents: dict[Path, str], *, out: Path) -> None:
    """Check that the files can be loaded, and the robot be balanced.

    Raises:
        RobotFileError: they cannot; it names the final path.
    """
    with tempfile.TemporaryDirectory() as trial:
        paths = [Path(trial) / path.name for path in contents]
        for path, content in zip(paths, contents.values(), strict=True):
            path.write_text(content, encoding="utf-8")
        try:
            borne_delay(load_robot(str(paths[0])), ControllerSettings())
        except RobotFileError as error:
            raise RobotFileError(str(error).replace(trial, str(out))) from error


def _cleaned(urdf: Path, options: NewRobotOptions) -> Draft:
    draft = Draft(urdf)
    clean_urdf.drop_world(draft)
    soles = [
        draft.find_link(link, option=option)
        for link, option in (
            (options.left_sole, "--left-sole"),
            (options.right_sole, "--right-sole"),
        )
    ]
    clean_urdf.check_feet(draft, soles)
    clean_urdf.choose_joints(
        draft,
        soles,
        fix=options.fix,
        keep=options.keep,
        legs_only=options.legs_only,
    )
    clean_urdf.check_feet(draft, soles)
    clean_urdf.open_limits(draft)
    find_meshes(draft, options.package_dirs)
    clean_urdf.settle_inertias(draft, repair=options.repair_inertias)
    return draft


def _directions(draft: Draft, body: Body, options: NewRobotOptions) -> Directions:
    """Return up and ahead: first from the feet's links, then from the soles."""
    links = (options.left_sole, options.right_sole)
    left, right = (body.placement(link).translation for link in links)
    rough = find_directions(body, links[0], (left, right))
    soles = [
        measure_sole(draft, link, side=side, directions=rough)[0]
        for link, side in zip(links, ("left", "right"), strict=True)
    ]
    normal = soles[0].R[:, 2] + soles[1].R[:, 2]
    return find_directions(
        body,
        links[0],
        (soles[0].centre, soles[1].centre),
        up=rough.up if rough.is_exact else normal / np.linalg.norm(normal),
    )


def _feet(
    draft: Draft, body: Body, options: NewRobotOptions, directions: Directions
) -> tuple[FoundFoot, FoundFoot]:
    o = options
    sides: tuple[tuple[Side, str, str | None], ...] = (
        ("left", o.left_sole, o.left_ft),
        ("right", o.right_sole, o.right_ft),
    )
    left, right = (
        find_foot(
            draft, body, side=side, link=link, sensor=sensor, directions=directions
        )
        for side, link, sensor in sides
    )
    return left, right


def _posture(
    body: Body,
    feet: tuple[FoundFoot, FoundFoot],
    options: NewRobotOptions,
    directions: Directions,
) -> NominalPosture:
    left, right = (directions.R_upright_base @ found.sole.centre for found in feet)
    widest = max(found.sole.half_width for found in feet)
    apart_m = max(float(left[1] - right[1]), 2.0 * widest + BESIDE_M)
    return find_nominal(
        body.model,
        [body.frame(found.foot.sole_frame) for found in feet],
        R_world_base=directions.R_upright_base,
        apart_m=apart_m,
        rise_m=options.rise_m,
        sink_m=options.sink_m,
    )


def _check_size(draft: Draft, com_height_m: float) -> None:
    """Refuse a robot whose size suggests other units than metres."""
    if not LOWEST_M < com_height_m < HIGHEST_M:
        raise RobotFileError(
            f"{draft.path}: its centre of mass is {com_height_m:.4g} m above the "
            f"soles, expected {LOWEST_M:g} to {HIGHEST_M:g}; are all lengths in metres?"
        )


def _check_sides(
    draft: Draft,
    body: Body,
    nominal: NominalPosture,
    feet: tuple[FoundFoot, FoundFoot],
    directions: Directions,
) -> None:
    """Refuse a robot whose knees and toes both point backward."""
    ahead = directions.ahead
    knees, toes = [], []
    for leg, found in zip(nominal.legs, feet, strict=True):
        ankle = body.data.oMi[leg.joints[-1]].translation
        toes.append(float((found.sole.centre - ankle) @ ahead))
        knees.append(nominal.knee_ahead(body.model, leg, directions.R_upright_base))
    if max(knees) < 0.0 and max(toes) < 0.0:
        raise RobotFileError(
            f"{draft.path}: knees and toes point backward; {feet[0].foot.sole_frame!r} "
            "looks like that of the right foot: exchange --left-sole and --right-sole"
        )
    if max(knees) < 0.0:
        draft.note(
            "left to you",
            "the knees bend backward; is that how it stands, or are --left-sole and "
            "--right-sole exchanged?",
        )


def _com_height(
    body: Body, feet: tuple[FoundFoot, FoundFoot], directions: Directions
) -> float:
    """Return the CoM's height above the soles with all joints at zero [m]."""
    middle = 0.5 * (feet[0].sole.centre + feet[1].sole.centre)
    return float((body.data.com[0] - middle) @ directions.up)


def _base_height(
    body: Body,
    nominal: NominalPosture,
    feet: tuple[FoundFoot, FoundFoot],
    directions: Directions,
) -> float:
    places: list[Array] = [
        nominal.sole_place(body.model, found.foot.sole_frame) for found in feet
    ]
    return -float(0.5 * (places[0] + places[1]) @ directions.up)


def _note_posture(draft: Draft, nominal: NominalPosture) -> None:
    sink, rise = nominal.com_travel_m
    draft.note(
        "found",
        f"nominal posture: soles level, centre of mass over their middle, knees at "
        f"{nominal.knee_angle(0):.2f} and {nominal.knee_angle(1):.2f} rad; from there "
        f"it can sink by {-1e3 * sink:.0f} and rise by {1e3 * rise:.0f} mm; to carry "
        f"it alone a knee needs {1e2 * nominal.one_foot_share:.0f} % of its torque",
    )
    asked_sink, asked_rise = nominal.asked_m
    if -sink < 0.9 * asked_sink or rise < 0.9 * asked_rise:
        draft.note(
            "left to you",
            f"it sinks by {-1e3 * sink:.0f} and rises by {1e3 * rise:.0f} mm, and was "
            f"to do so by {1e3 * asked_sink:.0f} and {1e3 * asked_rise:.0f} mm (a "
            "share of the leg, or --sink and --rise): joint ranges, or what a knee can "
            "carry, end before; see check-robot-file",
        )


def _note_soles(draft: Draft, feet: tuple[FoundFoot, FoundFoot]) -> None:
    """Note soles that differ in size or are very narrow."""
    left, right = ((found.sole.half_length, found.sole.half_width) for found in feet)
    pairs = list(zip(left, right, strict=True))
    if max(max(pair) / min(pair) for pair in pairs) > UNLIKE:
        draft.note(
            "left to you",
            "the soles differ in size: do the shapes of both feet touch the ground?",
        )
    if min(*left, *right) < 0.5 * NARROW_M:
        draft.note(
            "left to you",
            f"a sole is narrower than {1e3 * NARROW_M:.0f} mm: does its shape "
            "touch the ground?",
        )


def _name(wanted: str) -> str:
    """Return a name that is fit for files and as a Zenoh namespace."""
    name = re.sub(r"[^a-z0-9_\-]+", "_", wanted.strip().lower()).strip("_")
    if not name or len(name) > LONGEST_NAME:
        raise UsageError(
            f"--name: got {wanted[:60]!r}, expected letters and digits, at most "
            f"{LONGEST_NAME}"
        )
    return name
