"""``surefoot stabilizer``: the stabilizer alone, for a robot elsewhere."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from surefoot.cli import options
from surefoot.exit_codes import ExitCode

IN_ORDER = ("held", "lost command", "the robot is in fault")
"""How a reason begins to end before the robot does, which then holds its posture."""


def stabilizer(
    controller: options.ControllerOption = "whole-body",
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    lockstep: options.LockstepOption = True,
    wait_s: Annotated[
        float,
        typer.Option(
            "--wait", min=0.0, metavar="SECONDS", help="How long to look for the robot."
        ),
    ] = 10.0,
    reconnect: Annotated[
        bool,
        typer.Option(
            "--reconnect",
            help="When the robot goes away, wait for it and take command again from "
            "the posture it holds.",
        ),
    ] = False,
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

    Exits with 4 when there is no robot, or it goes away before its run is over, and
    with 5 when it fell. Ctrl-C brings the robot to rest first; again, and it ends at
    once.
    """
    from msgspec.structs import replace

    from surefoot.cli.console import print_json, print_table
    from surefoot.cli.logs import log_note, log_warning, set_up_logging
    from surefoot.cli.scheduling import check_priority, claim_processor
    from surefoot.cli.summary import controller_table, histogram_table
    from surefoot.endpoints import choose_endpoints
    from surefoot.processes.child import begin_as_child
    from surefoot.robot_io.bus.stop_request import StopRequest
    from surefoot.robot_io.realtime import Pace
    from surefoot.robot_io.robot import load_robot
    from surefoot.robot_io.ticks.write import TickFile
    from surefoot.run_folder import QP_FAILURE, write_struct
    from surefoot.run_plan import resolve_settings

    set_up_logging("stabilizer")
    if child:
        begin_as_child()
    check_priority(realtime_priority, lockstep=lockstep)
    model = load_robot(robot, servo_profile=servo_profile)
    resolved = resolve_settings(settings, overrides=overrides or [])
    meeting = choose_endpoints(endpoints, listen=[], connect=connect or [])
    log_note(
        f"{controller} for {model.file.name} dials "
        f"{', '.join(meeting.router or meeting.connect)} for {wait_s:g} s at most"
    )
    claim_processor(cpu=cpu, priority=realtime_priority)
    # Heavy: a wrong file is told first.
    from surefoot.stabilizer.factory import make_controller
    from surefoot.stabilizer.node import run_stabilizer

    folder = result_file.parent if result_file is not None else Path.cwd()
    stop = StopRequest()
    with (
        nullcontext()
        if record_file is None
        else TickFile(record_file, may_wait=lockstep) as ticks
    ):
        result = run_stabilizer(
            make_controller(controller, model, resolved),
            model,
            endpoints=meeting,
            pace=Pace.LOCKSTEP if lockstep else Pace.REALTIME,
            connect_timeout_s=wait_s,
            reconnect=reconnect,
            histogram=histogram,
            failure_file=folder / QP_FAILURE,
            settings=resolved,
            stop=stop,
            safety=resolved.safety,
            ticks=ticks,
        )
    if ticks is not None:
        result = replace(result, unrecorded_ticks=ticks.lost_ticks)
    code = _verdict(result.reason)
    if code not in (ExitCode.OK, ExitCode.INTERRUPTED):
        log_warning(result.reason)
    if result_file is not None:
        write_struct(result_file, result)
    if not child:
        if as_json:
            print_json(result)
        else:
            print_table(controller_table(result, controller))
            for name, times in result.histograms.items():
                print_table(histogram_table(name, times))
    if child and result.reason.startswith(IN_ORDER):
        raise typer.Exit(ExitCode.OK)  # the robot tells how the run ends
    raise typer.Exit(code)


def _verdict(reason: str) -> ExitCode:
    """Why the stabilizer ended, as an exit code."""
    if reason.startswith("stopped"):
        return ExitCode.INTERRUPTED
    if reason.startswith(("fell", "run over: fell")):
        return ExitCode.FELL
    if reason.startswith("run over"):
        return ExitCode.OK
    if reason.startswith(("the robot is gone", "the robot ended", "no news")):
        return ExitCode.UNREACHABLE
    return ExitCode.FAILED
