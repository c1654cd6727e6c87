"""``surefoot robot``, ``stabilizer``, ``walk`` and ``view``: one process each."""

from __future__ import annotations

import math
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any

import typer

from surefoot.cli import options
from surefoot.cli.options import complete_scenario
from surefoot.errors import ExitCode, exit_code_for
from surefoot.schemas.reasons import EndReason, in_words


def robot(
    scenario: options.ScenarioArgument = "standing",
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    seed: options.SeedOption = 0,
    lockstep: options.LockstepOption = True,
    endpoints: options.EndpointsOption = None,
    listen: options.ListenOption = None,
    router: options.RouterOption = None,
    insecure: options.InsecureOption = False,
    histogram: options.HistogramOption = False,
    cpu: options.CpuOption = None,
    realtime_priority: options.PriorityOption = None,
    as_json: options.JsonOption = False,
    child: options.ChildOption = False,
    result_file: options.ResultFileOption = None,
    record_file: options.RecordFileOption = None,
) -> None:
    """Run the simulated robot alone; it waits for a stabilizer to take command.

    Exits with 5 when the robot fell, with 1 when it was in fault, held or not commanded
    at the end.
    """
    from msgspec.structs import replace

    from surefoot.cli.console import print_result
    from surefoot.cli.summary import plant_table
    from surefoot.out_folder import write_json
    from surefoot.outcome import judge
    from surefoot.processes.child import begin_process, log_note, progress_reporter
    from surefoot.robot_io.realtime import Pace
    from surefoot.robot_io.robot import load_robot
    from surefoot.robot_io.ticks.write import TickFile
    from surefoot.schemas.endpoints import choose_endpoints
    from surefoot.schemas.scenario import load_scenario
    from surefoot.sim_robot.catalogue import find_scenario, naming_scenario

    begin_process("robot", child=child)
    options.check_priority(realtime_priority, lockstep=lockstep)
    model = load_robot(robot, servo_profile=servo_profile)
    path = find_scenario(scenario)
    world = load_scenario(path)
    meeting = choose_endpoints(
        endpoints, listen=listen, router=router, insecure=insecure
    )
    log_note(
        f"{model.file.name} in {scenario!r} waits for a stabilizer at "
        f"{', '.join(meeting.router or meeting.listen)}"
    )
    options.claim_processor(cpu=cpu, priority=realtime_priority)
    from surefoot.sim_robot.robot_loop import (
        run_robot,  # slow import; report bad files first
    )

    with (
        naming_scenario(path),
        nullcontext()
        if record_file is None
        else TickFile(record_file, may_wait=lockstep) as ticks,
    ):
        result = run_robot(
            model,
            world,
            seed=seed,
            endpoints=meeting,
            pace=Pace.LOCKSTEP if lockstep else Pace.REALTIME,
            ticks=ticks,
            histogram=histogram,
            on_tick=progress_reporter() if child else None,
        )
    if ticks is not None:
        result = replace(result, unrecorded_ticks=ticks.lost_ticks)
    if result_file is not None:
        write_json(result_file, result)
    judgement = judge(result, is_realtime=not lockstep, period_s=model.period_s)
    code = exit_code_for(judgement.outcome)
    if child and code is ExitCode.FAILED:
        raise typer.Exit(ExitCode.OK)  # the parent judges, from both sides' results
    if not child:
        print_result(
            result,
            lambda: plant_table(result, judgement, title=scenario),
            as_json=as_json,
        )
    raise typer.Exit(code)


_IN_ORDER = (
    *(EndReason.SENSOR_LOST, EndReason.CONTROLLER_FAILED),
    *(EndReason.LEASE_LOST, EndReason.ROBOT_FAULT),
)
"""Ends of the stabilizer before the robot's, which then holds and reports the run."""
_CODES = {
    EndReason.RUN_OVER: ExitCode.OK,
    EndReason.FELL: ExitCode.FELL,
    EndReason.STOPPED: ExitCode.INTERRUPTED,
    EndReason.ROBOT_ENDED: ExitCode.UNREACHABLE,
    EndReason.ROBOT_GONE: ExitCode.UNREACHABLE,
    EndReason.ROBOT_SILENT: ExitCode.UNREACHABLE,
}
"""Exit codes of a stabilizer's end; all other ends are failures."""


def stabilizer(
    controller: options.ControllerOption = "whole-body",
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    lockstep: options.LockstepOption = True,
    wait_s: options.WaitOption = 10.0,
    reconnect: Annotated[
        bool,
        typer.Option(
            "--reconnect",
            help="When the robot goes away, wait for it and take command again, from "
            "the posture it holds.",
        ),
    ] = False,
    walk: Annotated[
        str | None,
        typer.Option(
            "--walk",
            metavar="SCENARIO",
            help="Walk as the \\[walk] table of this scenario says.",
            autocompletion=complete_scenario,
        ),
    ] = None,
    settings: options.SettingsOption = None,
    overrides: options.SetOption = None,
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
    histogram: options.HistogramOption = False,
    cpu: options.CpuOption = None,
    realtime_priority: options.PriorityOption = None,
    as_json: options.JsonOption = False,
    child: options.ChildOption = False,
    result_file: options.ResultFileOption = None,
    record_file: options.RecordFileOption = None,
) -> None:
    """Run the stabilizer alone; it takes command of the robot it dials.

    Exits with 4 when there is no robot, or when it goes away before its run is over,
    and with 5 when it fell. Ctrl-C brings the robot to rest first. A second Ctrl-C ends
    at once.
    """
    from msgspec.structs import replace

    from surefoot.cli.console import print_result
    from surefoot.cli.summary import controller_table
    from surefoot.out_folder import write_json
    from surefoot.processes.child import begin_process, log_note, log_warning
    from surefoot.robot_io.realtime import Pace, StopRequest
    from surefoot.robot_io.ticks.write import TickFile
    from surefoot.run_folder import QP_FAILURE
    from surefoot.run_plan import resolve_settings, steps_of

    begin_process("stabilizer", child=child)
    options.check_priority(realtime_priority, lockstep=lockstep)
    model, meeting = options.dialed(robot, servo_profile, endpoints, connect)
    resolved = resolve_settings(settings, overrides=overrides or [], reader=controller)
    log_note(
        f"{controller} for {model.file.name} dials "
        f"{', '.join(meeting.router or meeting.connect)} for {wait_s:g} s at most"
    )
    options.claim_processor(cpu=cpu, priority=realtime_priority)
    # Slow import; report bad files first.
    from surefoot.robot_files.judge import warnings_of
    from surefoot.stabilizer.factory import check_read, check_settings, find_controller
    from surefoot.stabilizer.node import run_stabilizer

    check_read(overrides or [], [controller])
    check_settings(resolved, model)
    for warning in warnings_of(model):
        log_warning(warning)
    steps = None if walk is None else steps_of(walk, model, resolved)
    make = find_controller(controller)
    folder = result_file.parent if result_file is not None else Path.cwd()
    stop = StopRequest()
    with (
        nullcontext()
        if record_file is None
        else TickFile(record_file, may_wait=lockstep) as ticks
    ):
        result = run_stabilizer(
            lambda present: make(model, present),
            model,
            endpoints=meeting,
            pace=Pace.LOCKSTEP if lockstep else Pace.REALTIME,
            connect_timeout_s=wait_s,
            reconnect=reconnect,
            histogram=histogram,
            failure_file=folder / QP_FAILURE,
            settings=resolved,
            stop=stop,
            ticks=ticks,
            walk=steps,
        )
    if ticks is not None:
        result = replace(result, unrecorded_ticks=ticks.lost_ticks)
    code = _CODES.get(result.end, ExitCode.FAILED)
    if code not in (ExitCode.OK, ExitCode.INTERRUPTED):
        log_warning(in_words(result.end, result.end_detail))
    if result_file is not None:
        write_json(result_file, result)
    if not child:
        print_result(
            result,
            lambda: controller_table(result, controller, is_realtime=not lockstep),
            as_json=as_json,
        )
    if child and result.end in _IN_ORDER:
        raise typer.Exit(ExitCode.OK)  # the robot's exit code tells how the run ended
    raise typer.Exit(code)


def _speed(flag: str, most: float, unit: str, help: str) -> Any:
    """Return an option for a speed that may be negative, at most ``most`` in size."""
    return typer.Option(flag, min=-most, max=most, metavar=unit, help=help)


def walk(
    velocity: Annotated[
        float, _speed("--velocity", 10.0, "M_S", "Velocity ahead.")
    ] = 0.0,
    lateral: Annotated[
        float, _speed("--lateral", 10.0, "M_S", "Velocity to the left.")
    ] = 0.0,
    yaw_rate: Annotated[
        float, _speed("--yaw-rate", 360.0, "DEG_S", "Turning rate to the left.")
    ] = 0.0,
    steps: Annotated[
        int | None,
        typer.Option(
            "--steps",
            min=1,
            help="Number of steps; until Ctrl-C or the run's end when absent.",
        ),
    ] = None,
    step_s: Annotated[
        float,
        typer.Option(
            "--step-s", min=0.2, max=10.0, help="Single support of each step, in s."
        ),
    ] = 0.6,
    double_s: Annotated[
        float,
        typer.Option(
            "--double-s", min=0.05, max=10.0, help="Double support after it, in s."
        ),
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
    """Make a balancing robot walk at a velocity.

    Plans footsteps some steps ahead and sends them to the robot's stabilizer. After the
    last step, on Ctrl-C, and when this process is gone, the feet come together and the
    robot stands. If nobody answers, Ctrl-C ends at once. Exits with 4 when there is no
    robot or no stabilizer that walks, or either has gone, with 1 when the steps were
    refused, with 130 after Ctrl-C.
    """
    from surefoot.cli.console import print_json
    from surefoot.planner import VelocityPlanner, walk_on_bus
    from surefoot.processes.child import begin_process, log_note, log_warning
    from surefoot.robot_io.client_side.requests import PlannerClient
    from surefoot.robot_io.realtime import StopRequest
    from surefoot.stabilizer.walking.footsteps import Pace, half_width_of

    begin_process("walk")
    model, meeting = options.dialed(robot, servo_profile, endpoints, connect)
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
    with PlannerClient(model, endpoints=meeting) as client:
        client.connect(timeout_s=wait_s)
        with stop.on_signals():
            log_note(f"plans for {model.file.name}; Ctrl-C brings its feet together")
            status = walk_on_bus(client, planner, steps=steps, stop=stop)
    if status is None:
        raise typer.Exit(ExitCode.INTERRUPTED)
    where = f"the walk is at: {status.phase}"
    if steps is None and not stop.is_set and not status.refusal:
        where = "the robot's run is over"
    log_note(f"the robot has taken {status.steps_done} steps so far; {where}")
    if as_json:
        print_json(status)
    if status.refusal:
        log_warning(f"refused: {status.refusal}")
        raise typer.Exit(ExitCode.FAILED)
    if stop.is_set:
        raise typer.Exit(ExitCode.INTERRUPTED)


def view(
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    port: Annotated[
        int,
        typer.Option("--port", min=0, max=65535, help="Port of the page; 0 for any."),
    ] = 8080,
    open_browser: options.OpenOption = False,
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
    child: options.ChildOption = False,
) -> None:
    """Show a robot and its stabilizer on a live page on this machine.

    Robot and stabilizer do not depend on the page and go on when it ends. The command
    waits for a robot without limit.
    """
    import logging

    from surefoot.cli.console import print_note
    from surefoot.errors import EnvironmentFailedError
    from surefoot.installation import lacking
    from surefoot.processes.child import begin_process
    from surefoot.robot_io.realtime import StopRequest
    from surefoot.robot_io.security.locators import check_locators
    from surefoot.view.page import free_port

    begin_process("view", child=child)
    logging.getLogger("websockets").setLevel(logging.WARNING)
    model, meeting = options.dialed(robot, servo_profile, endpoints, connect)
    check_locators(meeting.connect, verb="dial")
    if words := lacking("the live page", "viser", "yourdfpy", extra="view"):
        raise EnvironmentFailedError(words)
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
