from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.robot import ROBOTS_DIR, find_robot, load_robot
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.topics import resolve_keys

WALKER = ROBOTS_DIR / "walker"
COLUMNS = (
    "nominal", "kp", "kd", "armature", "damping", "torque_limit", "velocity_limit",
    "lower", "upper",
)  # fmt: skip


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def refused(path: Path) -> str:
    """Return the refusal of a robot, which must name one of its two files."""
    with pytest.raises((RobotFileError, FileFormatError)) as caught:
        load_robot(str(path))
    assert str(path.parent) in str(caught.value)
    return str(caught.value)


def test_the_walker_loads_by_name_and_by_path() -> None:
    by_name, by_path = load_robot("walker"), load_robot(str(WALKER / "walker.toml"))
    assert by_name.n_a == 28
    assert by_name.file == by_path.file
    assert by_name.period_s == 0.001
    assert (by_name.left.side, by_name.right.side) == ("left", "right")
    assert by_name.keys == resolve_keys({})


@pytest.mark.parametrize("name", COLUMNS)
def test_columns_follow_the_joints_and_cannot_be_written(name: str) -> None:
    column = getattr(load_robot("walker"), name)
    assert column.shape == (28,)
    assert column.dtype == np.float64
    assert column.flags.c_contiguous
    with pytest.raises(ValueError, match="read-only"):
        column[0] = 1.0


def test_the_nominal_posture_is_inside_the_ranges_and_symmetric() -> None:
    robot = load_robot("walker")
    assert np.all(robot.lower <= robot.nominal)
    assert np.all(robot.nominal <= robot.upper)
    posture = dict(zip(robot.joint_names, robot.nominal, strict=True))
    for name, angle in posture.items():
        assert posture[name.replace("left_", "right_")] == angle


def test_a_loaded_robot_is_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        load_robot("walker").path = Path()


def test_servo_profiles_are_chosen_by_name() -> None:
    assert load_robot("walker").servo_profile.lag_s == 0.0
    harmonic = load_robot("walker", servo_profile="harmonic").servo_profile
    assert (harmonic.velocity_limit_rad_s, harmonic.lag_s) == (3.1, 0.020)
    told = r"^--servo-profile: got 'magic'; .* has harmonic, ideal"
    with pytest.raises(FileFormatError, match=told):
        load_robot("walker", servo_profile="magic")


def test_unknown_robots_list_the_shipped_ones(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match="shipped are walker"):
        find_robot("runner")
    with pytest.raises(RobotFileError, match="no such robot file"):
        find_robot(str(tmp_path / "runner.toml"))


def test_key_overrides_reach_the_keys(files: Path) -> None:
    with files.open("a") as file:
        file.write('\n[keys]\nimu = "/sensor/orientus_imu"\n')
    assert load_robot(str(files)).keys["imu"] == "sensor/orientus_imu"


def test_wrong_key_overrides_name_the_file(files: Path) -> None:
    with files.open("a") as file:
        file.write('\n[keys]\nlidar = "a"\n')
    assert "keys.lidar: no such channel" in refused(files)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rate_hz = 1000.0", "rate_hz = 0", "rate_hz"),
        ("kp_nm_rad = 100.0", "kp_nm_rad = nan", "joint[0].kp_nm_rad: got nan"),
        ("kd_nm_s_rad", "kd_nm_rad", "did you mean 'kd_nm_s_rad'"),
        ('side = "left"', 'side = "right"', "expected left, then right"),
        ('profile = "ideal"', 'profile = "odd"', "the file has harmonic, ideal"),
        ('name = "head_pitch"', 'name = "head_yaw"', "listed twice: ['head_yaw']"),
        ('name = "head_pitch"', 'name = "jaw"', "not in walker.urdf: ['jaw']"),
        ('namespace = "walker"', 'namespace = "/walker"', "expected a key such as"),
        ('namespace = "walker"', 'namespace = "**"', "expected a key such as"),
        ('namespace = "walker"', 'namespace = "my//walker"', "expected a key such as"),
        ('namespace = "walker"', 'namespace = "my\\twalker"', "expected a key such"),
        ('urdf = "walker.urdf"', 'urdf = "."', "no such file"),
        ('urdf = "walker.urdf"', 'urdf = "a\\u0000b"', "no such file"),
        ('base_link = "torso"', 'base_link = "trunk"', "base_link: walker.urdf has no"),
        ('base_link = "torso"', 'base_link = "head"', "name the link that all others"),
        ('frame = "left_sole"', 'frame = "l"', "foot[0].sole_frame"),
        ('frame = "left_sole"', 'frame = "left_foot_plate"', "is the ft_link too"),
        ('frame = "left_sole"', 'frame = "left_foot"', "stands above ft_link"),
        ('frame = "left_sole"', 'frame = "right_sole"', "both feet have the sole_fra"),
        ('frame = "imu"', 'frame = "imuu"', "no link 'imuu'; did you mean 'imu'"),
        ('frame = "imu"', 'frame = "left_hand"', "moves against the base 'torso'"),
        ("_height_m = 1.0306", "_height_m = 1030.6", "lie 1.031 below 'torso'"),
        ("torque_limit_nm = 3.5", "torque_limit_nm = 4.5", "but effort 3.5"),
        ("nominal_rad = 1.3", "nominal_rad = 2.9", "outside [-0.2622, 2.2672]"),
        ("soft_lower_rad = 0.2", "soft_lower_rad = 1.4", "soft range [1.4, 2.2672]"),
        ("soft_lower_rad = 0.2", "soft_upper_rad = 3.0", "soft range [-0.2622, 3.0]"),
        ("com_travel_m = [-0.15", "com_travel_m = [0.15", "com_travel_m: got [0.15"),
        ("half_length_m = 0.1357", "half_length_m = 0.2", "make them equal"),
        ("max_command_age_s = 0.008", "max_command_age_s = 0.0005", "a tick of"),
        ("hold_after_s = 0.02", "hold_after_s = 0.0001", "gate.hold_after_s: got"),
        ("hold_after_s = 0.02", "lease_s = 0.0001", "gate.lease_s: got"),
        ("rate_hz = 1000.0", "rate_hz = 1e6", "rate_hz: got"),
        ("rate_hz = 1000.0", "rate_hz = 200.0", "0.005 s at rate_hz = 200"),
        ("position_margin_rad = 0.0", "position_margin_rad = 1.0", "stands at"),
    ],
)
def test_contradictions_are_refused(
    files: Path, old: str, new: str, words: str
) -> None:
    edit(files, old, new)
    assert words in refused(files)
