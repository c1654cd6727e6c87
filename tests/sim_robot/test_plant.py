from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from benchmarks.mounted import Drawing, placement
from surefoot.robot_io.robot import Robot
from surefoot.schemas.scenario import scenario_from_table
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.plant import CommandError, Plant
from tests.awkward_robot import make_awkward
from tests.sim_robot.conftest import MakePlant
from tests.support import with_rate

PERIOD_S = 0.001
PUSH = {
    "body": "torso",
    "force_n": [0.0, 180.0, 0.0],
    "start_s": 0.05,
    "duration_s": 0.1,
}


def test_tick_zero_is_at_rest_above_the_origin(
    standing_plant: Plant, walker: Robot
) -> None:
    truth, snapshot = standing_plant.truth(), standing_plant.sense()
    assert truth.tick == snapshot.tick == snapshot.stamp_ns == 0
    assert np.abs(snapshot.dq).max() < 1e-3
    assert np.linalg.norm(truth.com_velocity) < 1e-3
    np.testing.assert_allclose(truth.base_position[:2], 0.0, atol=5e-3)
    np.testing.assert_allclose([truth.sole_left[2], truth.sole_right[2]], 0, atol=1e-4)
    np.testing.assert_allclose(snapshot.q, walker.nominal, atol=0.02)
    assert not standing_plant.fell


def test_posture_hold_stands_still_for_five_seconds(
    make_plant: MakePlant, walker: Robot
) -> None:
    plant = make_plant()
    start = plant.truth()
    for _ in range(5000):
        plant.step(walker.nominal)
    end = plant.truth()
    assert not plant.fell
    np.testing.assert_allclose(end.com, start.com, atol=1e-4)
    np.testing.assert_allclose(end.sole_left, start.sole_left, atol=1e-5)


def test_momentum_changes_by_the_impulses(make_plant: MakePlant, walker: Robot) -> None:
    """Push, ground and weight, added up, are the robot's change of momentum."""
    plant = make_plant(push=[PUSH])
    mass = plant.world.weight / 9.81
    start = plant.truth().com_velocity
    impulse = np.zeros(3)
    soles = plant.data.body("left_sole"), plant.data.body("right_sole")
    for tick in range(200):
        rotations = [sole.xmat.reshape(3, 3).copy() for sole in soles]
        plant.step(walker.nominal)
        truth = plant.truth()
        impulse += rotations[0] @ truth.F_left[:3] * PERIOD_S
        impulse += rotations[1] @ truth.F_right[:3] * PERIOD_S
        impulse[2] -= plant.world.weight * PERIOD_S
        if 50 <= tick < 150:
            impulse += np.array(PUSH["force_n"]) * PERIOD_S
    change = mass * (plant.truth().com_velocity - start)
    assert np.linalg.norm(change) > 1.0
    np.testing.assert_allclose(change, impulse, atol=2e-2)


def test_push_begins_and_ends_on_time(make_plant: MakePlant, walker: Robot) -> None:
    plant = make_plant(push=[PUSH])
    torso = plant.data.body("torso").id
    acting = []
    for _ in range(200):
        plant.step(walker.nominal)
        acting.append(plant.data.xfrc_applied[torso, 1])
    assert np.flatnonzero(acting).tolist() == list(range(50, 150))
    assert set(acting) == {0.0, 180.0}


def test_overlapping_pushes_add_up(make_plant: MakePlant, walker: Robot) -> None:
    plant = make_plant(push=[PUSH, {**PUSH, "force_n": [5.0, -20.0, 0.0]}])
    for _ in range(60):
        plant.step(walker.nominal)
    np.testing.assert_array_equal(
        plant.data.xfrc_applied[plant.data.body("torso").id, :3], [5.0, 160.0, 0.0]
    )


@pytest.mark.parametrize("body", ["trunk", "left_sole", "ground_both", "world"])
def test_push_on_no_link_of_the_robot_lists_those_there_are(
    make_plant: MakePlant, body: str
) -> None:
    with pytest.raises(ScenarioError, match=rf"'{body}'.*torso.*left_thigh") as error:
        make_plant(push=[PUSH, {**PUSH, "body": body}])
    assert error.value.field == "push[1].body"


def test_asking_for_truth_or_sensors_changes_nothing(
    make_plant: MakePlant, walker: Robot
) -> None:
    noisy = {"sensors": {"force_noise_n": 2.0, "encoder_resolution_rad": 1e-4}}
    curious, plain = make_plant(**noisy), make_plant(**noisy)
    for _ in range(200):
        curious.truth()
        curious.sense()
        assert not curious.fell
        curious.step(walker.nominal)
        plain.step(walker.nominal)
    one, other = curious.sense(), plain.sense()
    np.testing.assert_array_equal(one.q, other.q)
    np.testing.assert_array_equal(one.dq, other.dq)
    np.testing.assert_array_equal(one.ft_left, other.ft_left)


def test_slower_control_simulates_as_finely(
    make_plant: MakePlant, walker: Robot
) -> None:
    tilt = {"axis": "roll", "kind": "ramp", "amplitude_deg": 2.0, "rate_deg_s": 10.0}
    ground = {"platform": [{"foot": "both", "motion": [tilt]}]}
    fast = make_plant(**ground)
    slow = make_plant(robot=with_rate(walker, 250.0), **ground)
    for _ in range(400):
        fast.step(walker.nominal)
    for _ in range(100):
        slow.step(walker.nominal)
    np.testing.assert_array_equal(fast.data.qpos, slow.data.qpos)
    assert slow.tick == 100
    assert slow.sense().stamp_ns == fast.sense().stamp_ns == 400_000_000


@pytest.mark.parametrize("rate_hz", [300.0, 2000.0])
def test_control_period_must_be_whole_simulation_steps(
    make_plant: MakePlant, walker: Robot, rate_hz: float
) -> None:
    with pytest.raises(ScenarioError, match="whole multiple of 1 ms"):
        make_plant(robot=with_rate(walker, rate_hz))


def test_sensor_delay_must_be_whole_ticks(make_plant: MakePlant) -> None:
    with pytest.raises(ScenarioError, match=r"delay\.sensor_ms: got 0\.5 ms"):
        make_plant(delay={"sensor_ms": 0.5})


def test_live_view_and_copied_truth_agree(make_plant: MakePlant, walker: Robot) -> None:
    tilt = {"axis": "roll", "kind": "ramp", "amplitude_deg": 4.0, "rate_deg_s": 40.0}
    plant = make_plant(platform=[{"foot": "both", "motion": [tilt]}])
    for _ in range(150):
        plant.step(walker.nominal)
    truth, view = plant.truth(), plant.view
    for name in ("com", "sole_left", "sole_right"):
        np.testing.assert_array_equal(getattr(truth, name), getattr(view, name))
    assert truth.upright == view.upright
    assert truth.upright < 1.0 - 1e-4
    assert truth.normal_forces == view.normal_forces
    assert truth.vertical_forces == view.vertical_forces


def test_vertical_forces_and_weight_make_the_vertical_momentum(
    make_plant: MakePlant, walker: Robot
) -> None:
    """On ground that tilts; the normal forces alone would not."""
    tilt = {"axis": "pitch", "kind": "ramp", "amplitude_deg": 12.0, "rate_deg_s": 60.0}
    plant = make_plant(platform=[{"foot": "both", "motion": [tilt]}])
    mass = plant.world.weight / 9.81
    start = plant.truth().com_velocity[2]
    vertical = normal = 0.0
    for _ in range(250):
        plant.step(walker.nominal)
        truth = plant.truth()
        vertical += (sum(truth.vertical_forces) - plant.world.weight) * PERIOD_S
        normal += (sum(truth.normal_forces) - plant.world.weight) * PERIOD_S
    change = mass * (plant.truth().com_velocity[2] - start)
    assert vertical == pytest.approx(change, abs=2e-2)
    assert abs(normal - change) > 0.5


def test_command_of_another_size_is_refused(standing_plant: Plant) -> None:
    with pytest.raises(CommandError, match=r"got shape \(3,\), expected \(28,\)"):
        standing_plant.step(np.zeros(3))


def test_limp_robot_falls(make_plant: MakePlant, walker: Robot) -> None:
    plant = make_plant()
    squat = walker.nominal.copy()
    squat[[walker.joint_names.index(f"{s}_ankle_pitch") for s in ("left", "right")]] = (
        0.4
    )
    fell_at = next(
        (tick for tick in range(3000) if (plant.step(squat), plant.fell)[1]), None
    )
    assert fell_at is not None
    assert fell_at > 100


def test_state_that_is_not_a_number_is_a_fall(make_plant: MakePlant) -> None:
    plant = make_plant()
    plant.data.xpos[plant.world.sole_bodies[0]] = np.nan
    assert plant.fell


def test_contacts_do_not_buzz(make_plant: MakePlant, walker: Robot) -> None:
    """Contacts settle: the force at rest does not flicker from step to step."""
    plant = make_plant()
    forces = []
    for _ in range(300):
        plant.step(walker.nominal)
        forces.append(plant.truth().F_left[2])
    assert np.std(forces) < 1e-2


@pytest.mark.parametrize("turn", [None, (1.3, 0.4, -2.8)])
def test_it_leans_from_its_nominal_attitude_whatever_the_yaw(
    walker: Robot, tmp_path: Path, turn: tuple[float, float, float] | None
) -> None:
    """Also a robot whose base link has other axes than up and ahead."""
    robot = walker
    if turn is not None:
        drawing = Drawing(base=placement((0.0, 0.0, 0.0), turn))
        robot = make_awkward(tmp_path, drawing).robot
    table = {"name": "test", "duration_s": 1.0}
    plant = Plant(robot, scenario_from_table(table, source="test"), seed=0)
    assert plant.view.upright == pytest.approx(1.0, abs=1e-4)
    lean, yaw = 0.2, 1.3
    world_from_upright = pin.rpy.rpyToMatrix(0.0, lean, yaw)
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, (world_from_upright @ robot.R_upright_base).flatten())
    plant.data.qpos[3:7] = quat
    mujoco.mj_kinematics(plant.world.model, plant.data)
    assert plant.view.upright == pytest.approx(math.cos(lean))
