"""Folders of runs for the tests of reports."""

from __future__ import annotations

import subprocess
from pathlib import Path

from tests.command import run_surefoot

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
    """Run a short scenario over the bus unless told otherwise.

    Args:
        folder: gets scenario and run.
        words: options of ``surefoot run``; the last one names the run.
    """
    scenario = folder / "heaving.toml"
    scenario.write_text(SCENARIO)
    *options, name = words
    done = run_surefoot("run", scenario, "--out", folder / name, *options)
    assert done.returncode in (0, 5), (done.returncode, done.stderr)
    return folder / name


def make_report(*words: object) -> subprocess.CompletedProcess[str]:
    """Run ``surefoot report``."""
    return run_surefoot("report", *words)
