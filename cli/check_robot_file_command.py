"""``surefoot check-robot-file``: judges a robot file before anything moves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options

if TYPE_CHECKING:
    from rich.table import Table

    from surefoot.robot_files.report import RobotFileReport


def check_robot_file(
    file: Annotated[
        str, typer.Argument(help="Robot file (.toml), or the name of a shipped robot.")
    ],
    servo_profile: options.ServoOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Judge a robot file: masses, axes, posture, reach, servos, and scenarios.

    Exits with 2 when the files contradict each other; warnings stop nothing.
    """
    from surefoot.cli.console import print_json, print_table
    from surefoot.robot_files.report import judge
    from surefoot.robot_io.robot import load_robot

    report = judge(load_robot(file, servo_profile=servo_profile))
    if as_json:
        print_json(report)
        return
    print_table(_findings(report))
    print_table(_scenarios(report))


def _findings(report: RobotFileReport) -> Table:
    from rich.markup import escape
    from rich.table import Table

    warnings = sum(f.verdict == "warning" for f in report.findings)
    title = f"{report.robot}: {warnings or 'no'} warning{'s' * (warnings != 1)}"
    table = Table(title=title)
    for heading in ("what", "", "found", "do"):
        table.add_column(heading, overflow="fold")
    for finding in report.findings:
        mark = "[green]ok[/]" if finding.verdict == "ok" else "[bold yellow]warning[/]"
        table.add_row(finding.name, mark, escape(finding.got), escape(finding.advice))
    return table


def _scenarios(report: RobotFileReport) -> Table:
    from rich.table import Table

    table = Table(title="shipped scenarios")
    for heading in ("scenario", "", "why; --scale-to-robot makes it fit"):
        table.add_column(heading, overflow="fold")
    for fit in report.scenarios:
        mark = "[bold yellow]out of reach[/]" if fit.why else "[green]ok[/]"
        table.add_row(fit.name, mark, fit.why)
    return table
