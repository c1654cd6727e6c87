"""``surefoot run``: a scenario from start to end."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options
from surefoot.errors import ChildFailedError, UsageError
from surefoot.exit_codes import ExitCode

if TYPE_CHECKING:
    from collections.abc import Callable

    from surefoot.run_plan import Mode, RunPlan
    from surefoot.run_result import Sides
    from surefoot.schemas.endpoints import Endpoints
    from surefoot.schemas.result import RunResult


def run(
    scenario: options.ScenarioArgument,
    controller: options.ControllerOption = options.ControllerName.WHOLE_BODY,
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
            help="Keep result, every tick, settings, scenario and logs here. A former "
            "run there is replaced, any other folder refused.",
        ),
    ] = None,
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

    Exits with 5 when the robot fell, with 1 when the stabilizer lost command of it.
    """
    from surefoot.cli.console import print_json, print_table, show_notes
    from surefoot.cli.scheduling import check_priority
    from surefoot.cli.summary import histogram_table, run_table
    from surefoot.run_plan import make_plan

    show_notes("surefoot.run")
    plan = make_plan(
        scenario,
        robot=robot,
        servo_profile=servo_profile,
        controller=controller,
        settings_file=settings,
        overrides=overrides or [],
        seed=seed,
        mode=_mode(lockstep=lockstep, inline=inline),
        relay=relay,
    )
    meeting = _meeting(endpoints, listen=listen or [], connect=connect or [])
    if inline and meeting is not None:
        raise UsageError(
            "--inline uses no bus; leave out --endpoints, --listen and --connect"
        )
    if inline and view:
        raise UsageError("--inline uses no bus, so a page would see nothing")
    check_priority(realtime_priority, lockstep=lockstep)
    result = _execute(
        plan,
        meeting,
        out=out,
        view_port=view_port if view else None,
        histogram=histogram,
        priority=realtime_priority,
    )
    if as_json:
        print_json(result)
    else:
        print_table(run_table(result))
        for name, times in result.histograms.items():
            print_table(histogram_table(name, times))
    if result.fell:
        raise typer.Exit(ExitCode.FELL)
    if result.reason.startswith(("lost command", "the robot is in fault")):
        raise typer.Exit(ExitCode.FAILED)


def _mode(*, lockstep: bool, inline: bool) -> Mode:
    if not inline:
        return "lockstep" if lockstep else "realtime"
    if not lockstep:
        raise UsageError("--inline knows no real time; leave out --realtime")
    return "inline"


def _meeting(
    file: Path | None, *, listen: list[str], connect: list[str]
) -> Endpoints | None:
    """Where the user wants the two to meet; None for no wish."""
    from surefoot.endpoints import choose_endpoints

    if file is None and not listen and not connect:
        return None
    meeting = choose_endpoints(file, listen=listen, connect=connect or listen)
    if meeting.tls is not None or meeting.router:
        raise UsageError(
            "an endpoint file with [tls] or a router is for one process; start "
            "surefoot robot and surefoot stabilizer, each with its own file"
        )
    return meeting


def _execute(
    plan: RunPlan,
    meeting: Endpoints | None,
    *,
    out: Path | None,
    view_port: int | None,
    histogram: bool,
    priority: int | None,
) -> RunResult:
    """Run the plan and fill the folder of the run."""
    from surefoot.cli.console import progress_bar
    from surefoot.run_folder import RESULT, RunDirectory, write_inputs, write_struct
    from surefoot.run_result import join_result

    with RunDirectory(out) as folder:
        write_inputs(folder.path, plan)
        try:
            with progress_bar(
                plan.scenario_name,
                ticks=plan.total_ticks,
                period_s=plan.robot.period_s,
            ) as on_tick:
                sides = _run_sides(
                    plan,
                    meeting,
                    folder.path,
                    record=out is not None,
                    on_tick=on_tick,
                    view_port=view_port,
                    histogram=histogram,
                    priority=priority,
                )
        except ChildFailedError:
            # The logs of a failed run are what its user needs next.
            folder.keep()
            raise
        result = join_result(
            plan, sides.plant, sides.controller, out=out, relay=sides.relay
        )
        write_struct(folder.path / RESULT, result)
        folder.keep()
    return result


def _run_sides(
    plan: RunPlan,
    meeting: Endpoints | None,
    folder: Path,
    *,
    record: bool,
    on_tick: Callable[[int], None],
    view_port: int | None,
    histogram: bool,
    priority: int | None,
) -> Sides:
    if plan.mode == "inline":
        return _run_inline(
            plan, folder, record=record, on_tick=on_tick, histogram=histogram
        )
    from surefoot.endpoints import private_bus
    from surefoot.processes.bus_run import run_processes

    with private_bus() if meeting is None else nullcontext(meeting) as endpoints:
        return run_processes(
            plan,
            folder,
            endpoints=endpoints,
            record=record,
            on_tick=on_tick,
            view_port=view_port,
            histogram=histogram,
            priority=priority,
        )


def _run_inline(
    plan: RunPlan,
    folder: Path,
    *,
    record: bool,
    on_tick: Callable[[int], None],
    histogram: bool,
) -> Sides:
    if plan.relay_path is None:
        from surefoot.simulation import run_inline

        return run_inline(
            plan, folder, record=record, on_tick=on_tick, histogram=histogram
        )
    from surefoot.relayed_simulation import run_inline_relayed
    from surefoot.schemas.relay_plan import load_relay_plan

    faults = load_relay_plan(plan.relay_path)
    return run_inline_relayed(plan, faults, folder, record=record, on_tick=on_tick)
