from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.command import Surefoot, cut_short, run_surefoot, scenario_file
from tests.once import made_once

NOISE = """
[sensors]
force_noise_n = 2.0
gyro_noise_rad_s = 0.002
accel_noise_m_s2 = 0.05
"""
Check = Callable[..., tuple[int, dict[str, Any]]]


def standing(folder: Path, duration_s: float, more: str = "") -> Path:
    return scenario_file(folder, duration_s, name="standing", more=NOISE + more)


def record_of(folder: Path, scenario: Path, *words: object) -> Path:
    """Run a scenario on the bus; return its record."""
    out = folder / "run"
    done = run_surefoot("run", scenario, "--out", out, *words)
    assert done.returncode == 0, done.stderr
    return out / "run.mcap"


@pytest.fixture(scope="session")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a record of the moving platform in lockstep, not to be changed."""

    def make(folder: Path) -> None:
        record_of(folder, cut_short("moving-platform-fast", folder, 1.0))

    return made_once(tmp_path_factory, "recorded", make) / "run" / "run.mcap"


@pytest.fixture
def check(surefoot_here: Surefoot) -> Check:
    """Replay through the controller; return exit code and result."""

    def run(path: Path, *words: object) -> tuple[int, dict[str, Any]]:
        done = surefoot_here("replay", "--controller", path, "--json", *words)
        assert done.returncode in (0, 1), done.stderr
        return done.returncode, json.loads(done.stdout)

    return run
