from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
TIMEOUT_S = 120.0
Surefoot = Callable[..., subprocess.CompletedProcess[str]]


def environment() -> dict[str, str]:
    """Plain output, and this code whatever is installed."""
    return {
        **os.environ,
        "PYTHONPATH": str(REPOSITORY),
        "NO_COLOR": "1",
        "COLUMNS": "200",
    }


@pytest.fixture
def surefoot(tmp_path: Path) -> Surefoot:
    """Run a command of ``surefoot`` in an empty folder."""
    work = tmp_path / "work"
    work.mkdir()

    def run(*arguments: object) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "surefoot.cli", *map(str, arguments)],
            cwd=work,
            env=environment(),
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )

    return run


@pytest.fixture
def short_scenario(tmp_path: Path) -> Path:
    """Standing on firm ground for a fraction of a second."""
    path = tmp_path / "short.toml"
    path.write_text(
        'name = "short"\nduration_s = 0.3\n[sensors]\nforce_noise_n = 2.0\n'
    )
    return path
