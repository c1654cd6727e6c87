"""Makes controllers by name, and checks settings for contradictions."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path

import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.law_settings import DikSettings
from surefoot.schemas.settings import (
    ControllerSettings,
    EstimatorSettings,
    setting_names,
)
from surefoot.stabilizer.controller import CONTROLLERS, Controller
from surefoot.stabilizer.foreign import (
    ControllerMaker,
    find_target,
    maker_of,
    takes,
)

_EVERYBODY = ("safety", "estimator.calibration_s")
"""Settings used by the loop around any controller: sections, or settings of one."""
_READ = {
    "whole-body": (
        *("whole_body", "tsid", "dik", "ground", "sway"),
        *("estimator", "contact", "walk"),
    ),
    "zmp": (
        *("zmp", "estimator", "contact", "walk"),
        *("dik.limit_margin_rad", "dik.limit_time_s", "dik.ramp_in_s"),
        *("dik.velocity_limit_rad_s", "dik.windup_limit_rad"),
    ),
    "hold": (),
}
"""Further settings used by each shipped controller."""
_OF_OTHERS = ("walk",)
"""Further settings used by a foreign controller without settings: the steps it is
told."""
_UNREAD = {
    "zmp": (
        *("contact.search_force_n", "contact.descent_limit_m_s"),
        *("contact.stiffness_n_m", "walk.climb_s", "walk.landing_force_n"),
    )
}
"""Exceptions: settings that are not used."""


def check_settings(
    settings: ControllerSettings, robot: Robot, *, duration_s: float | None = None
) -> None:
    """Refuse settings with which no robot, this robot or this run can be controlled.

    Contradictions within one section were refused when it was read.

    Args:
        settings: resolved.
        robot: the robot to be controlled.
        duration_s: duration of the run; None if unknown [s].

    Raises:
        FileFormatError: two settings, or a setting and the robot or the run,
            contradict each other; the message names both.
    """
    from surefoot.stabilizer.model import RobotModel  # names need no dynamics

    _check_forces(settings, weight=RobotModel(robot).weight)
    _check_margin(settings.dik.limit_margin_rad, robot)
    calibration_s = settings.estimator.calibration_s
    # A run shorter than the default calibration is no error of the settings.
    is_asked = calibration_s > EstimatorSettings().calibration_s
    if duration_s is not None and is_asked and calibration_s >= duration_s:
        raise FileFormatError(
            f"estimator.calibration_s: got {calibration_s:g} s for a run of "
            f"{duration_s:g} s, in which the robot would never balance; expected less",
            field="estimator.calibration_s",
        )


def _check_forces(settings: ControllerSettings, *, weight: float) -> None:
    tsid, zmp = settings.tsid, settings.zmp
    largest = tsid.normal_force_max_weights * weight
    if tsid.normal_force_min_n >= largest:
        raise FileFormatError(
            f"tsid.normal_force_min_n: got {tsid.normal_force_min_n:g} N, expected "
            f"less than the largest, {tsid.normal_force_max_weights:g} "
            f"(tsid.normal_force_max_weights) x {weight:.0f} N of weight",
            field="tsid.normal_force_min_n",
        )
    for name, force in (
        ("tsid.normal_force_min_n", tsid.normal_force_min_n),
        ("zmp.min_ds_pressure_n", zmp.min_ds_pressure_n),
    ):
        if 2.0 * force >= weight:
            raise FileFormatError(
                f"{name}: got {force:g} N for each foot, expected less than half the "
                f"robot's weight, {0.5 * weight:.0f} N",
                field=name,
            )
    if zmp.touchdown_force_n <= settings.contact.regained_above_n:
        raise FileFormatError(
            f"zmp.touchdown_force_n: got {zmp.touchdown_force_n:g} N, expected more "
            f"than contact.regained_above_n, {settings.contact.regained_above_n:g} N; "
            "a lifted foot would stop short of the ground",
            field="zmp.touchdown_force_n",
        )


def _check_margin(margin: float, robot: Robot) -> None:
    """Check the margin; narrow and locked joints, which it would fill, do not count."""
    half = 0.5 * (robot.soft_upper - robot.soft_lower)
    half[half <= DikSettings().limit_margin_rad] = np.inf
    index = int(np.argmin(half))
    if margin >= half[index]:
        raise FileFormatError(
            f"dik.limit_margin_rad: got {margin:g} rad, expected less than half the "
            f"range of every joint; that of {robot.joint_names[index]} is "
            f"{half[index]:.3f} rad",
            field="dik.limit_margin_rad",
        )


def read_settings(controller: str) -> set[str]:
    """Return the names of the settings that a controller uses, as ``section.name``.

    Args:
        controller: as for :func:`find_controller`. A foreign one that is given settings
            may read all of them; otherwise those of the loop around it count.

    Raises:
        ControllerError: there is no such controller.
    """
    if controller not in CONTROLLERS and takes(find_target(controller)) > 1:
        return set(setting_names())
    read = (*_EVERYBODY, *_READ.get(controller, _OF_OTHERS))
    return {
        name
        for name in setting_names()
        if name in read or name.partition(".")[0] in read
    } - {*_UNREAD.get(controller, ())}


def check_read(
    names: Iterable[str], controllers: Iterable[str], *, option: str = "--set"
) -> None:
    """Refuse settings that no controller uses: they would silently change nothing.

    Args:
        names: settings given one by one, as ``section.name`` or ``section.name=value``.
            Unknown names are left to the code that resolves them.
        controllers: all that are to run; it is enough if one reads the setting.
        option: option that gave them, for the message.

    Raises:
        FileFormatError: none of the controllers reads a setting.
        ControllerError: there is no such controller.
    """
    asked = [key for name in names if (key := name.partition("=")[0].strip())]
    if not asked:
        return
    who = sorted({*controllers})
    read = set[str]().union(*map(read_settings, who))
    for name in asked:
        if name in read or name not in setting_names():
            continue
        readers = [other for other in CONTROLLERS if name in read_settings(other)]
        raise FileFormatError(
            f"{option} {name}: {' and '.join(who)} would not read it, so that it would "
            f"change nothing; {' and '.join(readers)} would. Leave it out, or name "
            "another controller",
            field=name,
        )


def check_one_read(names: Collection[str], controller: str, *, source: str) -> None:
    """Refuse a settings file of which a controller reads nothing.

    Args:
        names: its settings, as ``section.name``.
        controller: that is to run.
        source: the file, for the message.

    Raises:
        FileFormatError: the controller reads none of them.
        ControllerError: there is no such controller.
    """
    if not names or not read_settings(controller).isdisjoint(names):
        return
    readers = [c for c in CONTROLLERS if not read_settings(c).isdisjoint(names)]
    raise FileFormatError(
        f"{source}: {controller} would read none of its settings, so that they would "
        f"change nothing; {' and '.join(readers)} would. Leave the file out, or name "
        "another controller"
    )


PRESETS_DIR = Path(__file__).parent / "presets"


def make_controller(
    name: str, robot: Robot, settings: ControllerSettings
) -> Controller:
    """Make a controller, ready to be started.

    Raises:
        ControllerError: there is no such controller, or it cannot be made.
    """
    return find_controller(name)(robot, settings)


def find_controller(name: str) -> ControllerMaker:
    """Find the maker of a controller.

    Args:
        name: a shipped controller (``whole-body``), the name of an entry point in
            the group ``surefoot.controllers``, ``package.module:Class``, or
            ``path/to/file.py:Class``.

    Returns:
        A function of robot and settings. A foreign class is called with as many of the
        two as its constructor takes.

    Raises:
        ControllerError: there is no such controller.
    """
    if name in CONTROLLERS:
        return _shipped(name)
    return maker_of(name, find_target(name))


def check_controller(name: str) -> None:
    """Refuse an unknown name, without loading the shipped controllers.

    Raises:
        ControllerError: there is no such controller.
    """
    if name not in CONTROLLERS:
        find_controller(name)


def _shipped(name: str) -> ControllerMaker:
    """Import a shipped controller on demand: Pinocchio takes a while to load."""
    if name == "whole-body":
        from surefoot.stabilizer.whole_body.controller import WholeBodyController

        return WholeBodyController
    if name == "zmp":
        from surefoot.stabilizer.zmp.controller import ZmpController

        return ZmpController
    from surefoot.stabilizer.controller import HoldController

    return lambda robot, settings: HoldController(robot.n_a)


def shipped_settings() -> list[str]:
    """Return the names of all shipped settings."""
    return sorted(path.stem for path in PRESETS_DIR.glob("*.toml"))


def find_settings(name_or_path: Path) -> Path:
    """Return the path of a settings file.

    Args:
        name_or_path: a path, or a bare word: the name of shipped settings, unless a
            file here has that name.

    Raises:
        FileFormatError: there are no such settings.
    """
    is_name = name_or_path.name == str(name_or_path) and not name_or_path.suffix
    if not is_name or name_or_path.exists():
        return name_or_path
    shipped = PRESETS_DIR / f"{name_or_path}.toml"
    if not shipped.is_file():
        raise FileFormatError(
            f"{name_or_path}: no such settings; shipped are "
            f"{', '.join(shipped_settings())}; a file ends in .toml"
        )
    return shipped
