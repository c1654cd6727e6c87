"""Tilt, gyroscope bias and yaw of a robot that stands still."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pinocchio as pin
import pytest

from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import EstimatorSettings
from surefoot.stabilizer.estimation.estimator import Estimator
from surefoot.stabilizer.model import GRAVITY, RobotModel
from tests.stabilizer.estimator_run import resting, tilt_between
from tests.stabilizer.kinematic_robot import (
    UNBIASED,
    Biases,
    KinematicRobot,
    StandingOnSoles,
    joint_offsets,
)

PERIOD_S = 0.005
EXACT = 1e-9
SETTINGS = EstimatorSettings()
QUICK = msgspec.structs.replace(SETTINGS, tilt_bandwidth=2.0, gyro_bias_gain=0.5)
"""Learns the gyroscope's bias in seconds; the defaults take a minute."""
LEAN_RAD = 0.05
WRONG_TILT = Biases(gyro=np.zeros(3), accel=np.array([0.3, 0.2, 0.0]))
"""Biases that look like a tilt of two degrees."""
GYRO_BIAS = np.array([0.01, -0.01, 0.01])
SAMPLES = 300


@pytest.fixture
def leaning(model: RobotModel) -> Array:
    """Return a lean at the ankles with the soles flat on the ground."""
    offsets = joint_offsets(model, ankle_pitch=LEAN_RAD)
    return StandingOnSoles(model)(model.nominal + offsets)


def sole_yaw(model: RobotModel, q: Array) -> float:
    """Return the mean yaw of both soles [rad]."""
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, q)
    rotations = [data.oMf[frame].rotation for frame in model.sole_ids]
    return float(np.mean([np.arctan2(R[1, 0], R[0, 0]) for R in rotations]))


def rolled(model: RobotModel, angle: float) -> Array:
    """Turn robot and ground about the x-axis by an angle."""
    turn = pin.AngleAxis(angle, np.array([1.0, 0.0, 0.0])).toRotationMatrix()
    q = model.nominal_configuration().copy()
    q[:3] = turn @ q[:3]
    q[3:7] = pin.Quaternion(turn).coeffs()
    return q


def test_one_reading_of_a_leaning_robot_tells_its_whole_state(
    model: RobotModel, leaning: Array
) -> None:
    estimator = Estimator(model, SETTINGS, period_s=PERIOD_S)
    estimator.calibrate(
        KinematicRobot(model, lambda _: leaning).snapshot(0.0), wrenches=None
    )
    assert tilt_between(leaning, model.nominal_configuration()) == pytest.approx(
        LEAN_RAD
    )
    np.testing.assert_allclose(estimator.q, leaning, atol=EXACT)
    np.testing.assert_allclose(estimator.v, 0.0, atol=EXACT)
    assert estimator.height == pytest.approx(leaning[2])


def test_right_start_stays_right(model: RobotModel, leaning: Array) -> None:
    estimator = resting(
        model, leaning, settings=SETTINGS, duration_s=5.0, period_s=PERIOD_S
    )
    np.testing.assert_allclose(estimator.q, leaning, atol=EXACT)
    np.testing.assert_allclose(estimator.v, 0.0, atol=EXACT)


def test_tilt_is_recovered_from_a_biased_start(
    model: RobotModel, leaning: Array
) -> None:
    errors = []
    for time_constants in (0.0, 3.0, 15.0):
        estimator = resting(
            model,
            leaning,
            settings=SETTINGS,
            duration_s=time_constants / SETTINGS.tilt_bandwidth,
            period_s=PERIOD_S,
            calibrated_with=WRONG_TILT,
        )
        errors.append(tilt_between(leaning, estimator.q))
    assert errors[0] > 0.03
    assert errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.1 * errors[0]


def test_bias_of_the_gyroscope_is_learnt_on_the_way(model: RobotModel) -> None:
    """Of roll and pitch rate, which gravity shows; the yaw rate's it does not."""
    q = model.nominal_configuration()
    estimator = resting(
        model,
        q,
        settings=QUICK,
        duration_s=20.0,
        period_s=PERIOD_S,
        biases=Biases(gyro=GYRO_BIAS, accel=np.zeros(3)),
    )
    assert np.abs(estimator.v[3:5]).max() < 0.02 * np.abs(GYRO_BIAS).max()
    assert tilt_between(q, estimator.q) < 0.001


def test_bias_of_the_gyroscope_is_calibrated_on_all_axes(model: RobotModel) -> None:
    biased = Biases(gyro=GYRO_BIAS, accel=np.zeros(3))
    estimator = resting(
        model,
        model.nominal_configuration(),
        settings=SETTINGS,
        duration_s=1.0,
        period_s=PERIOD_S,
        calibrated_with=biased,
        biases=biased,
    )
    np.testing.assert_allclose(estimator.v[3:6], 0.0, atol=EXACT)


def test_own_motion_is_not_taken_for_bias(model: RobotModel) -> None:
    """The legs see the base turn; only what they do not see is bias."""
    rate, on_soles = 0.05, StandingOnSoles(model)

    def turning(time_s: float) -> Array:
        offsets = joint_offsets(model, ankle_pitch=rate * time_s)
        return on_soles(model.nominal + offsets)

    estimator = Estimator(model, SETTINGS, period_s=PERIOD_S)
    robot = KinematicRobot(model, turning)
    estimator.calibrate(robot.snapshot(0.0), wrenches=None)
    np.testing.assert_allclose(estimator.v[3:6], [0.0, -rate, 0.0], atol=1e-6)


@pytest.mark.parametrize("rate", [0.15, -0.4])
def test_ground_that_turns_is_not_taken_for_bias(
    model: RobotModel, rate: float
) -> None:
    """The robot keeps its posture and is turned with the ground."""

    def turning(time_s: float) -> Array:
        angle = 0.1 + rate * time_s
        return rolled(model, angle)

    robot = KinematicRobot(model, turning)
    estimator = Estimator(model, SETTINGS, period_s=PERIOD_S)
    end_s = 0.3
    for time_s in np.arange(0.0, end_s + 0.5 * PERIOD_S, PERIOD_S):
        estimator.calibrate(robot.snapshot(float(time_s)), wrenches=None)
    np.testing.assert_allclose(estimator.v[3:6], [rate, 0.0, 0.0], atol=1e-3)
    # What is left is what the turning speeds the unit up by.
    assert tilt_between(turning(end_s), estimator.q) < 0.1 * abs(rate) * end_s


def test_ground_about_to_turn_back_is_not_taken_for_bias(model: RobotModel) -> None:
    """Its mean rate is small there; that the rate changes gives it away."""
    frequency, amplitude = 0.175, 0.15

    def swaying(time_s: float) -> Array:
        angle = amplitude * np.cos(2.0 * np.pi * frequency * (time_s - 0.12))
        return rolled(model, float(angle))

    robot = KinematicRobot(model, swaying)
    estimator = Estimator(model, SETTINGS, period_s=PERIOD_S)
    rates = []
    for time_s in np.arange(0.0, 0.3, PERIOD_S):
        estimator.calibrate(robot.snapshot(float(time_s)), wrenches=None)
        rates.append(robot.velocity(float(time_s))[3])
    assert abs(np.mean(rates)) < 0.5 * SETTINGS.still_rate_rad_s
    np.testing.assert_allclose(estimator.v[3], rates[-1], atol=1e-3)


def test_speeding_up_is_not_taken_for_gravity(model: RobotModel) -> None:
    """Base upright, but pushed forward evenly: alone, it would look like a lean."""
    on_soles = StandingOnSoles(model)
    acceleration = 0.5

    def forward(time_s: float) -> Array:
        angle = 0.5 * acceleration * time_s**2
        offsets = joint_offsets(model, hip_pitch=-angle, ankle_pitch=angle)
        return on_soles(model.nominal + offsets)

    robot, ticks = KinematicRobot(model, forward), 60
    estimator = Estimator(model, SETTINGS, period_s=PERIOD_S)
    for tick in range(ticks):
        reading = robot.snapshot(tick * PERIOD_S)
        estimator.calibrate(reading, wrenches=None)
    sideways = float(np.hypot(*reading.linear_acceleration[:2]))
    looks_like = sideways / GRAVITY
    assert looks_like > 0.02
    upright = model.nominal_configuration()
    assert tilt_between(upright, estimator.q) < 0.1 * looks_like


def test_ground_that_sways_sideways_is_no_lean(model: RobotModel) -> None:
    """The robot keeps its posture; the accelerometer alone would show 6 deg."""
    amplitude, omega = 0.05, 2.0 * np.pi * 0.8

    def swaying(time_s: float) -> Array:
        q = model.nominal_configuration().copy()
        q[1] += amplitude * np.sin(omega * time_s + 1.3)
        return q

    robot = KinematicRobot(model, swaying)
    estimator = Estimator(model, SETTINGS, period_s=PERIOD_S)
    felt = []
    for time_s in np.arange(0.0, 0.3, PERIOD_S):
        reading = robot.snapshot(float(time_s))
        estimator.calibrate(reading, wrenches=None)
        felt.append(reading.linear_acceleration)
    looks_like = float(np.hypot(*np.mean(felt, axis=0)[:2])) / GRAVITY
    upright = model.nominal_configuration()
    assert looks_like > 0.05
    assert tilt_between(upright, estimator.q) < 0.5 * looks_like


def test_calibration_averages_noise_away(model: RobotModel) -> None:
    rng = np.random.default_rng(27)
    q = model.nominal_configuration()
    estimator = Estimator(model, SETTINGS, period_s=PERIOD_S)
    still = KinematicRobot(model, lambda _: q).snapshot(0.0)
    gyro_noise, accel_noise = 0.01, 0.2
    for _ in range(SAMPLES):
        estimator.calibrate(
            replace(
                still,
                angular_velocity=gyro_noise * rng.normal(size=3),
                linear_acceleration=still.linear_acceleration
                + accel_noise * rng.normal(size=3),
            ),
            wrenches=None,
        )
    estimator.update(still, wrenches=None)
    of_mean = 4.0 / np.sqrt(SAMPLES)
    """Four standard deviations of a mean."""
    assert np.abs(estimator.v[3:6]).max() < of_mean * gyro_noise
    assert tilt_between(q, estimator.q) < of_mean * accel_noise / GRAVITY


def test_yaw_is_pulled_to_the_stance(model: RobotModel) -> None:
    """Soles turned against the base: in the end they are straight, the base is not."""
    turn = 0.1
    q = model.nominal_configuration()
    q[7:] += joint_offsets(model, hip_yaw=turn)
    yaws = []
    for time_constants in (0.0, 1.0, 8.0):
        estimator = resting(
            model,
            q,
            settings=SETTINGS,
            duration_s=time_constants / SETTINGS.yaw_gain,
            period_s=PERIOD_S,
            calibrated_with=UNBIASED,
        )
        yaws.append(sole_yaw(model, estimator.q))
    assert yaws[0] == pytest.approx(turn, rel=1e-3)
    assert yaws[1] == pytest.approx(turn * np.exp(-1.0), rel=0.02)
    assert abs(yaws[2]) < 1e-3 * turn + 1e-4
