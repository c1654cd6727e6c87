"""The required verdict of a conformance run on a sound robot, on any machine."""

from __future__ import annotations

import json
import subprocess

OF_THE_MACHINE = (".rate", ".jitter")
"""Checks that may fail on a busy machine, which cannot keep 1000 ticks a second."""


def check_passes_but_for_time(done: subprocess.CompletedProcess[str]) -> None:
    """Check that all others passed, and that verdict and exit code agree."""
    report = json.loads(done.stdout)
    failed = [finding for finding in report["findings"] if not finding["passed"]]
    wrong = [f for f in failed if not f["name"].endswith(OF_THE_MACHINE)]
    assert not wrong, wrong
    assert len(report["findings"]) > len(failed) + 30
    assert report["passed"] is not bool(failed)
    assert done.returncode == (1 if failed else 0)
