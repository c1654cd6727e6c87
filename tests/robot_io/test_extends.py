"""Robot files on top of another one."""

from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.robot_io.robot import find_robot, load_robot
from surefoot.schemas.errors import FileFormatError


def test_the_walker_on_its_own_bus_is_the_walker() -> None:
    walker, real = load_robot("walker"), load_robot("walker-real")
    assert real.urdf_path == walker.urdf_path
    assert real.file.joint == walker.file.joint
    assert real.keys["left_ankle_ft"] == "sensor/ft/lankle"
    assert real.keys["right_ankle_ft"] == "sensor/ft/rankle"
    assert real.keys["imu"] == "sensor/orientus_imu"
    assert real.keys["joints"] == walker.keys["joints"]


def test_tables_are_merged_and_all_else_replaced(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        f'extends = "{find_robot("walker")}"\nnamespace = "mine"\n'
        "[gate]\nstep_limit_rad = 0.005\n"
    )
    mine, walker = load_robot(str(path)), load_robot("walker")
    assert mine.file.namespace == "mine"
    assert mine.file.gate.step_limit_rad == 0.005
    assert mine.file.gate.hold_after_s == walker.file.gate.hold_after_s


def test_only_one_step_and_only_to_a_file_that_is_there(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'extends = "{find_robot("walker-real")}"\n')
    with pytest.raises(FileFormatError, match="itself extends another"):
        load_robot(str(path))
    path.write_text('extends = "nothing.toml"\n')
    with pytest.raises(FileFormatError, match=r"nothing.toml: no such file"):
        load_robot(str(path))
