"""A run on recorded ground keeps its record, and can be repeated without the file."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import surefoot as sf

SCENARIO = """
name = "shaken"
duration_s = 0.05

[[platform]]
foot = "both"

[[platform.motion]]
axis = "y"
kind = "recorded"
file = "data/shake.csv"
quantity = "position"
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    (tmp_path / "data").mkdir()
    lines = [f"{0.01 * i},{0.01 * math.sin(0.3 * i)}" for i in range(30)]
    (tmp_path / "data" / "shake.csv").write_text("\n".join(lines))
    path = tmp_path / "shaken.toml"
    path.write_text(SCENARIO)
    return path


def test_a_kept_run_needs_its_record_no_more(scenario: Path, tmp_path: Path) -> None:
    run = sf.simulate("walker", scenario, controller="hold")
    (ground,) = run.result.recorded_ground
    assert (ground.file, ground.axis, ground.platform) == ("shake.csv", "y", 0)
    assert ground.stroke == pytest.approx(0.02, rel=0.05)
    run.save(tmp_path / "out")
    (tmp_path / "data" / "shake.csv").unlink()
    again = sf.load_run(tmp_path / "out")
    assert again.result.recorded_ground == [ground]
    repeated = sf.simulate("walker", again.scenario, controller="hold").result
    assert repeated.log_sha256 == run.result.log_sha256
    assert repeated.recorded_ground[0].sha256 == ground.sha256


def test_a_missing_record_is_told_before_anything_starts(scenario: Path) -> None:
    (scenario.parent / "data" / "shake.csv").unlink()
    words = r"shaken\.toml: platform\[0\]\.motion\[0\]\.file: .*cannot be read"
    with pytest.raises(sf.ScenarioError, match=words):
        sf.simulate("walker", scenario, controller="hold")
