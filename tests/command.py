"""Runs the command ``surefoot`` as a user does, in a process of its own."""

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
    """Return an environment for plain output and for this code."""
    return {**os.environ, "PYTHONPATH": str(REPOSITORY), **PLAIN}


def command(*words: object) -> list[str]:
    """Return the command line for a process of its own.

    A command that dials a robot keeps dialing until the robot is there, unless told
    otherwise, since the robot's process may start more slowly.

    Args:
        words: the words after ``surefoot``.
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
        cwd: folder to start in.
        patience_s: longest time it may take [s].
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
        words: the words after ``python``.
        cwd: folder to start in.
        more: additional environment variables.
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
    """Write a scenario on firm ground, with the name of its file.

    Args:
        folder: where the file is written.
        duration_s: duration of the scenario [s].
        name: name of the scenario.
        more: further lines of the file.
    """
    path = folder / f"{name}.toml"
    path.write_text(f'name = "{name}"\nduration_s = {duration_s}\n{more}')
    return path


def cut_short(name: str, folder: Path, duration_s: float) -> Path:
    """Write a shorter copy of a shipped scenario.

    Args:
        name: name of the scenario.
        folder: where the file of that name is written.
        duration_s: duration of the copy [s].
    """
    shipped = REPOSITORY / "sim_robot" / "scenarios" / f"{name}.toml"
    lines = [
        f"duration_s = {duration_s}" if line.startswith("duration_s") else line
        for line in shipped.read_text().splitlines()
    ]
    path = folder / shipped.name
    path.write_text("\n".join(lines))
    return path
