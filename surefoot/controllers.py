"""Controllers by name, and robots of a vendor, as a notebook asks for them."""

from __future__ import annotations

from pathlib import Path

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.robot_io.robot_side.driver import VendorAdapter, run_driver
from surefoot.run_plan import Settings, resolve_settings
from surefoot.schemas.endpoints import Endpoints, load_endpoints
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
    model = robot if isinstance(robot, Robot) else load_robot(robot)
    return factory.make_controller(name, model, resolve_settings(settings))


def list_controllers() -> list[str]:
    """Return the names of all controllers: shipped ones and installed entry points."""
    return factory.controller_names()


def drive(
    adapter: VendorAdapter,
    robot: str | Path | Robot,
    endpoints: str | Path | Endpoints | None = None,
) -> str:
    """Serve a robot until SIGINT or SIGTERM: sense, publish, guard, command.

    Args:
        adapter: the vendor's robot: ``read(tick, stamp_ns)`` and ``write(q_command)``.
        robot: shipped name, path of a robot file, or a loaded robot.
        endpoints: where to listen: an endpoint file, or None for loopback.

    Returns:
        Why it ended.

    Raises:
        EndpointError: cannot listen there.
        RobotFileError: no such robot.
        FileFormatError: the endpoint file is malformed.
    """
    model = robot if isinstance(robot, Robot) else load_robot(robot)
    if endpoints is None:
        endpoints = Endpoints()
    elif not isinstance(endpoints, Endpoints):
        endpoints = load_endpoints(Path(endpoints))
    return run_driver(adapter, model, endpoints=endpoints)
