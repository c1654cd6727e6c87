"""``surefoot run``, ``scenarios``, ``robots``, ``settings`` and ``doctor``."""

from __future__ import annotations

import math
import traceback
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options
from surefoot.errors import (
    ChildFailedError,
    ExitCode,
    RunInterrupted,
    UsageError,
    exit_code_for,
)

if TYPE_CHECKING:
    from surefoot.run_plan import Mode
    from surefoot.schemas.endpoints import Endpoints
    from surefoot.schemas.scenario import Push

PUSH_S = 0.1
"""Duration of a push that is given on the command line [s]."""


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
            help="New or empty folder for result, signals of every tick, settings, "
            "scenario and logs.",
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
            help="Put a relay between robot and stabilizer that loses, delays or "
            "corrupts messages: a shipped plan such as loss-5, or a plan file (.toml). "
            "Goes with --realtime, or with --inline in simulated time.",
        ),
    ] = None,
    duration_s: Annotated[
        float | None,
        typer.Option(
            "--duration",
            metavar="S",
            help="Duration of the run, one tick or more; the scenario's when absent.",
        ),
    ] = None,
    push: Annotated[
        list[str] | None,
        typer.Option(
            "--push",
            metavar='"N s,deg,s"',
            help="Push the base for 0.1 s: impulse in N s, direction in deg (0 along "
            "x, 90 along y) and time in s. May be repeated.",
        ),
    ] = None,
    video: Annotated[
        bool,
        typer.Option(
            "--video",
            help="Also make an mp4 and a still in the folder of --out. Needs OpenGL "
            "without a window and the extra `video`.",
        ),
    ] = False,
    scale_to_robot: Annotated[
        bool,
        typer.Option(
            "--scale-to-robot",
            help="Scale down motions of the ground, pushes and the velocity of a walk "
            "that the robot cannot reach, and say by how much.",
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
    """Run a scenario, with robot and stabilizer as two processes on the bus.

    Exits with 0 only when the robot stood or walked to the end, with 5 when it fell,
    and with 1 when it was held, in fault or not controlled.
    """
    from surefoot.cli.console import (
        print_note,
        print_result,
        progress_bar,
        show_notes,
    )
    from surefoot.cli.summary import run_table
    from surefoot.controllers import notices
    from surefoot.run_plan import make_plan
    from surefoot.runs import execute

    show_notes("surefoot.run")
    if overwrite and out is None:
        raise UsageError("--overwrite needs --out DIR, whose former files it replaces")
    if video:
        _prepare_video(out)
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
        duration_s=duration_s,
        pushes=[parse_push(text) for text in push or []],
    )
    for notice in notices(plan):
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
        print_result(result, lambda: run_table(result), as_json=as_json)
    if done is not None and done.error is not None:
        traceback.print_exception(done.error)  # of the user's code, which needs it
    if error is not None:
        raise error
    if video:
        assert out is not None
        _draw_video(out)
    raise typer.Exit(exit_code_for(done.result.outcome))


def parse_push(text: str) -> Push:
    """Return the push of a text ``N s,deg,s``: impulse, direction and time.

    Raises:
        UsageError: the text has another form.
    """
    from surefoot.schemas.scenario import Push

    try:
        impulse, turn_deg, start_s = (float(part) for part in text.split(","))
    except ValueError:
        impulse = turn_deg = start_s = math.nan
    if not (impulse > 0.0 and start_s >= 0.0 and math.isfinite(impulse + turn_deg)):
        raise UsageError(
            f"--push {text!r}: expected impulse, direction and time, such as "
            '"20,90,3.0": 20 N s along y after 3 s'
        )
    force, turn = impulse / PUSH_S, math.radians(turn_deg)
    along = [force * math.cos(turn), force * math.sin(turn), 0.0]
    return Push(force_n=along, start_s=start_s, duration_s=PUSH_S)


def _prepare_video(out: Path | None) -> None:
    """Check, as far as possible before the run, that a video can be made and kept."""
    from surefoot.report.video import check_encoder, load_drawing

    if out is None:
        raise UsageError("--video needs --out DIR, the folder that keeps it")
    check_encoder()
    load_drawing()  # before the simulator is loaded for anything else


def _draw_video(out: Path) -> None:
    from surefoot.cli.console import count_bar, print_note
    from surefoot.report.run_data import load_runs
    from surefoot.report.video import check_drawing, draw_video
    from surefoot.run_folder import STILL, VIDEO

    [run] = load_runs([out])
    check_drawing(run, video=True)
    with TemporaryDirectory(dir=out, prefix=".video-") as making:
        film, still = Path(making, VIDEO), Path(making, STILL)
        draw_video(run, film, thumbnail=still, bar=count_bar)
        for whole in (film, still):
            whole.replace(out / whole.name)
    print_note(f"video: {out / VIDEO}")


def _mode(*, lockstep: bool, inline: bool) -> Mode:
    if not inline:
        return "lockstep" if lockstep else "realtime"
    if not lockstep:
        raise UsageError("--inline runs without real time; leave out --realtime")
    return "inline"


def _meeting(
    file: Path | None, *, listen: list[str] | None, connect: list[str] | None
) -> Endpoints | None:
    """Return where the two processes meet; None to choose a private place."""
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


def robots(as_json: options.JsonOption = False) -> None:
    """List the shipped robots."""
    from surefoot.cli.console import print_json, print_table
    from surefoot.cli.summary import rows_table
    from surefoot.robot_io.robot import list_robots, load_robot

    shipped = [
        {
            "name": name,
            "joints": len(model.joint_names),
            "tick_ms": 1e3 * model.period_s,
            "servo_profiles": list(model.file.servo.profiles),
            "file": str(model.path),
        }
        for name in list_robots()
        for model in [load_robot(name)]
    ]
    if as_json:
        print_json(shipped)
    else:
        print_table(rows_table(shipped))


def settings(as_json: options.JsonOption = False) -> None:
    """List all settings with defaults and descriptions, and the shipped files."""
    import msgspec

    from surefoot.cli.console import print_json, print_note, print_table
    from surefoot.cli.summary import rows_table
    from surefoot.schemas.json_schema import field_docs
    from surefoot.schemas.settings import ControllerSettings
    from surefoot.stabilizer.factory import shipped_settings

    sections = msgspec.to_builtins(ControllerSettings())
    rows = [
        {
            "name": f"{section.name}.{name}",
            "default": default,
            "text": docs[name].replace("``", "`"),
        }
        for section in msgspec.structs.fields(ControllerSettings)
        for docs in [field_docs(section.type)]
        for name, default in sections[section.name].items()
    ]
    if as_json:
        print_json(rows)
        return
    print_table(rows_table(rows))
    print_note(f"--settings takes {', '.join(shipped_settings())}, or a file")


def doctor(as_json: options.JsonOption = False) -> None:
    """Check this machine and advise what to do, as plain text to paste into an issue.

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
