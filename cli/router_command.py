"""``surefoot router``: a meeting point for processes that cannot dial each other."""

from __future__ import annotations

import typer

from surefoot.cli import options
from surefoot.exit_codes import ExitCode


def router(
    robot: options.RobotOption = "walker",
    endpoints: options.EndpointsOption = None,
    listen: options.ListenOption = None,
    insecure: options.InsecureOption = False,
    child: options.ChildOption = False,
) -> None:
    """Run a router; robot, stabilizer and others dial it.

    With TLS it checks who may say what, as the robot does without a router.
    """
    from surefoot.cli.logs import log_note, set_up_logging
    from surefoot.endpoints import choose_endpoints
    from surefoot.processes.child import begin_as_child
    from surefoot.robot_io.bus.router import run_router
    from surefoot.robot_io.bus.stop_request import StopRequest
    from surefoot.robot_io.robot import load_robot

    set_up_logging("router")
    if child:
        begin_as_child()
    model = load_robot(robot)
    meeting = choose_endpoints(
        endpoints, listen=listen or [], connect=[], insecure=insecure
    )
    log_note(f"router for {model.file.name} listens on {', '.join(meeting.listen)}")
    run_router(model, endpoints=meeting, stop=StopRequest())
    raise typer.Exit(ExitCode.INTERRUPTED)
