"""Unusual URDFs become a robot that stands, or are refused in one clear line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from surefoot import load_scenario, simulate
from surefoot.robot_files.new_robot import NewRobot, NewRobotOptions, new_robot
from surefoot.robot_io.errors import RobotFileError
from surefoot.schemas.scenario import scenario_from_table
from surefoot.sim_robot.plant import Plant
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.stance.nominal import stand
from tests.awkward_robot import AWKWARD, make_awkward
from tests.surefoot.robot_files import changed_urdfs as urdf
from tests.surefoot.robot_files.changed_urdfs import FEET, Change, altered, made

LEVEL_RAD, LEVEL_M = 1e-3, 1e-3
UNIT_ON_HEAD = altered("imu_mount", "parent", link="head")


def check_posture(robot: NewRobot) -> None:
    model = RobotModel(robot.robot)
    standing = stand(model)
    assert standing.sole_tilt.max() < LEVEL_RAD
    assert np.abs(standing.sole_yaw).max() < LEVEL_RAD
    assert np.abs(standing.com[:2]).max() < LEVEL_M
    assert standing.soles[0, 1] > standing.soles[1, 1]
    assert standing.plates.min() > 0.0
    assert np.abs(standing.torques / robot.robot.torque_limit).max() < 1.0


def case(
    change: Change, told: str, **options: Any
) -> tuple[Change, NewRobotOptions, str]:
    """Return a change, further options of new-robot, and words of its report."""
    return change, replace(FEET, **options), told


STANDS = {
    "as it is": case(urdf.nothing, "inertial unit: 'imu'"),
    "world, fixed": case(urdf.under_a_world("fixed"), "the base floats"),
    "world, floating": case(urdf.under_a_world("floating"), "the base floats"),
    "unit on the head": case(UNIT_ON_HEAD, "moves against it, by"),
    "toes": case(urdf.with_toes, "below a foot"),
    "fingers": case(urdf.with_fingers, "as fingers do: left_grip, right_grip"),
    "endless wrist": case(
        altered("left_wrist_roll", type="continuous"), "left_wrist_roll"
    ),
    "endless wrist fits a pattern": case(
        altered("left_wrist_roll", type="continuous"), "left_wrist_roll", keep=("*",)
    ),
    "12 joints": case(urdf.nothing, "as asked: head_yaw", legs_only=True),
    "arms fixed by pattern": case(
        urdf.nothing, "14 joints fixed", fix=("*_shoulder_*", "*_wrist_*", "*_elbow")
    ),
    "no efforts": case(
        urdf.with_limits(effort="0", velocity="0"), "torque limits of 28"
    ),
    "no sensor": case(urdf.without_sensor_mounts, "taken to sit at the ankle"),
    "meshes alone": case(urdf.with_meshes_alone, "240 x 120 mm"),
    "lost pictures": case(urdf.with_lost_pictures, "mesh files that are not there"),
    "one knee reversed": case(urdf.with_one_knee_reversed, "knees at 1.28 and -1.28"),
    "impossible inertia, repaired": case(
        urdf.with_impossible_inertia, "repaired: left_thigh", repair_inertias=True
    ),
    "named by its sole frames": case(
        urdf.nothing,
        "above 'left_foot_plate', which weighs 0.456 kg",
        left_sole="left_sole",
        right_sole="right_sole",
    ),
    "as programs export it": case(
        urdf.both(
            *(urdf.without_a_name, urdf.with_halves_of_tags),
            *(urdf.with_axes_of_zeros, urdf.with_a_skin),
        ),
        "28 joints, in the order",
    ),
    "mimic chain": case(urdf.with_a_mimic_chain, "4 joints fixed, they follow another"),
    "other letters": case(
        urdf.in_other_letters, "as asked: \u9996 yaw \u03c8", fix=("\u9996*",)
    ),
    "joint with brackets": case(
        altered("head_yaw", name="head[0]"), "as asked: head[0]", fix=("head[0]",)
    ),
    "mesh named as in a URI": case(
        urdf.with_meshes(filename="package://feet/fo%6Ft.obj"), "240 x 120 mm"
    ),
    "soles turned": case(urdf.with_soles_turned, "left sole: 271 x 155 mm"),
    "mesh mirrored": case(urdf.with_meshes(scale="0.1 0.1 -0.1"), "240 x 120 mm"),
    "joint called as a sole": case(
        altered("head_yaw", name="left_foot_plate"), "271 x 155 mm"
    ),
    "root at the ground": case(
        urdf.rooted_at("0 0 0.97"), "fixed to the base 'base_foo"
    ),
    "root below": case(
        urdf.rooted_at("0 0 1.25"), "fixed to the base 'base_footprint'"
    ),
    "waist below the base": case(urdf.with_a_waist, "both legs hang on them"),
    "weak knees": case(urdf.with_weak_knees, "what a knee can carry"),
    "package of xacros": case(urdf.in_a_package_of_xacros, "robot_xacro/head.stl"),
    "limits without end": case(
        urdf.with_limits(effort="inf", velocity="inf"), "torque limits of 28"
    ),
}


@pytest.mark.parametrize("name", STANDS)
def test_it_becomes_a_robot(name: str, tmp_path: Path) -> None:
    change, options, told = STANDS[name]
    robot = made(tmp_path, change, options)
    check_posture(robot)
    assert told in "\n".join(note.text for note in robot.notes)


def test_frames_may_be_turned_as_they_like(tmp_path: Path) -> None:
    drawn = make_awkward(tmp_path, AWKWARD).robot.urdf_path
    robot = new_robot(drawn, FEET, out=tmp_path / "made")
    check_posture(robot)
    assert robot.robot.left.half_length_m == pytest.approx(0.1357, abs=1e-3)
    assert robot.robot.left.half_width_m == pytest.approx(0.0774, abs=1e-3)


def test_frames_at_the_ground_are_no_fall(tmp_path: Path) -> None:
    robot = made(tmp_path, urdf.rooted_at("0 0 0.97"), FEET).robot
    assert abs(robot.file.nominal_base_height_m) < 0.1
    scenario = msgspec.structs.replace(load_scenario("tilt-ramp-roll"), duration_s=1.5)
    assert simulate(robot, scenario, record=False).outcome.is_up
    # What is fixed to a base without mass is shifted in its place.
    places = []
    for offset in ([0.0, 0.0, 0.0], [0.012, -0.004, 0.006]):
        error = {"com_offset_m": offset}
        table = {"name": "x", "start": {"settle_s": 0.0}, "model_error": error}
        shifted = scenario_from_table({**table, "duration_s": 1.0}, source="x")
        places.append(Plant(robot, shifted, seed=0).view.com.copy())
    np.testing.assert_allclose(places[1] - places[0], offset, atol=1e-9)


def test_a_knee_that_cannot_carry_bends_less(tmp_path: Path) -> None:
    strong = made(tmp_path / "strong", urdf.nothing, FEET).robot
    for rise_m in (None, 0.005):
        weak = made(
            tmp_path / f"weak {rise_m}",
            urdf.with_weak_knees,
            replace(FEET, rise_m=rise_m),
        ).robot
        knee = weak.joint_names.index("left_knee")
        assert abs(weak.nominal[knee]) < 0.8 * abs(strong.nominal[knee])


REFUSED = {
    "endless knee": case(
        altered("left_knee", type="continuous"), "'left_knee' of a leg"
    ),
    "no inertia": case(
        urdf.without_inertia, "'left_ankle_roll' moves link 'left_foot'"
    ),
    "no shapes": case(urdf.without_shapes, "left foot, .*none of them has a shape"),
    "impossible inertia": case(urdf.with_impossible_inertia, "inertia of left_thigh"),
    "sides exchanged": case(
        urdf.nothing,
        "exchange --left-sole and --right-sole",
        left_sole="right_foot_plate",
        right_sole="left_foot_plate",
    ),
    "no such sole": case(urdf.nothing, "left_sole", left_sole="l_sole"),
    "one foot twice": case(
        urdf.nothing, "on one foot", left_sole="left_sole", right_sole="left_foot_plate"
    ),
    "sole above the knee": case(
        urdf.nothing,
        "face|no knee|no posture",
        left_sole="left_thigh",
        right_sole="right_thigh",
    ),
    "unit that moves": case(UNIT_ON_HEAD, "head_yaw", imu="imu"),
    "sensor elsewhere": case(
        urdf.nothing, "does not hang on it", left_ft="right_foot_plate"
    ),
    "endless wrist kept": case(
        altered("left_wrist_roll", type="continuous"),
        "'left_wrist_roll' cannot be kept: it turns without end",
        keep=("*_wrist_*", "left_wrist_roll"),
    ),
    "follower kept": case(
        urdf.with_a_mimic_chain,
        "'left_grip_2' cannot be kept: it follows another joint",
        keep=("left_grip_2",),
    ),
    "no such joint": case(urdf.nothing, "no joint fits 'wings'", fix=("wings",)),
    "millimetres": case(urdf.in_millimetres, "in metres|m away"),
    "ring": case(altered("left_knee", "parent", link="left_foot"), "ring|two joints"),
    "two joints": case(urdf.on_two_joints, "hangs on two joints"),
    "xacro": case(
        altered("left_knee", "origin", xyz="0 0 ${-thigh}"), "expand the xacro"
    ),
    "limits exchanged": case(
        altered("left_knee", "limit", lower="2.2", upper="-0.2"),
        "'left_knee': limit: lower 2.2 is not below",
    ),
    "two bases": case(urdf.with_two_bases, "hangs on no joint, got 'torso', 'stand'"),
    "mesh of no size": case(
        urdf.with_meshes(scale="0 0 0"), "left foot.*flat or empty"
    ),
    "mesh scale in words": case(urdf.with_meshes(scale="1 1"), "left foot|scale"),
    "no yaw at the hip": case(
        urdf.nothing, "in 11 of 12 directions", fix=("*_hip_yaw",)
    ),
    "rooted in a sole": case(urdf.nothing, "whose root is", left_sole="torso"),
    "base called world": case(
        urdf.with_a_link_called("torso", "world"), "stands for the ground"
    ),
    "hand called world": case(
        urdf.with_a_link_called("left_hand", "world"), "stands for the ground"
    ),
    "joint called as Pinocchio's": case(
        altered("left_knee", name="root_joint"), "'root_joint': the name is taken"
    ),
    "turn of no number": case(urdf.with_a_turn_of_no_number, "'tool': origin: rpy"),
    "mesh that is not there": case(
        urdf.with_meshes(filename="feet/lost.stl"),
        r"feet/lost\.stl is not there; .*--package-dir",
    ),
    "mesh that is none": case(
        urdf.with_meshes(filename="feet/page.stl"), "left_foot_plate"
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    change, options, told = REFUSED[name]
    with pytest.raises(RobotFileError, match=told) as refused:
        made(tmp_path, change, options)
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "made").exists()
