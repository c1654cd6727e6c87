"""Offsets of the ankle sensors: measured on a live robot, stored, subtracted."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from surefoot.robot_io.robot import Tare, load_robot, load_tare, save_tare, tare_path
from surefoot.schemas.errors import FileFormatError
from tests.command import REPOSITORY, Surefoot, environment
from tests.hanging_driver import OFFSET
from tests.patient_robot import JUDGED, patient_robot_file
from tests.support import PATIENCE_S

pytestmark = pytest.mark.process

CLOSE = 1e-3


@contextmanager
def hanging(endpoints: Path, robot: Path) -> Iterator[list[str]]:
    """Serve a robot on its left foot until the context is left; then tell its log."""
    words = [sys.executable, "-m", "tests.hanging_driver", endpoints, robot]
    driver = subprocess.Popen(
        words, env=environment(), cwd=REPOSITORY, stderr=subprocess.PIPE, text=True
    )
    said: list[str] = []
    try:
        yield said
        driver.send_signal(signal.SIGTERM)
        said.append(driver.communicate(timeout=PATIENCE_S)[1])
        assert driver.returncode == 0
    finally:
        driver.kill()
        driver.wait()


def test_what_is_measured_is_taken_off_from_then_on(
    surefoot_here: Surefoot, endpoint_file: Path, tmp_path: Path
) -> None:
    robot = patient_robot_file(tmp_path, **JUDGED)
    words = ["tare", "--endpoints", endpoint_file, "--robot", robot, "--json"]
    words += ["--wait", PATIENCE_S, "--duration", 1]
    with hanging(endpoint_file, robot) as first:
        refused = surefoot_here(*words)
        assert refused.returncode == 2
        assert "the left foot feels" in refused.stderr
        assert not tare_path(robot).exists()
        done = surefoot_here(*words, "--foot", "right")
        assert done.returncode == 0, done.stderr
        # The driver takes nothing off yet.
        twice = surefoot_here(*words, "--foot", "right")
        assert twice.returncode == 0, twice.stderr
        np.testing.assert_allclose(
            json.loads(twice.stdout)["right"], OFFSET, atol=CLOSE
        )
    assert "no offsets of its ankle sensors are stored" in first[0]
    told = json.loads(done.stdout)
    np.testing.assert_allclose(told["right"], OFFSET, atol=CLOSE)
    assert told["left"] == [0.0] * 6
    with hanging(endpoint_file, robot) as then:
        again = surefoot_here(*words, "--foot", "right")
    assert "no offsets" not in then[0]
    assert again.returncode == 0, again.stderr
    np.testing.assert_allclose(json.loads(again.stdout)["right"], OFFSET, atol=CLOSE)
    stored = load_tare(robot)
    assert stored.left == [0.0] * 6
    np.testing.assert_allclose(stored.right, OFFSET, atol=CLOSE)
    assert stored.robot == load_robot(robot).file.name
    assert stored.measured_on


def test_feet_are_measured_one_after_the_other_with_the_same_process() -> None:
    def measured(tare: Tare, **found: float) -> Tare:
        sides = {side: np.full(6, value) for side, value in found.items()}
        return tare.measured(sides, robot="r", instance="a", day="today")  # type: ignore[arg-type]

    one = measured(Tare(left=[1.0] * 6), left=2.0)
    both = measured(one, right=5.0)
    assert (both.left, both.right) == ([3.0] * 6, [5.0] * 6)
    assert measured(both, left=2.5).left == [3.5] * 6
    later = both.measured({"left": np.ones(6)}, robot="r", instance="b", day="today")
    assert later.left == [4.0] * 6


def test_a_file_that_is_none_is_refused_by_name(tmp_path: Path) -> None:
    robot = tmp_path / "mine.toml"
    assert load_tare(robot).is_zero
    path = save_tare(robot, Tare(left=[1.0] * 6))
    assert path.name == "mine.tare.toml"
    assert load_tare(robot).left == [1.0] * 6
    for damaged in ("left = [1.0]\n", ""):
        path.write_text(damaged)
        with pytest.raises(FileFormatError, match=r"mine\.tare\.toml"):
            load_tare(robot)
