"""Starts commands side by side."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.command import command, environment

Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Start commands that talk to each other; each has a file for its stderr."""
    processes: list[subprocess.Popen[str]] = []

    def start_one(name: str, *arguments: object) -> subprocess.Popen[str]:
        with (tmp_path / f"{name}.log").open("w") as log:
            process = subprocess.Popen(
                command(name, *arguments),
                env=environment(),
                text=True,
                stdout=subprocess.PIPE,
                stderr=log,
            )
        processes.append(process)
        return process

    yield start_one
    for process in processes:
        process.kill()
        process.communicate()
