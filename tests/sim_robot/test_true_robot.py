from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.schemas.errors import FileFormatError
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.plant import Plant
from surefoot.sim_robot.pushes import CaptureLimit
from tests.sim_robot.conftest import MakePlant


def held(plant: Plant, ticks: int, command: np.ndarray | None = None) -> Plant:
    for _ in range(ticks):
        plant.step(plant.posture if command is None else command)
    return plant


def test_starts_where_and_as_turned_as_asked(make_plant: MakePlant) -> None:
    plain = make_plant()
    turned = make_plant(start={"yaw_deg": 90.0, "position_m": [0.5, -0.3]})
    for name in ("sole_left", "sole_right", "com"):
        x, y, z = getattr(plain.view, name)
        there = getattr(turned.view, name)
        np.testing.assert_allclose(there, [0.5 - y, -0.3 + x, z], atol=1e-6)
    x, y, z = plain.com_reference
    np.testing.assert_allclose(turned.com_reference, [-y, x, z], atol=1e-6)
    forces = turned.view.normal_forces
    np.testing.assert_allclose(forces, plain.view.normal_forces, rtol=1e-3)


def test_platforms_turn_along_and_move_in_the_world(make_plant: MakePlant) -> None:
    ramp = {"axis": "x", "kind": "ramp", "amplitude_m": 0.05, "rate_m_s": 0.5}
    plant = make_plant(
        start={"yaw_deg": 90.0},
        platform=[{"foot": "left", "motion": [ramp]}, {"foot": "right"}],
    )
    plan = plant.world.platforms[0]
    np.testing.assert_allclose(plan.top_centre[:2], plant.view.sole_left[:2], atol=1e-3)
    assert plan.box_centre[0] < -0.05  # outwards, which is now backwards
    assert abs(plan.box_centre[1]) < 1e-9
    held(plant, 200)
    pose = plant.truth().platforms[0].position
    assert pose[0] == pytest.approx(plan.top_centre[0] + 0.05)


def test_a_posture_of_its_own_is_held_from_the_start(
    make_plant: MakePlant, walker: Robot
) -> None:
    deeper = {}
    for side in ("left", "right"):
        for joint, by in (("hip_pitch", -0.1), ("knee", 0.2), ("ankle_pitch", -0.1)):
            name = f"{side}_{joint}"
            index = walker.joint_names.index(name)
            deeper[name] = float(walker.nominal[index] + by)
    plant = make_plant(start={"posture": deeper, "settle_s": 1.0})
    knee = walker.joint_names.index("left_knee")
    assert plant.posture[knee] == deeper["left_knee"]
    assert plant.sense().q[knee] == pytest.approx(deeper["left_knee"], abs=0.02)
    assert sum(plant.view.normal_forces) == pytest.approx(plant.world.weight, rel=1e-2)
    nominal = make_plant()
    assert plant.com_reference[2] == pytest.approx(nominal.com_reference[2])
    assert plant.view.com[2] < nominal.view.com[2] - 0.01


@pytest.mark.parametrize(
    ("start", "words"),
    [
        ({"posture": {"left_kne": 1.0}}, "did you mean 'left_knee'"),
        ({"posture": {"left_knee": 9.0}}, r"start\.posture\.left_knee: got 9 rad"),
        ({"posture": {"left_ankle_pitch": -0.2}}, "the left sole is"),
    ],
)
def test_a_posture_that_cannot_be_is_refused(
    make_plant: MakePlant, start: dict[str, Any], words: str
) -> None:
    with pytest.raises(ScenarioError, match=words):
        make_plant(start=start)


def test_a_payload_weighs_on_the_feet_and_moves_the_com(make_plant: MakePlant) -> None:
    load = {"link": "torso", "mass_kg": 3.0, "offset_m": [0.1, 0.0, 0.2]}
    plain, loaded = make_plant(), make_plant(payload=[load])
    gained = sum(loaded.view.vertical_forces) - sum(plain.view.vertical_forces)
    assert gained == pytest.approx(3.0 * 9.81, rel=1e-2)
    mass = plain.world.weight / 9.81
    body = plain.data.body("torso")
    place = body.xpos + body.xmat.reshape(3, 3) @ [0.1, 0.0, 0.2]
    moved = (mass * plain.view.com + 3.0 * place) / (mass + 3.0)
    np.testing.assert_allclose(loaded.view.com, moved, atol=3e-3)


def test_a_payload_is_grasped_when_its_time_comes(make_plant: MakePlant) -> None:
    load = {"link": "torso", "mass_kg": 3.0, "start_s": 0.1}
    plant = make_plant(payload=[load])
    before = sum(held(plant, 100).view.vertical_forces)
    after = sum(held(plant, 400).view.vertical_forces)
    assert before == pytest.approx(plant.world.weight, rel=1e-3)
    assert after - before == pytest.approx(3.0 * 9.81, rel=0.05)


def test_a_payload_on_no_link_is_refused(make_plant: MakePlant) -> None:
    with pytest.raises(ScenarioError, match="has no link 'torsoo'; did you mean"):
        make_plant(payload=[{"link": "torsoo", "mass_kg": 1.0}])


def test_com_offset_moves_that_of_the_whole_robot(make_plant: MakePlant) -> None:
    plain = make_plant(start={"settle_s": 0.0})
    offset = [0.012, -0.004, 0.006]
    shifted = make_plant(start={"settle_s": 0.0}, model_error={"com_offset_m": offset})
    np.testing.assert_allclose(shifted.view.com - plain.view.com, offset, atol=1e-9)


def test_gravity_of_the_place(make_plant: MakePlant) -> None:
    plant = make_plant(model_error={"gravity_m_s2": 9.764})
    acceleration = np.linalg.norm(plant.sense().linear_acceleration)
    assert acceleration == pytest.approx(9.764, rel=1e-4)
    assert sum(plant.view.vertical_forces) == pytest.approx(
        plant.world.weight, rel=1e-3
    )


def elbow_steps(plant: Plant, robot: Robot, target: float) -> float:
    """Return where an elbow ends that was commanded slowly to a target [rad]."""
    joint = robot.joint_names.index("left_elbow")
    command = robot.nominal.copy()
    for step in range(600):
        share = min(1.0, step / 300)
        command[joint] = robot.nominal[joint] + share * target
        plant.step(command.copy())
    return float(plant.sense().q[joint] - robot.nominal[joint])


def test_backlash_leaves_the_joint_behind_by_half_of_it(
    make_plant: MakePlant, walker: Robot
) -> None:
    exact = make_plant()
    loose = make_plant(model_error={"backlash_rad": {"left_elbow": 0.04}})
    there = elbow_steps(exact, walker, -0.3)
    assert abs(elbow_steps(loose, walker, -0.3) - there) == pytest.approx(
        0.02, abs=5e-3
    )


def test_dry_friction_stops_a_joint_short(make_plant: MakePlant, walker: Robot) -> None:
    joint = walker.joint_names.index("left_elbow")
    kp = walker.file.joint[joint].kp_nm_rad
    exact = elbow_steps(make_plant(), walker, -0.3)
    stiff = make_plant(model_error={"joint_friction_nm": {"left_elbow": 5.0}})
    short = elbow_steps(stiff, walker, -0.3)
    assert 0.3 * 5.0 / kp < short - exact < 1.1 * 5.0 / kp


def test_servo_lag_scales(make_plant: MakePlant) -> None:
    robot = load_robot("walker", servo_profile="harmonic")
    lags = []
    for scale in (1.0, 2.0):
        plant = make_plant(robot=robot, model_error={"servo_lag_scale": scale})
        command = robot.nominal.copy()
        command[-1] += 0.02
        begin = plant._servos.setpoint[-1]
        plant.step(command)
        lags.append(0.02 / (plant._servos.setpoint[-1] - begin))
    assert lags[1] == pytest.approx(2.0 * lags[0], rel=0.05)


def test_a_share_of_one_brings_the_capture_point_to_the_edge(
    make_plant: MakePlant, walker: Robot
) -> None:
    plant = make_plant()
    limit = CaptureLimit(walker, plant.world, plant.data)
    com, mass = plant.view.com, plant.world.weight / 9.81
    height = com[2] - plant.view.sole_left[2]
    toe = plant.view.sole_left[0] + walker.left.half_length_m
    edge = plant.view.sole_left[1] + walker.left.half_width_m
    for direction, room in (([1.0, 0.0], toe - com[0]), ([0.0, 1.0], edge - com[1])):
        speed = limit.impulse(np.array(direction)) / mass
        reached = speed / math.sqrt(9.81 / height)
        assert reached == pytest.approx(room, abs=2e-4)


def test_a_push_by_share_acts_on_the_base_where_the_robot_looks(
    make_plant: MakePlant, walker: Robot
) -> None:
    push = {"impulse_share": 0.5, "start_s": 0.0, "duration_s": 0.05}
    plant = make_plant(start={"yaw_deg": 90.0}, push=[push])
    limit = CaptureLimit(walker, plant.world, plant.data)
    expected = 0.5 * limit.impulse(np.array([0.0, 1.0])) / 0.05
    plant.step(walker.nominal)
    force = plant.data.xfrc_applied[plant.world.base_body, :3]
    np.testing.assert_allclose(force, [0.0, expected, 0.0], atol=1e-6)
    left = make_plant(push=[{**push, "direction_deg": 90.0}])
    left.step(walker.nominal)
    assert left.data.xfrc_applied[left.world.base_body, 1] > 0.0


@pytest.mark.parametrize(
    ("push", "words"),
    [
        ({}, "either `force_n` or `impulse_share`"),
        ({"force_n": [1, 0, 0], "impulse_share": 0.5}, "either"),
        ({"force_n": [1, 0, 0], "direction_deg": 90}, "goes with `impulse_share`"),
    ],
)
def test_a_push_has_one_size(
    make_plant: MakePlant, push: dict[str, Any], words: str
) -> None:
    with pytest.raises(FileFormatError, match=words):
        make_plant(push=[{"start_s": 0.0, **push}])
