"""``surefoot margins``: how far a robot's loops are from swaying."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options

if TYPE_CHECKING:
    from rich.table import Table

    from surefoot.schemas.margins import LoopMargins

NO_LIMIT = "-"


def margins(
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    settings: options.SettingsOption = None,
    overrides: options.SetOption = None,
    delay_ms: Annotated[
        float | None,
        typer.Option(
            "--delay",
            metavar="MS",
            help="Delay of the loop, from a reading to the step its answer acts in; "
            "one tick of the robot when absent.",
        ),
    ] = None,
    as_json: options.JsonOption = False,
) -> None:
    """Tell what the whole-body stabilizer bears on a robot: gain, phase, delay.

    Computed from robot file, servo profile and settings; nothing is simulated.
    """
    from surefoot.cli.console import print_json, print_table, print_text
    from surefoot.loop_margins import compute_margins
    from surefoot.run_plan import resolve_settings

    found = compute_margins(
        robot,
        servo_profile=servo_profile,
        settings=resolve_settings(settings, overrides=overrides or ()),
        delay_ms=delay_ms,
    )
    if as_json:
        print_json(found)
        return
    print_table(margins_table(found))
    for line in found.in_words():
        print_text(line)


def margins_table(found: LoopMargins) -> Table:
    """Return a table with a row for each axis of each foot."""
    from rich.table import Table

    table = Table(
        title=f"{found.robot}, {found.servo_profile}, {found.rate_hz:g} Hz, loop of "
        f"{found.delay_ms:g} ms",
        title_justify="left",
    )
    for name in ("foot", "axis"):
        table.add_column(name)
    for name in ("gain, dB", "phase, deg", "delay, ms"):
        table.add_column(name, justify="right")
    for axis in found.axes:
        table.add_row(
            axis.foot,
            axis.axis,
            _number(axis.gain_db, 1),
            _number(axis.phase_deg, 0),
            _number(axis.delay_ms, 1),
            end_section=axis.axis == "yaw",
        )
    return table


def _number(value: float | None, decimals: int) -> str:
    return NO_LIMIT if value is None else f"{value:.{decimals}f}"
