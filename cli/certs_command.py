"""``surefoot certs``: a small private authority and everyone's certificates."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def certs(
    out: Annotated[
        Path,
        typer.Option("--out", metavar="DIR", help="Folder for certificates and keys."),
    ],
    hosts: Annotated[
        list[str] | None,
        typer.Option(
            "--host",
            metavar="NAME",
            help="Name or address under which robot or router are dialed, besides "
            "loopback. May be repeated.",
        ),
    ] = None,
    days: Annotated[
        int, typer.Option(min=1, max=3000, help="How long certificates are valid.")
    ] = 365,
    renew: Annotated[
        bool,
        typer.Option(
            "--renew", help="New certificates by the authority that is there already."
        ),
    ] = False,
) -> None:
    """Make certificates for robot, router, stabilizer, operator, planner and observer.

    Give each process its own pair and ca.pem. Keep ca.key.pem off the robot: whoever
    has it can make certificates that command the robot.
    """
    from surefoot.cli.console import print_note
    from surefoot.robot_io.security.certificates import (
        make_certificates,
        renew_certificates,
    )

    make = renew_certificates if renew else make_certificates
    written = make(out, hosts=hosts or [], days=days)
    print_note(
        f"{out}: {len(written)} files, valid for {days} days. Keep ca.key.pem away "
        "from robot and stabilizer; it is needed for --renew alone."
    )
