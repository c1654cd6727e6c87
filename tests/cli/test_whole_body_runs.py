"""Both controllers through the command line, on shipped scenarios."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.command import Surefoot, cut_short

MOVING = """
name = "moving"
duration_s = 1.0
[[platform]]
foot = "both"
  [[platform.motion]]
  axis = "roll"
  kind = "ramp"
  amplitude_deg = 6.0
  rate_deg_s = 20.0
  start_s = 0.4
  [[platform.motion]]
  axis = "z"
  kind = "ramp"
  amplitude_m = -0.03
  rate_m_s = 0.1
  start_s = 0.4
[sensors]
force_noise_n = 2.0
moment_noise_nm = 0.1
gyro_noise_rad_s = 0.002
accel_noise_m_s2 = 0.05
[delay]
command_ms = {command_ms}
"""


def run(surefoot: Surefoot, scenario: object, *extra: object) -> dict[str, Any]:
    """Return the JSON of a run that stood."""
    done = surefoot("run", scenario, "--json", *extra)
    assert done.returncode == 0, done.stderr
    result: dict[str, Any] = json.loads(done.stdout)
    assert not result["fell"]
    assert result["qp_failures"] == 0
    assert result["refused"] == {}
    return result


@pytest.mark.usual("whole-body-3.0")
@pytest.mark.parametrize(("law", "command_ms"), [("whole-body", 3.0), ("zmp", 1.0)])
def test_two_processes_and_one_are_the_same_run_bit_for_bit(
    surefoot: Surefoot, tmp_path: Path, law: str, command_ms: float
) -> None:
    """With a delay, too: an answer acts on its own tick."""
    scenario = tmp_path / "moving.toml"
    scenario.write_text(MOVING.format(command_ms=command_ms))
    words = ("--controller", law, "--seed", 3)
    inline, lockstep = (
        run(surefoot, scenario, *words, *more) for more in (["--inline"], [])
    )
    assert lockstep["controller"] == law
    assert lockstep["log_sha256"] == inline["log_sha256"]
    assert lockstep["com_error_rms_mm"] == inline["com_error_rms_mm"]
    assert lockstep["deadline_misses"] == 0


def test_slow_platform_is_balanced_within_its_bounds(
    surefoot: Surefoot, tmp_path: Path
) -> None:
    """Over more than one of its heaves and rolls."""
    scenario = cut_short("moving-platform-slow", tmp_path, 7.0)
    result = run(surefoot, scenario, "--inline")
    x, y, z = result["com_error_rms_mm"]
    assert max(x, y) <= 6.0
    assert max(result["com_error_max_mm"][:2]) <= 15.0
    assert z <= 15.0
    assert result["contact_lost_s"] == [0.0, 0.0]


def test_fast_platform_is_balanced_within_its_bounds(
    surefoot: Surefoot, tmp_path: Path
) -> None:
    """Over two of its rolls, and more of its heaves."""
    scenario = cut_short("moving-platform-fast", tmp_path, 4.0)
    result = run(surefoot, scenario, "--inline")
    x, y, _ = result["com_error_rms_mm"]
    assert max(x, y) <= 10.0
    assert max(result["com_error_max_mm"][:2]) <= 25.0
    assert result["contact_lost_s"] == [0.0, 0.0]


def test_shipped_settings_are_given_by_name(
    surefoot: Surefoot, short_scenario: Path
) -> None:
    words = ("--controller", "zmp", "--inline")
    default = run(surefoot, short_scenario, *words)
    tuned = run(surefoot, short_scenario, *words, "--settings", "zmp-tuned")
    assert tuned["log_sha256"] == default["log_sha256"]


def test_slow_platform_is_survived_by_the_baseline(
    surefoot: Surefoot, tmp_path: Path
) -> None:
    scenario = cut_short("moving-platform-slow", tmp_path, 6.0)
    result = run(surefoot, scenario, "--inline", "--controller", "zmp")
    assert result["contact_lost_s"] == [0.0, 0.0]
