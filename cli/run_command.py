"""``surefoot run`` and ``scenarios``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options
from surefoot.errors import ChildFailedError, RunInterrupted, UsageError, exit_code_for

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
        print_json,
        print_note,
        print_table,
        progress_bar,
        show_notes,
    )
    from surefoot.cli.options import check_priority
    from surefoot.cli.summary import histogram_table, run_table
    from surefoot.loop_margins import loop_notice
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
    if notice := loop_notice(plan):
        print_note(notice)
    meeting = _meeting(endpoints, listen=listen or [], connect=connect or [])
    if inline and meeting is not None:
        raise UsageError(
            "--inline uses no bus; leave out --endpoints, --listen and --connect"
        )
    if inline and view:
        raise UsageError("--inline uses no bus, so a page would see nothing")
    check_priority(realtime_priority, lockstep=lockstep)
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
        if as_json:
            print_json(done.result)
        else:
            print_table(run_table(done.result))
            for name, times in done.result.histograms.items():
                print_table(histogram_table(name, times))
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
    file: Path | None, *, listen: list[str], connect: list[str]
) -> Endpoints | None:
    """Return where the two processes should meet; None if the user does not say."""
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


def scenarios(as_json: options.JsonOption = False) -> None:
    """List the shipped scenarios."""
    from surefoot.cli.console import print_json, print_table
    from surefoot.cli.summary import ScenarioRow, scenario_table
    from surefoot.schemas.scenario import load_scenario
    from surefoot.sim_robot.catalogue import find_scenario, list_scenarios

    rows = []
    for name in list_scenarios():
        scenario = load_scenario(find_scenario(name))
        text = scenario.description or scenario.name
        rows.append(ScenarioRow(name, scenario.duration_s, text))
    if as_json:
        print_json([row._asdict() for row in rows])
    else:
        print_table(scenario_table(rows))
