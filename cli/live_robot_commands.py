"""``surefoot check-robot``, ``tare`` and ``identify``: tests of a live robot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options
from surefoot.errors import ExitCode

if TYPE_CHECKING:
    from rich.table import Table

    from surefoot.robot_io.conformance.evidence import ConformanceReport
    from surefoot.stabilizer.identification import Drive


def check_robot(
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
    wait_s: options.WaitOption = 10.0,
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only",
            metavar="SECTION",
            help="Run only this section: sensors, wiring, refusals or reactions; lease "
            "and status always run. May be repeated.",
        ),
    ] = None,
    as_json: options.JsonOption = False,
) -> None:
    """Check that a live robot's driver does what every driver must do.

    The robot must stand on both feet. The check takes command, holds the posture and
    gives command back; no joint moves by more than 1 mrad. Exits with 1 when a check
    failed, with 4 when there is no robot.
    """
    from surefoot.cli.console import print_result
    from surefoot.errors import UsageError
    from surefoot.robot_io.conformance.run import SECTIONS, check_conformance

    unknown = sorted(set(only or ()) - set(SECTIONS))
    if unknown:
        raise UsageError(f"--only {unknown[0]}: expected {', '.join(SECTIONS)}")
    model, meeting = options.dialed(robot, servo_profile, endpoints, connect)
    report = check_conformance(
        model, endpoints=meeting, sections=only or SECTIONS, timeout_s=wait_s
    )
    print_result(report, lambda: _checks_table(report), as_json=as_json)
    if not report.passed:
        raise typer.Exit(ExitCode.FAILED)


def _checks_table(report: ConformanceReport) -> Table:
    from surefoot.cli.console import new_table, verdict_mark

    failed = sum(not finding.passed for finding in report.findings)
    verdict = f"{failed} failed" if failed else "all passed"
    title = f"{report.robot}: {len(report.findings)} checks, {verdict}"
    table = new_table(title, "check", "", "got", "expected")
    for finding in report.findings:
        mark = verdict_mark(finding.passed, "FAILED")
        table.add_row(finding.name, mark, finding.got, finding.expected)
    return table


def tare(
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
    wait_s: options.WaitOption = 10.0,
    foot: Annotated[
        str,
        typer.Option("--foot", metavar="left|right|both", help="Which feet hang free."),
    ] = "both",
    duration_s: Annotated[
        float,
        typer.Option(
            "--duration", min=0.1, metavar="S", help="How long to average over."
        ),
    ] = 2.0,
    as_json: options.JsonOption = False,
) -> None:
    """Measure and store what the ankle sensors read while the feet hang free.

    The offsets go to NAME.tare.toml beside the robot file. The driver subtracts them
    from its next start on. Nothing is commanded. Exits with 2 when a foot stands or
    moves.
    """
    from surefoot.cli.console import print_json, print_text
    from surefoot.errors import UsageError
    from surefoot.measure import measure_tare

    if foot not in ("left", "right", "both"):
        raise UsageError(f"--foot {foot}: expected left, right or both")
    model, meeting = options.dialed(robot, servo_profile, endpoints, connect)
    found = measure_tare(
        model,
        endpoints=meeting,
        foot=foot,  # type: ignore[arg-type]  # checked above
        duration_s=duration_s,
        timeout_s=wait_s,
    )
    if as_json:
        print_json(
            {
                "path": str(found.path),
                "readings": found.readings,
                "left": found.tare.left,
                "right": found.tare.right,
            }
        )
        return
    for name, off in zip(("left", "right"), found.found, strict=True):
        if foot in (name, "both"):
            forces = ", ".join(f"{value:.1f}" for value in off[:3])
            moments = ", ".join(f"{value:.2f}" for value in off[3:])
            print_text(f"{name}: {forces} N; {moments} N m beside what was known")
    print_text(f"{found.readings} readings; stored in {found.path}")
    print_text("The robot's driver takes it off from its next start on.")


def identify(
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    inline: Annotated[
        bool,
        typer.Option(
            "--inline", help="Use a simulated robot in this process, without the bus."
        ),
    ] = False,
    scenario: Annotated[
        str | None,
        typer.Option(
            "--scenario",
            metavar="SCENARIO",
            help="Scenario that defines the simulated robot's sensors and drives.",
        ),
    ] = None,
    joints: Annotated[
        list[str] | None,
        typer.Option(
            "--joint", metavar="NAME", help="Move only this joint. May be repeated."
        ),
    ] = None,
    amplitude: Annotated[
        float,
        typer.Option("--amplitude", metavar="RAD", help="How far each joint moves."),
    ] = 0.02,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="Robot file to write; NAME-identified.toml when absent.",
        ),
    ] = None,
    overwrite: options.OverwriteOption = False,
    lockstep: options.LockstepOption = False,
    wait_s: options.WaitOption = 10.0,
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Identify a standing robot's drives by moving one joint after the other a little.

    The robot stands on both feet on firm, level ground. Nothing balances it meanwhile,
    and no joint goes farther than the amplitude from its posture. Writes a robot file
    that extends the robot's own by the profile `identified`.
    """
    from msgspec import to_builtins

    from surefoot.cli.console import print_json, print_table, print_text
    from surefoot.errors import UsageError
    from surefoot.measure import check_out, identify_drives, write_profile
    from surefoot.robot_io.realtime import Pace
    from surefoot.robot_io.robot import load_robot
    from surefoot.schemas.endpoints import choose_endpoints
    from surefoot.sim_robot.catalogue import load_scenario

    model = load_robot(robot, servo_profile=servo_profile)
    if scenario is not None and not inline:
        raise UsageError(
            "--scenario: only a robot in this process has one; add --inline"
        )
    if inline and (lockstep or endpoints is not None or connect):
        raise UsageError(
            "--inline uses no bus; leave out --endpoints, --connect and --lockstep"
        )
    target = out or Path(f"{model.file.name}-identified.toml")
    check_out(model, target, overwrite=overwrite)
    meeting = None
    if not inline:
        meeting = choose_endpoints(endpoints, connect=connect)
    drives = identify_drives(
        model,
        joints=joints or (),
        amplitude_rad=amplitude,
        endpoints=meeting,
        pace=Pace.LOCKSTEP if lockstep else Pace.REALTIME,
        scenario=None if scenario is None else load_scenario(scenario),
        timeout_s=wait_s,
    )
    profile = write_profile(model, drives, target, overwrite=overwrite)
    if as_json:
        print_json(
            {
                "robot": model.file.name,
                "out": str(target),
                "profile": to_builtins(profile),
                "drives": to_builtins(drives),
            }
        )
        return
    print_table(_table(drives))
    print_text(
        f"profile identified in {target}: lag {1e3 * profile.lag_s:.1f} ms, "
        f"{profile.velocity_limit_rad_s:g} rad/s; run with --robot {target}"
    )


def _table(drives: list[Drive]) -> Table:
    from surefoot.cli.console import new_table
    from surefoot.schemas.reasons import given

    figures = ("lag, ms", "limit, rad/s", "play, mrad", "stiffness", "delay, ms")
    table = new_table("drives", "joint", figures=figures)
    for drive in drives:
        table.add_row(
            drive.joint,
            f"{1e3 * drive.lag_s:.1f}",
            f"{'>= ' if drive.is_bound else ''}{drive.velocity_limit_rad_s:.2f}",
            f"{'<= ' if drive.backlash_is_bound else ''}{1e3 * drive.backlash_rad:.2f}",
            given(drive.stiffness_scale, ".2f"),
            f"{1e3 * drive.delay_s:g}",
        )
    return table
