"""Robot files from a URDF by the command line, and their check."""

from __future__ import annotations

import json
from pathlib import Path

from surefoot.robot_io.robot import load_robot
from tests.command import Surefoot

WALKER = load_robot("walker").urdf_path
FEET = ("--left-sole", "left_sole", "--right-sole", "right_sole")


def test_a_urdf_becomes_a_robot_file_that_is_judged(
    surefoot_here: Surefoot, tmp_path: Path
) -> None:
    made = surefoot_here(
        *("new-robot", str(WALKER), *FEET, "--name", "mine"),
        *("--out", str(tmp_path / "robot")),
    )
    assert made.returncode == 0, made.stderr
    assert {path.name for path in (tmp_path / "robot").iterdir()} == {
        "mine.toml",
        "mine.urdf",
    }
    for word in ("found", "guessed", "surefoot run standing --robot"):
        assert word in made.stdout
    assert "# guessed" in (tmp_path / "robot" / "mine.toml").read_text()
    file = str(tmp_path / "robot" / "mine.toml")
    judged = surefoot_here("check-robot-file", file, "--json")
    assert judged.returncode == 0, judged.stderr
    report = json.loads(judged.stdout)
    assert {f["verdict"] for f in report["findings"]} == {"ok"}
    assert {fit["name"] for fit in report["scenarios"]} >= {"standing"}
    words = ("new-robot", WALKER, *FEET, "--name", "mine", "--out", tmp_path / "robot")
    again = surefoot_here(*words)
    assert again.returncode == 2
    assert "--overwrite" in again.stderr
    assert surefoot_here(*words, "--overwrite").returncode == 0
    mine = tmp_path / "robot" / "mine.urdf"
    mine.write_text("<robot/> <!-- drawn by hand -->")
    refused = surefoot_here(*words, "--overwrite")
    assert refused.returncode == 2
    assert "'by surefoot new-robot'" in refused.stderr
    assert mine.read_text() == "<robot/> <!-- drawn by hand -->"


def test_what_cannot_be_is_one_line_and_exit_code_2(
    surefoot_here: Surefoot, tmp_path: Path
) -> None:
    done = surefoot_here(
        *("new-robot", str(WALKER), "--left-sole", "l_foot", "--right-sole", "r_foot"),
        *("--out", str(tmp_path / "robot")),
    )
    assert done.returncode == 2
    assert done.stderr.count("surefoot:") == 1
    assert "left_foot" in done.stderr
    assert not (tmp_path / "robot").exists()
