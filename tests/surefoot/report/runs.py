"""Folders of runs for the tests of reports."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.command import run_surefoot
from tests.once import made_once

SCENARIO = """
name = "heaving ground"
duration_s = 1.5
[[platform]]
foot = "both"
  [[platform.motion]]
  axis = "z"
  kind = "sine"
  amplitude_m = 0.02
  frequency_hz = 1.0
[[push]]
body = "torso"
force_n = [0.0, 40.0, 0.0]
start_s = 0.8
duration_s = 0.1
[sensors]
force_noise_n = 2.0
"""


def make_run(folder: Path, *words: str) -> Path:
    """Run a short scenario, by default over the bus.

    Args:
        folder: where scenario and run are written.
        words: options of ``surefoot run``; the last one names the run.
    """
    scenario = folder / "heaving.toml"
    scenario.write_text(SCENARIO)
    *options, name = words
    done = run_surefoot("run", scenario, "--out", folder / name, *options)
    assert done.returncode in (0, 5), (done.returncode, done.stderr)
    return folder / name


def shared_runs(folders: pytest.TempPathFactory) -> Path:
    """Return runs ``bus``, ``inline`` and ``zmp`` of one scenario, only to be read."""

    def make(folder: Path) -> None:
        make_run(folder, "--set", "tsid.base_kp=120", "bus")
        make_run(folder, "--inline", "inline")
        make_run(folder, "--controller", "zmp", "zmp")

    return made_once(folders, "runs", make)


def shared_page(folders: pytest.TempPathFactory) -> Path:
    """Return the page about ``bus`` and ``zmp`` of these runs, only to be read."""

    def make(folder: Path) -> None:
        runs, out = shared_runs(folders), folder / "page"
        done = make_report(runs / "bus", runs / "zmp", "--out", out)
        assert done.returncode == 0, done.stderr
        assert done.stdout.strip() == str(out / "index.html")

    return made_once(folders, "report", make) / "page"


def make_report(*words: object) -> subprocess.CompletedProcess[str]:
    """Run ``surefoot report``."""
    return run_surefoot("report", *words)
