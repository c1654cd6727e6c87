"""The example of a driver, as a user would run it, against the conformance run."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

from tests.command import REPOSITORY, Surefoot, environment
from tests.patient_robot import JUDGED, patient_robot_file
from tests.robot_io.conformance.verdict import check_passes_but_for_time
from tests.support import PATIENCE_S, free_port

DRIVER = REPOSITORY / "deploy" / "driver" / "acme_driver.py"
MOST_LINES = 100


def test_the_example_driver_passes(surefoot: Surefoot, tmp_path: Path) -> None:
    locator = f"tcp/127.0.0.1:{free_port()}"
    file = tmp_path / "endpoints.toml"
    file.write_text(f'listen = ["{locator}"]\nconnect = ["{locator}"]\n')
    robot = patient_robot_file(tmp_path, **JUDGED)
    words = [sys.executable, DRIVER, file, robot]
    driver = subprocess.Popen(words, env=environment())
    try:
        words = ["--endpoints", file, "--robot", robot, "--wait", PATIENCE_S]
        done = surefoot("check-robot", *words, "--json")
        check_passes_but_for_time(done)
        driver.send_signal(signal.SIGTERM)
        assert driver.wait(PATIENCE_S) == 0
    finally:
        driver.kill()
        driver.wait()


def test_the_example_is_short() -> None:
    assert len(DRIVER.read_text().splitlines()) < MOST_LINES
