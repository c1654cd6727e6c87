from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import GRAVITY_M_S2, Array, Mat
from surefoot.schemas.robot_file import Foot
from surefoot.sim_robot.plant import Plant
from tests.sim_robot.conftest import MakePlant
from tests.stabilizer.closed_loop import NOISE

PERIOD_S = 0.001
TILT = {"axis": "roll", "kind": "ramp", "amplitude_deg": 3.0, "rate_deg_s": 6.0}
SHAKE = [
    {"axis": "y", "kind": "sine", "amplitude_m": 0.01, "frequency_hz": 2.0},
    {"axis": "pitch", "kind": "sine", "amplitude_deg": 2.0, "frequency_hz": 1.3},
]


def readings(plant: Plant, posture: Array, *, ticks: int) -> Iterator[Snapshot]:
    for _ in range(ticks):
        yield plant.sense()
        plant.step(posture)


def plate_weight_at_sensor(plant: Plant, foot: Foot) -> Array:
    """Return (6,) the weight of the parts below the sensor, in its frame."""
    model, data = plant.world.model, plant.data
    sensor = data.body(foot.ft_link)
    rotation: Mat = sensor.xmat.reshape(3, 3)
    force = rotation.T @ [0.0, 0.0, -model.body(foot.ft_link).subtreemass[0] * 9.81]
    lever = rotation.T @ (data.subtree_com[sensor.id] - sensor.xpos)
    return np.concatenate([force, np.cross(lever, force)])


def sole_wrench_at_sensor(plant: Plant, foot: Foot, wrench: Array) -> Array:
    """Return (6,) the true contact wrench, moved from the sole to the sensor."""
    sole, sensor = plant.data.body(foot.sole_frame), plant.data.body(foot.ft_link)
    rotation: Mat = sensor.xmat.reshape(3, 3)
    turn = rotation.T @ sole.xmat.reshape(3, 3)
    lever = rotation.T @ (sole.xpos - sensor.xpos)
    force, moment = turn @ wrench[:3], turn @ wrench[3:]
    return np.concatenate([force, moment + np.cross(lever, force)])


def test_force_sensors_carry_the_robot_less_the_plates(
    standing_plant: Plant, walker: Robot
) -> None:
    snapshot = standing_plant.sense()
    plates = sum(
        standing_plant.world.model.body(foot.ft_link).subtreemass[0]
        for foot in (walker.left, walker.right)
    )
    above = standing_plant.world.weight - plates * GRAVITY_M_S2
    carried = snapshot.ft_left[2] + snapshot.ft_right[2]
    assert carried == pytest.approx(above, rel=1e-3)
    assert carried == pytest.approx(standing_plant.world.weight, rel=0.02)


def test_sole_forces_sum_to_the_weight(standing_plant: Plant) -> None:
    truth = standing_plant.truth()
    assert truth.F_left[2] > 0.0
    assert truth.F_left[2] + truth.F_right[2] == pytest.approx(
        standing_plant.world.weight, rel=1e-3
    )


def test_force_sensor_is_the_contact_wrench_plus_the_plate_at_rest(
    make_plant: MakePlant, walker: Robot
) -> None:
    plant = make_plant(platform=[{"foot": "both", "motion": [TILT]}])
    for _ in range(3000):
        plant.step(walker.nominal)
    snapshot, truth = plant.sense(), plant.truth()
    for foot, measured, contact in (
        (walker.left, snapshot.ft_left, truth.F_left),
        (walker.right, snapshot.ft_right, truth.F_right),
    ):
        expected = sole_wrench_at_sensor(plant, foot, contact)
        expected += plate_weight_at_sensor(plant, foot)
        np.testing.assert_allclose(measured, expected, atol=2e-2)
        assert abs(contact[1]) > 10.0, "the tilt must show in the tangential force"


def test_true_wrench_is_the_sum_of_the_contacts(
    make_plant: MakePlant, walker: Robot
) -> None:
    """Add up MuJoCo's own contact forces while they are those of the step."""
    plant = make_plant(platform=[{"foot": "both", "motion": SHAKE}])
    for _ in range(700):
        plant.step(walker.nominal)
    model, data = plant.world.model, plant.data
    mujoco.mj_step2(model, data)
    truth = plant.truth()
    for foot, sole, expected in (
        (walker.left, plant.world.sole_bodies[0], truth.F_left),
        (walker.right, plant.world.sole_bodies[1], truth.F_right),
    ):
        geom = model.geom(foot.sole_frame).id
        origin, rotation = data.xpos[sole], data.xmat[sole].reshape(3, 3)
        total, moment, out = np.zeros(3), np.zeros(3), np.zeros(6)
        for index in range(data.ncon):
            contact = data.contact[index]
            if geom not in contact.geom:
                continue
            mujoco.mj_contactForce(model, data, index, out)
            force = contact.frame.reshape(3, 3).T @ out[:3]
            if contact.geom[0] == geom:
                force = -force
            total += force
            moment += np.cross(contact.pos - origin, force)
        np.testing.assert_allclose(rotation.T @ total, expected[:3], atol=1e-6)
        np.testing.assert_allclose(rotation.T @ moment, expected[3:], atol=1e-6)


def test_accelerometer_reads_gravity_upwards_at_rest(standing_plant: Plant) -> None:
    acceleration = standing_plant.sense().linear_acceleration
    assert np.linalg.norm(acceleration) == pytest.approx(GRAVITY_M_S2, rel=1e-4)
    assert acceleration[2] > 0.99 * GRAVITY_M_S2


def test_accelerometer_integrates_to_the_velocity(
    make_plant: MakePlant, walker: Robot
) -> None:
    plant = make_plant(platform=[{"foot": "both", "motion": SHAKE}])
    gravity = np.array([0.0, 0.0, -GRAVITY_M_S2])
    velocity = np.zeros(3)
    for snapshot in readings(plant, walker.nominal, ticks=800):
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, np.roll(snapshot.quat_xyzw, 1))
        specific_force = rotation.reshape(3, 3) @ snapshot.linear_acceleration
        if snapshot.tick > 0:
            velocity += (specific_force + gravity) * PERIOD_S
    out = np.zeros(6)
    plant = make_plant(platform=[{"foot": "both", "motion": SHAKE}])
    for _ in range(799):
        plant.step(walker.nominal)
    mujoco.mj_objectVelocity(
        plant.world.model,
        plant.data,
        mujoco.mjtObj.mjOBJ_SITE,
        plant.world.sensor_sites["imu"],
        out,
        0,
    )
    assert np.linalg.norm(out[3:]) > 0.01
    np.testing.assert_allclose(velocity, out[3:], atol=1e-3)


def test_gyroscope_is_the_rate_of_the_attitude(
    make_plant: MakePlant, walker: Robot
) -> None:
    plant = make_plant(platform=[{"foot": "both", "motion": SHAKE}])
    taken = list(readings(plant, walker.nominal, ticks=600))
    before, here, after = taken[-3:]
    rate = np.zeros(3)
    mujoco.mju_subQuat(rate, np.roll(after.quat_xyzw, 1), np.roll(before.quat_xyzw, 1))
    rate /= 2.0 * PERIOD_S
    assert np.linalg.norm(rate) > 0.05
    np.testing.assert_allclose(here.angular_velocity, rate, atol=2e-3)


def test_noise_has_the_deviation_of_the_scenario(
    make_plant: MakePlant, walker: Robot
) -> None:
    ticks = 2000
    noisy = list(readings(make_plant(sensors=NOISE), walker.nominal, ticks=ticks))
    clean = list(readings(make_plant(), walker.nominal, ticks=ticks))
    error = {
        name: np.array(
            [
                getattr(a, name) - getattr(b, name)
                for a, b in zip(noisy, clean, strict=True)
            ]
        )
        for name in ("ft_left", "ft_right", "angular_velocity", "linear_acceleration")
    }
    # The deviation of a deviation over n samples is 1 / sqrt(2 n): 4 of those.
    tolerance = 4.0 / np.sqrt(2.0 * ticks)
    for name in ("ft_left", "ft_right"):
        deviation = error[name].std(axis=0)
        np.testing.assert_allclose(deviation[:3], 2.0, rtol=tolerance)
        np.testing.assert_allclose(deviation[3:], 0.1, rtol=tolerance)
    for name, expected in (("angular_velocity", 0.002), ("linear_acceleration", 0.05)):
        np.testing.assert_allclose(error[name].std(axis=0), expected, rtol=tolerance)
    together = np.corrcoef(np.hstack(list(error.values())).T)
    np.testing.assert_allclose(together, np.eye(18), atol=5.0 / np.sqrt(ticks))


def test_one_sensor_does_not_shift_the_noise_of_another(
    make_plant: MakePlant, walker: Robot
) -> None:
    all_noisy = make_plant(sensors=NOISE)
    only_gyro = make_plant(sensors={"gyro_noise_rad_s": 0.002})
    for one, other in zip(
        readings(all_noisy, walker.nominal, ticks=300),
        readings(only_gyro, walker.nominal, ticks=300),
        strict=True,
    ):
        np.testing.assert_array_equal(one.angular_velocity, other.angular_velocity)


def test_encoders_round_and_still_tell_the_velocity(
    make_plant: MakePlant, walker: Robot
) -> None:
    resolution = 1e-4
    plant = make_plant(sensors={"encoder_resolution_rad": resolution})
    speed = 0.3
    command = walker.nominal.copy()
    measured = []
    for tick in range(500):
        command[0] = speed * tick * PERIOD_S
        snapshot = plant.sense()
        steps = snapshot.q / resolution
        np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
        measured.append(snapshot.dq[0])
        plant.step(command.copy())
    assert measured[0] == 0.0
    assert np.mean(measured[-100:]) == pytest.approx(speed, rel=0.02)


def test_a_tick_is_measured_once(make_plant: MakePlant) -> None:
    plant = make_plant(sensors=NOISE)
    assert plant.sense() is plant.sense()


def test_later_steps_leave_a_snapshot_alone(
    make_plant: MakePlant, walker: Robot
) -> None:
    plant = make_plant(platform=[{"foot": "both", "motion": SHAKE}])
    snapshot = plant.sense()
    kept = {n: np.copy(getattr(snapshot, n)) for n in Snapshot.__slots__}
    for _ in range(100):
        plant.step(walker.nominal)
    for name, value in kept.items():
        np.testing.assert_array_equal(getattr(snapshot, name), value)
