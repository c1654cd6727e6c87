"""``surefoot view``: the live page."""

from __future__ import annotations

from typing import Annotated

import typer

from surefoot.cli import options
from surefoot.errors import ExitCode


def view(
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    port: Annotated[
        int,
        typer.Option("--port", min=0, max=65535, help="Port of the page; 0 for any."),
    ] = 8080,
    open_browser: Annotated[
        bool, typer.Option("--open", help="Open the page in the web browser.")
    ] = False,
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
    child: options.ChildOption = False,
) -> None:
    """Show a robot and its stabilizer on a live page on this machine.

    The page only looks on: robot and stabilizer go on when it ends. It waits for a
    robot as long as it takes.
    """
    import logging
    from importlib.util import find_spec

    from surefoot.cli.console import print_note
    from surefoot.cli.logs import set_up_logging
    from surefoot.endpoints import choose_endpoints
    from surefoot.errors import EnvironmentFailedError
    from surefoot.installation import install_command
    from surefoot.processes.child import begin_as_child
    from surefoot.robot_io.bus.stop_request import StopRequest
    from surefoot.robot_io.robot import load_robot
    from surefoot.robot_io.security.locators import check_locators
    from surefoot.view.page import free_port

    set_up_logging("view")
    logging.getLogger("websockets").setLevel(logging.WARNING)
    if child:
        begin_as_child()
    model = load_robot(robot, servo_profile=servo_profile)
    meeting = choose_endpoints(endpoints, listen=[], connect=connect or [])
    check_locators(meeting.connect, verb="dial")
    if find_spec("viser") is None or find_spec("yourdfpy") is None:
        raise EnvironmentFailedError(
            "the live page needs viser and yourdfpy, which are not installed; "
            f"{install_command('view')}"
        )
    chosen = free_port(port)
    from surefoot.view.page import LivePage  # slow import; report bad options first

    stop = StopRequest()
    with stop.on_signals():
        page = LivePage(model, endpoints=meeting, port=chosen)
        if child:
            print(page.url, flush=True)
        else:
            print_note(f"{page.url} shows {model.file.name}; Ctrl-C ends the page")
        if open_browser:
            typer.launch(page.url)
        page.run(stop)
    raise typer.Exit(ExitCode.INTERRUPTED if stop.cause == "SIGINT" else ExitCode.OK)
