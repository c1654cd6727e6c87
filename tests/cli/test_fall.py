"""Each command that reports a fall exits with 5."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Start
from tests.command import Surefoot
from tests.support import PATIENCE_S

FELL = 5


@pytest.fixture
def huge_push(tmp_path: Path) -> Path:
    """Return a push that no controller withstands."""
    path = tmp_path / "huge-push.toml"
    path.write_text(
        'name = "huge push"\nduration_s = 6.0\n[[push]]\nbody = "torso"\n'
        "force_n = [900.0, 0.0, 0.0]\nstart_s = 0.5\nduration_s = 0.2\n"
    )
    return path


def test_a_run_in_which_the_robot_falls(surefoot: Surefoot, huge_push: Path) -> None:
    done = surefoot("run", huge_push, "--json")
    assert done.returncode == FELL, done.stderr
    result = json.loads(done.stdout)
    assert (result["outcome"], result["end"]) == ("fell", "fell")
    assert f"at {result['fell_at_s']:.2f} s: " in result["outcome_detail"]
    assert result["fell"]
    assert result["fell_at_s"] > 0.5


@pytest.mark.usual("0.3-fell: leans by")
@pytest.mark.parametrize(
    ("tilt_limit_rad", "reason"), [(3.0, "fell: at "), (0.3, "fell: leans by")]
)
def test_a_stabilizer_whose_robot_falls(
    start: Start,
    huge_push: Path,
    endpoint_file: Path,
    tmp_path: Path,
    tilt_limit_rad: float,
    reason: str,
) -> None:
    meet = ("--endpoints", endpoint_file)
    robot = start("robot", huge_push, *meet)
    stabilizer = start(
        *("stabilizer", *meet),
        *("--set", f"safety.tilt_limit_rad={tilt_limit_rad}"),
    )
    assert reason in stabilizer.communicate(timeout=PATIENCE_S)[0]
    assert stabilizer.returncode == FELL
    assert reason in (tmp_path / "stabilizer.log").read_text()
    assert "fell at" in robot.communicate(timeout=PATIENCE_S)[0]
    assert robot.returncode == FELL
