"""The command ``surefoot`` as a user runs it: a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from tests.support import PATIENCE_S

REPOSITORY = Path(__file__).parents[1]
Surefoot = Callable[..., subprocess.CompletedProcess[str]]


def environment() -> dict[str, str]:
    """Plain output, and this code whatever is installed."""
    return {
        **os.environ,
        "PYTHONPATH": str(REPOSITORY),
        "NO_COLOR": "1",
        "COLUMNS": "200",
    }


def run_surefoot(
    *arguments: object, cwd: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a command of ``surefoot`` to its end.

    Args:
        arguments: the words after ``surefoot``.
        cwd: the folder it starts in.
    """
    return subprocess.run(
        [sys.executable, "-m", "surefoot.cli", *map(str, arguments)],
        cwd=cwd,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
