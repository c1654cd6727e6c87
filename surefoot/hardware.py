"""A vendor's robot on the bus, from Python."""

from __future__ import annotations

from pathlib import Path

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.robot_io.robot_side.driver import VendorAdapter, run_driver
from surefoot.schemas.endpoints import Endpoints, load_endpoints


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
    model = robot if isinstance(robot, Robot) else load_robot(str(robot))
    if endpoints is None:
        endpoints = Endpoints()
    elif not isinstance(endpoints, Endpoints):
        endpoints = load_endpoints(Path(endpoints))
    return run_driver(adapter, model, endpoints=endpoints)
