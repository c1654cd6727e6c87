"""The command ``surefoot`` as a user runs it: a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from tests.support import PATIENCE_S

REPOSITORY = Path(__file__).parents[1]
PLAIN = {"NO_COLOR": "1", "COLUMNS": "200"}
DIALING = ("stabilizer", "record")
Surefoot = Callable[..., subprocess.CompletedProcess[str]]


def environment() -> dict[str, str]:
    """Plain output, and this code whatever is installed."""
    return {**os.environ, "PYTHONPATH": str(REPOSITORY), **PLAIN}


def command(*words: object) -> list[str]:
    """Command line of a process of its own.

    One that dials a robot goes on dialing until it is there, unless told otherwise: the
    robot's process may be slower to start.

    Args:
        words: what follows ``surefoot``.
    """
    line = [sys.executable, "-m", "surefoot.cli", *map(str, words)]
    if words[0] in DIALING and "--wait" not in words:
        line += ["--wait", str(PATIENCE_S)]
    return line


def run_surefoot(
    *arguments: object, cwd: Path | None = None, patience_s: float = PATIENCE_S
) -> subprocess.CompletedProcess[str]:
    """Run a command of ``surefoot`` to its end.

    Args:
        arguments: the words after ``surefoot``.
        cwd: the folder it starts in.
        patience_s: how long it may take.
    """
    return subprocess.run(
        command(*arguments),
        cwd=cwd,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=patience_s,
        check=False,
    )


def run_python(
    *words: object, cwd: Path | None = None, **more: str
) -> subprocess.CompletedProcess[str]:
    """Run this Python to its end.

    Args:
        words: what follows ``python``.
        cwd: the folder it starts in.
        more: of the environment.
    """
    return subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=cwd,
        env={**environment(), **more},
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


def scenario_file(
    folder: Path, duration_s: float, *, name: str = "still", more: str = ""
) -> Path:
    """A scenario on firm ground, named as its file.

    Args:
        folder: gets the file.
        duration_s: how long it takes [s].
        name: of the scenario.
        more: what else it says.
    """
    path = folder / f"{name}.toml"
    path.write_text(f'name = "{name}"\nduration_s = {duration_s}\n{more}')
    return path


def cut_short(name: str, folder: Path, duration_s: float) -> Path:
    """A shipped scenario that ends earlier.

    Args:
        name: of the scenario.
        folder: gets a file of that name.
        duration_s: how long it takes [s].
    """
    shipped = REPOSITORY / "sim_robot" / "scenarios" / f"{name}.toml"
    lines = [
        f"duration_s = {duration_s}" if line.startswith("duration_s") else line
        for line in shipped.read_text().splitlines()
    ]
    path = folder / shipped.name
    path.write_text("\n".join(lines))
    return path
