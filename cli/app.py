"""The commands of ``surefoot``; each imports what it needs when it runs."""

from __future__ import annotations

from typing import Annotated

import typer

from surefoot.cli.bench_command import bench
from surefoot.cli.bus_commands import echo, hz, topics
from surefoot.cli.gain_commands import margins, tune
from surefoot.cli.live_robot_commands import check_robot, identify, tare
from surefoot.cli.network_commands import certs, relay, router
from surefoot.cli.options import Command, Group
from surefoot.cli.process_commands import robot, stabilizer, view, walk
from surefoot.cli.record_commands import log, record
from surefoot.cli.replay_command import replay
from surefoot.cli.robot_file_commands import check_robot_file, new_robot
from surefoot.cli.run_commands import (
    doctor,
    robots,
    run,
    scenarios,
    settings,
)
from surefoot.cli.study_commands import report, reproduce, sweep

app = typer.Typer(
    name="surefoot",
    cls=Group,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"surefoot {version('surefoot')}")
        raise typer.Exit


@app.callback()
def surefoot(
    show_version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_print_version,
            is_eager=True,
            help="Show the version and exit.",
        ),
    ] = False,
) -> None:
    """Keep a position-controlled humanoid on its feet when the ground moves.

    Exit codes: 0 ok, 1 failed, 2 usage or bad file, 3 environment, 4 robot
    unreachable, 5 fell, 130 interrupted.
    """


_COMMANDS = (
    *(run, robot, stabilizer, walk, view),
    *(topics, echo, hz, record, replay, log),
    *(scenarios, robots, settings, doctor, margins),
    *(sweep, tune, report, reproduce, bench),
    *(router, relay, certs, check_robot, tare, identify),
    *(new_robot, check_robot_file),
)
"""In the order of the help."""

for _command in _COMMANDS:
    if isinstance(_command, typer.Typer):
        app.add_typer(_command, name=_command.info.name)
    else:
        app.command(_command.__name__.replace("_", "-"), cls=Command)(_command)
