"""``surefoot check-robot``: what any driver must pass, tried on a live robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options
from surefoot.exit_codes import ExitCode

if TYPE_CHECKING:
    from rich.table import Table

    from surefoot.robot_io.conformance.check_result import ConformanceReport


def check_robot(
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
    wait_s: Annotated[
        float,
        typer.Option(
            "--wait", min=0.1, metavar="SECONDS", help="How long to look for the robot."
        ),
    ] = 10.0,
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only",
            metavar="SECTION",
            help="Try only sensors, wiring, refusals or reactions, beside lease and "
            "status. May be repeated.",
        ),
    ] = None,
    as_json: options.JsonOption = False,
) -> None:
    """Try a live robot against what every driver must do; it stands on both feet.

    Takes command, holds the posture and gives it back; no joint moves by more than
    1 mrad. Exits with 1 when something failed, with 4 when there is no robot.
    """
    from surefoot.cli.console import print_json, print_table
    from surefoot.endpoints import choose_endpoints
    from surefoot.errors import UsageError
    from surefoot.robot_io.conformance.run import SECTIONS, check_conformance
    from surefoot.robot_io.robot import load_robot

    unknown = sorted(set(only or ()) - set(SECTIONS))
    if unknown:
        raise UsageError(f"--only {unknown[0]}: expected {', '.join(SECTIONS)}")
    model = load_robot(robot, servo_profile=servo_profile)
    meeting = choose_endpoints(endpoints, listen=[], connect=connect or [])
    report = check_conformance(
        model, endpoints=meeting, sections=only or SECTIONS, timeout_s=wait_s
    )
    if as_json:
        print_json(report)
    else:
        print_table(_table(report))
    if not report.passed:
        raise typer.Exit(ExitCode.FAILED)


def _table(report: ConformanceReport) -> Table:
    from rich.markup import escape
    from rich.table import Table

    failed = sum(not finding.passed for finding in report.findings)
    verdict = f"{failed} failed" if failed else "all passed"
    table = Table(title=f"{report.robot}: {len(report.findings)} checks, {verdict}")
    for heading in ("check", "", "got", "expected"):
        table.add_column(heading, overflow="fold")
    for finding in report.findings:
        mark = "[green]ok[/]" if finding.passed else "[bold red]FAILED[/]"
        table.add_row(finding.name, mark, escape(finding.got), escape(finding.expected))
    return table
