"""The ZMP baseline through the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tests.cli.test_whole_body_runs import MOVING
from tests.command import Surefoot, cut_short

ZMP = ("--controller", "zmp")


def run(surefoot: Surefoot, scenario: object, *extra: object) -> dict[str, Any]:
    """The JSON of a run that stood."""
    done = surefoot("run", scenario, "--json", *ZMP, *extra)
    assert done.returncode == 0, done.stderr
    result: dict[str, Any] = json.loads(done.stdout)
    assert not result["fell"]
    assert result["controller"] == "zmp"
    assert result["qp_failures"] == 0
    return result


def test_two_processes_and_one_are_the_same_run_bit_for_bit(
    surefoot: Surefoot, tmp_path: Path
) -> None:
    scenario = tmp_path / "moving.toml"
    scenario.write_text(MOVING.format(command_ms=1.0))
    lockstep = run(surefoot, scenario, "--seed", 3)
    inline = run(surefoot, scenario, "--seed", 3, "--inline")
    assert lockstep["log_sha256"] == inline["log_sha256"]
    assert lockstep["deadline_misses"] == 0


def test_shipped_settings_are_given_by_name(
    surefoot: Surefoot, short_scenario: Path
) -> None:
    words = ("--inline", "--settings")
    default = run(surefoot, short_scenario, "--inline")
    tuned = run(surefoot, short_scenario, *words, "zmp-tuned")
    assert tuned["log_sha256"] == default["log_sha256"]


def test_unknown_settings_list_the_shipped_ones(
    surefoot: Surefoot, short_scenario: Path
) -> None:
    done = surefoot("run", short_scenario, *ZMP, "--settings", "zmp-stok")
    assert done.returncode == 2
    assert "zmp-stok" in done.stderr
    assert "zmp-stock, zmp-tuned" in done.stderr


def test_slow_platform_is_survived_with_the_tuned_settings(
    surefoot: Surefoot, tmp_path: Path
) -> None:
    scenario = cut_short("moving-platform-slow", tmp_path, 6.0)
    result = run(surefoot, scenario, "--inline")
    assert result["contact_lost_s"] == [0.0, 0.0]
