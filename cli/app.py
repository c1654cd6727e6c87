"""The commands of ``surefoot``; what they need is imported when they run."""

from __future__ import annotations

from typing import Annotated

import typer

from surefoot.cli.bus.echo_command import echo
from surefoot.cli.bus.hz_command import hz
from surefoot.cli.bus.topics_command import topics
from surefoot.cli.certs_command import certs
from surefoot.cli.check_robot_command import check_robot
from surefoot.cli.doctor_command import doctor
from surefoot.cli.log_command import log
from surefoot.cli.options import Command
from surefoot.cli.record_command import record
from surefoot.cli.relay_command import relay
from surefoot.cli.replay_command import replay
from surefoot.cli.report_command import report
from surefoot.cli.reproduce_command import reproduce
from surefoot.cli.robot_command import robot
from surefoot.cli.router_command import router
from surefoot.cli.run_command import run
from surefoot.cli.scenarios_command import scenarios
from surefoot.cli.stabilizer_command import stabilizer
from surefoot.cli.sweep_command import sweep
from surefoot.cli.view_command import view

app = typer.Typer(
    name="surefoot",
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


app.command(cls=Command)(run)
app.command(cls=Command)(robot)
app.command(cls=Command)(stabilizer)
app.command(cls=Command)(view)
app.command(cls=Command)(topics)
app.command(cls=Command)(echo)
app.command(cls=Command)(hz)
app.command(cls=Command)(record)
app.command(cls=Command)(replay)
app.add_typer(log, name="log")
app.command(cls=Command)(scenarios)
app.command(cls=Command)(doctor)
app.command(cls=Command)(sweep)
app.command(cls=Command)(report)
app.command(cls=Command)(reproduce)
app.command(cls=Command)(router)
app.command(cls=Command)(relay)
app.command(cls=Command)(certs)
app.command("check-robot", cls=Command)(check_robot)
