"""``surefoot stabilizer``: the stabilizer alone, for a robot elsewhere."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from surefoot.cli import options
from surefoot.cli.options import complete_scenario
from surefoot.errors import ExitCode
from surefoot.schemas.reasons import EndReason, in_words

_IN_ORDER = (EndReason.SENSOR_LOST, EndReason.LEASE_LOST, EndReason.ROBOT_FAULT)
"""Ends before the robot's own, which then holds its posture and tells how it went."""
_CODES = {
    EndReason.RUN_OVER: ExitCode.OK,
    EndReason.FELL: ExitCode.FELL,
    EndReason.STOPPED: ExitCode.INTERRUPTED,
    EndReason.ROBOT_ENDED: ExitCode.UNREACHABLE,
    EndReason.ROBOT_GONE: ExitCode.UNREACHABLE,
    EndReason.ROBOT_SILENT: ExitCode.UNREACHABLE,
}
"""Other ends are failures."""


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
    walk: Annotated[
        str | None,
        typer.Option(
            "--walk",
            metavar="SCENARIO",
            help="Take the steps of this scenario's \\[walk] table.",
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

    Exits with 4 when there is no robot, or it goes away before its run is over, and
    with 5 when it fell. Ctrl-C brings the robot to rest first; again, and it ends at
    once.
    """
    from msgspec.structs import replace

    from surefoot.cli.console import (
        log_note,
        log_warning,
        print_json,
        print_table,
        set_up_logging,
    )
    from surefoot.cli.options import check_priority, claim_processor
    from surefoot.cli.summary import controller_table, histogram_table
    from surefoot.endpoints import choose_endpoints
    from surefoot.processes.child import begin_as_child
    from surefoot.robot_io.bus.stop_request import StopRequest
    from surefoot.robot_io.realtime import Pace
    from surefoot.robot_io.robot import load_robot
    from surefoot.robot_io.ticks.write import TickFile
    from surefoot.run_folder import QP_FAILURE, write_struct
    from surefoot.run_plan import resolve_settings, steps_of

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
    # Slow import; report bad files first.
    from surefoot.robot_files.judge import warnings_of
    from surefoot.stabilizer.factory import check_settings, find_controller
    from surefoot.stabilizer.node import run_stabilizer

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
        write_struct(result_file, result)
    if not child:
        if as_json:
            print_json(result)
        else:
            table = controller_table(result, controller, is_realtime=not lockstep)
            print_table(table)
            for name, times in result.histograms.items():
                print_table(histogram_table(name, times))
    if child and result.end in _IN_ORDER:
        raise typer.Exit(ExitCode.OK)  # the robot tells how the run ends
    raise typer.Exit(code)
