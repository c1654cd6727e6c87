"""``surefoot run``, ``stabilizer``, ``scenarios`` and ``doctor``."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options
from surefoot.cli.options import complete_scenario
from surefoot.errors import (
    ChildFailedError,
    ExitCode,
    RunInterrupted,
    UsageError,
    exit_code_for,
)
from surefoot.schemas.reasons import EndReason, in_words

if TYPE_CHECKING:
    from surefoot.run_plan import Mode
    from surefoot.schemas.endpoints import Endpoints


def run(
    scenario: options.ScenarioArgument,
    controller: options.ControllerOption = "whole-body",
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    seed: options.SeedOption = 0,
    lockstep: options.LockstepOption = True,
    inline: Annotated[
        bool,
        typer.Option("--inline", help="Both sides in one process, without the bus."),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Keep result, every tick, settings, scenario and logs here: a new or "
            "empty folder.",
        ),
    ] = None,
    overwrite: options.OverwriteOption = False,
    view: Annotated[
        bool,
        typer.Option("--view", help="Show the run on a live page on this machine."),
    ] = False,
    view_port: Annotated[
        int,
        typer.Option(
            "--view-port", min=0, max=65535, help="Port of the page; 0 for any."
        ),
    ] = 8080,
    relay: Annotated[
        str | None,
        typer.Option(
            metavar="PLAN",
            help="Put a relay between the two that loses, delays or corrupts messages: "
            "a shipped plan such as loss-5, or a plan file (.toml). With --realtime, "
            "or with --inline in simulated time.",
        ),
    ] = None,
    scale_to_robot: Annotated[
        bool,
        typer.Option(
            "--scale-to-robot",
            help="Make motions of the ground and pushes smaller that the robot cannot "
            "reach, and say by how much.",
        ),
    ] = False,
    settings: options.SettingsOption = None,
    overrides: options.SetOption = None,
    endpoints: options.EndpointsOption = None,
    listen: options.ListenOption = None,
    connect: options.ConnectOption = None,
    histogram: options.HistogramOption = False,
    realtime_priority: options.PriorityOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Run a scenario: robot and stabilizer as two processes on the bus.

    Exits with 0 only when the robot stood or walked to the end: with 5 when it fell,
    with 1 when it was held, in fault or not controlled.
    """
    from surefoot.cli.console import (
        print_note,
        print_result,
        progress_bar,
        show_notes,
    )
    from surefoot.cli.summary import run_table, with_histograms
    from surefoot.controllers import loop_notice, walk_notice
    from surefoot.run_plan import make_plan
    from surefoot.runs import execute

    show_notes("surefoot.run")
    plan = make_plan(
        scenario,
        robot=robot,
        servo_profile=servo_profile,
        controller=controller,
        settings=settings,
        overrides=overrides or [],
        seed=seed,
        mode=_mode(lockstep=lockstep, inline=inline),
        relay=relay,
        scale_to_robot=scale_to_robot,
    )
    for notice in (loop_notice(plan), walk_notice(plan)):
        if notice:
            print_note(notice)
    meeting = _meeting(endpoints, listen=listen, connect=connect)
    if inline and meeting is not None:
        raise UsageError(
            "--inline uses no bus; leave out --endpoints, --listen and --connect"
        )
    if inline and view:
        raise UsageError("--inline uses no bus, so a page would see nothing")
    options.check_priority(realtime_priority, lockstep=lockstep)
    error: ChildFailedError | RunInterrupted | None = None
    try:
        with progress_bar(
            plan.scenario_name, ticks=plan.total_ticks, period_s=plan.robot.period_s
        ) as on_tick:
            done = execute(
                plan,
                out=out,
                overwrite=overwrite,
                endpoints=meeting,
                view_port=view_port if view else None,
                histogram=histogram,
                priority=realtime_priority,
                on_tick=on_tick,
            )
    except (ChildFailedError, RunInterrupted) as cut:
        error, done = cut, cut.run
    if done is not None:
        result = done.result
        print_result(
            result,
            lambda: with_histograms(run_table(result), result.histograms),
            as_json=as_json,
        )
    if error is not None:
        raise error
    raise typer.Exit(exit_code_for(done.result.outcome))


def _mode(*, lockstep: bool, inline: bool) -> Mode:
    if not inline:
        return "lockstep" if lockstep else "realtime"
    if not lockstep:
        raise UsageError("--inline knows no real time; leave out --realtime")
    return "inline"


def _meeting(
    file: Path | None, *, listen: list[str] | None, connect: list[str] | None
) -> Endpoints | None:
    """Return where the two processes should meet; None if the user does not say."""
    from surefoot.schemas.endpoints import choose_endpoints

    if file is None and not listen and not connect:
        return None
    meeting = choose_endpoints(file, listen=listen, connect=connect or listen)
    if meeting.tls is not None or meeting.router:
        raise UsageError(
            "an endpoint file with [tls] or a router is for one process; start "
            "surefoot robot and surefoot stabilizer, each with its own file"
        )
    return meeting


def scenarios(as_json: options.JsonOption = False) -> None:
    """List the shipped scenarios."""
    from surefoot.cli.console import print_json, print_table
    from surefoot.cli.summary import scenario_table
    from surefoot.sim_robot.catalogue import list_scenarios, load_scenario

    shipped = {name: load_scenario(name) for name in list_scenarios()}
    if as_json:
        print_json(
            [
                {
                    "name": name,
                    "duration_s": scenario.duration_s,
                    "description": scenario.description or scenario.name,
                }
                for name, scenario in shipped.items()
            ]
        )
    else:
        print_table(scenario_table(shipped))


_IN_ORDER = (
    *(EndReason.SENSOR_LOST, EndReason.CONTROLLER_FAILED),
    *(EndReason.LEASE_LOST, EndReason.ROBOT_FAULT),
)
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
    wait_s: options.WaitOption = 10.0,
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

    from surefoot.cli.console import print_result
    from surefoot.cli.summary import controller_table, with_histograms
    from surefoot.out_folder import write_json
    from surefoot.processes.child import begin_process, log_note, log_warning
    from surefoot.robot_io.realtime import Pace, StopRequest
    from surefoot.robot_io.ticks.write import TickFile
    from surefoot.run_folder import QP_FAILURE
    from surefoot.run_plan import resolve_settings, steps_of

    begin_process("stabilizer", child=child)
    options.check_priority(realtime_priority, lockstep=lockstep)
    model, meeting = options.dialed(robot, servo_profile, endpoints, connect)
    resolved = resolve_settings(settings, overrides=overrides or [])
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
            lambda: with_histograms(
                controller_table(result, controller, is_realtime=not lockstep),
                result.histograms,
            ),
            as_json=as_json,
        )
    if child and result.end in _IN_ORDER:
        raise typer.Exit(ExitCode.OK)  # the robot tells how the run ends
    raise typer.Exit(code)


def doctor(as_json: options.JsonOption = False) -> None:
    """Check this machine, and say what to do; plain text to paste into a question.

    Exits with 3 when something would stop a run. Takes a few seconds.
    """
    from surefoot.cli.console import print_json, print_text
    from surefoot.cli.doctor_machine import examine
    from surefoot.cli.doctor_packages import Severity

    findings = []
    for finding in examine():
        findings.append(finding)
        if not as_json:
            print_text(f"{finding.verdict:<5} {finding.name}: {finding.got}")
            if finding.advice:
                print_text(f"      -> {finding.advice}")
    stopped = sum(finding.verdict is Severity.FAIL for finding in findings)
    warned = sum(finding.verdict is Severity.WARN for finding in findings)
    if as_json:
        print_json(findings)
    elif stopped:
        print_text(f"{stopped} would stop a run, {warned} to look at")
    else:
        print_text(f"nothing would stop a run, {warned} to look at")
    if stopped:
        raise typer.Exit(ExitCode.ENVIRONMENT)
