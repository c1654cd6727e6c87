"""Says at the end of a command that what it heard has holes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from surefoot.exit_codes import ExitCode

if TYPE_CHECKING:
    from surefoot.robot_io.client_side.read_only_client import Absences


def tell_absences(absences: Absences) -> None:
    """Say when the robot was away.

    Args:
        absences: of the client; nothing is said when there are none.

    Raises:
        Exit: with code 1, when it was away: what was told is not all.
    """
    from surefoot.cli.console import print_note

    if absences.times:
        print_note(f"{absences}; what came meanwhile is missing here")
        raise typer.Exit(ExitCode.FAILED)
