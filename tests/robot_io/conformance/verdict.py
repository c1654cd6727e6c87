"""What a conformance run must find of a sound robot, on however busy a machine."""

from __future__ import annotations

import json
import subprocess

OF_THE_MACHINE = (".rate", ".jitter")
"""What a machine that is busy with other tests may fail: a thousand ticks a second."""


def check_passes_but_for_time(done: subprocess.CompletedProcess[str]) -> None:
    """Assert that all passed, and that verdict and exit code say what was found."""
    report = json.loads(done.stdout)
    failed = [finding for finding in report["findings"] if not finding["passed"]]
    wrong = [f for f in failed if not f["name"].endswith(OF_THE_MACHINE)]
    assert not wrong, wrong
    assert len(report["findings"]) > len(failed) + 30
    assert report["passed"] is not bool(failed)
    assert done.returncode == (1 if failed else 0)
