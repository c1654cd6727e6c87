"""``surefoot walk``: footsteps for a robot on the bus."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from surefoot.cli import options
from surefoot.errors import ExitCode


def walk(
    velocity: Annotated[
        float, typer.Option("--velocity", metavar="M_S", help="Ahead.")
    ] = 0.0,
    lateral: Annotated[
        float, typer.Option("--lateral", metavar="M_S", help="To the left.")
    ] = 0.0,
    yaw_rate: Annotated[
        float,
        typer.Option("--yaw-rate", metavar="DEG_S", help="Turning to the left."),
    ] = 0.0,
    steps: Annotated[
        int | None,
        typer.Option(
            "--steps", min=1, help="How many; absent: until Ctrl-C, or the run's end."
        ),
    ] = None,
    step_s: Annotated[
        float,
        typer.Option("--step-s", min=0.2, max=10.0, help="Single support of a step."),
    ] = 0.6,
    double_s: Annotated[
        float,
        typer.Option("--double-s", min=0.05, max=10.0, help="Double support after it."),
    ] = 0.2,
    height: Annotated[
        float,
        typer.Option(
            "--height", min=0.01, max=0.5, metavar="M", help="Lift of the swing foot."
        ),
    ] = 0.05,
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    wait_s: options.WaitOption = 10.0,
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Have a robot that balances walk, by a velocity.

    Tells the robot's stabilizer where to set its feet, some steps ahead. After the last
    step, on Ctrl-C, and when this process is gone, the feet come together and the robot
    stands. Exits with 4 when there is no robot or nobody who walks, with 1 when the
    steps were refused, with 130 after Ctrl-C.
    """
    from surefoot.cli.console import print_json
    from surefoot.cli.logs import log_note, log_warning, set_up_logging
    from surefoot.endpoints import choose_endpoints
    from surefoot.planner import VelocityPlanner, walk_on_bus
    from surefoot.robot_io.bus.stop_request import StopRequest
    from surefoot.robot_io.client_side.requests import PlannerClient
    from surefoot.robot_io.robot import load_robot
    from surefoot.stabilizer.walking.footsteps import Pace, half_width_of

    set_up_logging("walk")
    model = load_robot(robot, servo_profile=servo_profile)
    meeting = choose_endpoints(endpoints, listen=[], connect=connect or [])
    pace = Pace(
        ahead=velocity,
        lateral=lateral,
        yaw_rate=math.radians(yaw_rate),
        single_s=step_s,
        double_s=double_s,
        height_m=height,
    )
    planner = VelocityPlanner(pace, half_width=half_width_of(model))
    stop = StopRequest()
    with PlannerClient(model, endpoints=meeting) as client, stop.on_signals():
        client.connect(timeout_s=wait_s)
        log_note(f"plans for {model.file.name}; Ctrl-C brings its feet together")
        status = walk_on_bus(client, planner, steps=steps, stop=stop)
    if status is None:
        log_warning(
            "no word of a walk from any stabilizer: start one with --controller "
            "whole-body"
        )
        raise typer.Exit(ExitCode.UNREACHABLE)
    log_note(f"{status.steps_done} steps taken; the walk is at: {status.phase}")
    if as_json:
        print_json(status)
    if status.refusal:
        log_warning(f"refused: {status.refusal}")
        raise typer.Exit(ExitCode.FAILED)
    if stop.is_set:
        raise typer.Exit(ExitCode.INTERRUPTED)
