"""The study of imperfect robots: the drawn robots, and the table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from benchmarks import reality
from benchmarks.reality import LINES, Line, RealRun, draw, robot_of, table
from surefoot.robot_io.robot import load_robot
from surefoot.sim_robot.plant import Plant
from surefoot.stabilizer.model import RobotModel


def run_of(line: Line, folder: Path, *, ground: str, number: int = 0) -> RealRun:
    return RealRun(
        line.name,
        number,
        "whole-body",
        line.servo_profile,
        ground=ground,
        of=line,
        mounted=robot_of(line, folder),
    )


@pytest.mark.parametrize("ground", reality.GROUND)
def test_every_line_fits_every_ground(ground: str, tmp_path: Path) -> None:
    for line in (*LINES, draw(3)):
        run = run_of(line, tmp_path, ground=ground)
        plan = run.plan(robot="walker", overrides=())
        Plant(plan.robot, plan.scenario, seed=0)


def test_a_robot_is_drawn_with_its_number(tmp_path: Path) -> None:
    first, again, other = draw(1), draw(1), draw(2)
    assert first.tables == again.tables
    assert first.tables != other.tables
    assert first.drawing is not None
    mounted = RobotModel(load_robot(str(robot_of(first, tmp_path)))).T_base_imu
    walker = RobotModel(load_robot("walker")).T_base_imu
    assert np.linalg.norm(mounted.rotation - walker.rotation) > 0.1


def test_grounds_are_runs_of_their_own(tmp_path: Path) -> None:
    keys = {run_of(LINES[0], tmp_path, ground=on).key for on in reality.GROUND}
    assert len(keys) == len(reality.GROUND)


def test_the_table_counts_by_line_and_by_ground(tmp_path: Path) -> None:
    runs = [
        run_of(LINES[0], tmp_path, ground="standing", number=number)
        for number in range(3)
    ]
    rows: list[dict[str, Any]] = [
        {"outcome": "stood", "com_error_rms_mm": [1.0, 0.5, 3.0]},
        {"outcome": "stood", "com_error_rms_mm": [0.5, 2.0, 1.0]},
        {"outcome": "fell", "com_error_rms_mm": None},
    ]
    told = table(runs, rows)
    assert "| none | 2 of 3 (21 to 94 %): 1.0; 2.0; 3.0 |" in told
    assert "standing: 2 of 3 (21 to 94 %) stood" in told


@pytest.mark.closed_loop
def test_a_robot_with_everything_off_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(reality.GROUND, "moving-platform-fast", 3.0)
    run = run_of(draw(12), tmp_path, ground="moving-platform-fast")
    row = run.run(run.plan(robot="walker", overrides=()))
    assert row["outcome"] == "stood"
    assert row["com_error_rms_mm"][2] < 20.0
    assert msgspec.json.decode(msgspec.json.encode(row)) == row
