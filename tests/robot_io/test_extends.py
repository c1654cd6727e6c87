"""Robot files that extend another one."""

from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.recording.contents import attachments
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


@pytest.mark.parametrize("name", ["a b/../zz", "..", "", "a\\\\b", "a\\nb", "a" * 101])
def test_a_name_that_is_no_file_name_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'extends = "{find_robot("walker")}"\nname = "{name}"\n')
    with pytest.raises(
        FileFormatError, match=r"mine.toml: name: got .*, expected one line"
    ):
        load_robot(path)
    path.write_text(f'extends = "{find_robot("walker")}"\nname = "天工 v1.2"\n')
    assert load_robot(path).file.name == "天工 v1.2"


def test_only_one_step_and_only_to_a_file_that_is_there(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'extends = "{find_robot("walker-real")}"\n')
    with pytest.raises(FileFormatError, match="itself extends another"):
        load_robot(str(path))
    path.write_text('extends = "nothing.toml"\n')
    with pytest.raises(FileFormatError, match=r"nothing.toml: no such file"):
        load_robot(str(path))


def test_a_shipped_robot_is_extended_by_its_name_but_a_file_there_comes_first(
    tmp_path: Path,
) -> None:
    path, near = tmp_path / "mine.toml", tmp_path / "walker"
    path.write_text('extends = "walker"\nname = "mine"\n')
    mine = load_robot(path)
    assert mine.file.joint == load_robot("walker").file.joint
    (below,) = (a for a in attachments(mine, []) if a.name == "robot-below.toml")
    assert below.data == find_robot("walker").read_bytes()
    near.write_text(f'extends = "{find_robot("walker")}"\n')
    with pytest.raises(FileFormatError, match="itself extends another"):
        load_robot(path)


def test_a_profile_of_ones_own_stands_beside_those_of_the_file_below(
    tmp_path: Path,
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        f'extends = "{find_robot("walker")}"\n[servo.profiles.ideal]\nlag_s = 0.003\n'
        "[servo.profiles.mine]\nvelocity_limit_rad_s = 2.0\nlag_s = 0.01\n"
    )
    profiles, below = load_robot(path).file.servo.profiles, load_robot("walker")
    assert profiles["mine"].velocity_limit_rad_s == 2.0
    assert profiles["harmonic"] == below.file.servo.profiles["harmonic"]
    assert profiles["ideal"].lag_s == 0.003
    limit = below.file.servo.profiles["ideal"].velocity_limit_rad_s
    assert profiles["ideal"].velocity_limit_rad_s == limit


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ("3", "mine.toml: extends: got 3, expected the path of a robot file"),
        ('["a.toml"]', r"extends: got \['a.toml'\], expected the path"),
        ('"walkr.toml"', r"mine.toml: extends: .*walkr.toml: no such file"),
        ('"mine.toml"', "mine.toml: extends: names this file itself"),
    ],
)
def test_who_extends_what_cannot_be_is_named(
    value: str, told: str, tmp_path: Path
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f"extends = {value}\n")
    with pytest.raises(FileFormatError, match=told):
        load_robot(path)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (
            "[servo.profiles.mine]\nvelocity_limit_rad_s = 1.0\nlag_s = -1.0",
            r"servo.profiles.mine.lag_s: got -1.0, expected a number >= 0.0",
        ),
        (
            "[servo.profiles.mine]\nlag_s = 0.1",
            "servo.profiles.mine.velocity_limit_rad_s: is missing$",
        ),
        (
            "[servo.profiles.mine]\nvelocity_limit_rad_s = 1.0\nlag_s = 0.1\nlagg = 1",
            "servo.profiles.mine.lagg: no such key; did you mean 'lag_s'",
        ),
        ('[keys]\njoints = "a"\nimu = 3', "keys.imu: got 3, expected a text"),
        ('name = "\\u0000"', "name: got .*, expected one line"),
    ],
)
def test_the_key_of_a_table_is_named(line: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'extends = "{find_robot("walker")}"\n{line}\n')
    with pytest.raises(FileFormatError, match=told):
        load_robot(path)


def test_a_file_of_windows_is_read(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f'extends = "{find_robot("walker")}"\n', encoding="utf-8-sig")
    assert load_robot(path).file.name == "walker"
