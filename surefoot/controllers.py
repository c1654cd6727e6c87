"""Controllers by name, as a notebook asks for them."""

from __future__ import annotations

from pathlib import Path

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.run_plan import Settings, resolve_settings
from surefoot.stabilizer import factory
from surefoot.stabilizer.control.controller import Controller


def make_controller(
    name: str, robot: str | Path | Robot = "walker", *, settings: Settings = None
) -> Controller:
    """Make a new controller; it is started once, by the run it is given to.

    Args:
        name: ``whole-body``, ``zmp``, ``hold``, an installed entry point,
            ``package.module:Class`` or ``path/to/file.py:Class``.
        robot: shipped name, path of a robot file, or a loaded robot.
        settings: ``{"tsid.com_kp": 40.0}``, resolved settings, the name of shipped
            settings, a file, or None for the defaults.

    Raises:
        ControllerError: there is no such controller, or it cannot be made.
        RobotFileError: no such robot.
        FileFormatError: a file or a setting is malformed.
    """
    model = robot if isinstance(robot, Robot) else load_robot(str(robot))
    return factory.make_controller(name, model, resolve_settings(settings))


def list_controllers() -> list[str]:
    """Return the names of all controllers: shipped ones and installed entry points."""
    return factory.controller_names()
