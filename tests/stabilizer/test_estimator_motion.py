"""The estimator while the robot, or the ground under it, moves."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np
import pinocchio as pin
import pytest

from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import EstimatorSettings
from surefoot.stabilizer.estimation.estimator import Estimator
from surefoot.stabilizer.model import RobotModel
from tests.stabilizer.estimator_run import EstimatorRun, track
from tests.stabilizer.kinematic_robot import (
    KinematicRobot,
    StandingOnSoles,
    joint_offsets,
)

PERIOD_S, FINE_S = 0.004, 0.001
AMPLITUDE_M = 0.06
BASE_Z = 2
LEAN_RAD, BEND_RAD = 0.05, 0.15
SWAY_RAD_S, TURNTABLE_RAD_S = 4.0, 4.0
LIFT_M, YAW_RAD = 0.005, 2e-5
POSITION_M, TILT_RAD, SPEED_M_S = 1.5e-3, 1e-3, 5e-3
"""Tolerances of base pose and velocity on ground at rest."""
LOADED_AFTER_S = 1.0
"""Many times the time constant of the load share [s]."""


def faded(time_s: float, *, over_s: float) -> float:
    """Return a factor from 0 to 1 with continuous velocity and acceleration."""
    x = min(max(time_s / over_s, 0.0), 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


def heave(model: RobotModel, *, frequency_hz: float, duration_s: float) -> EstimatorRun:
    """Return a motion in which robot and ground heave and no joint moves."""
    nominal = model.nominal_configuration()

    def motion(time_s: float) -> Array:
        q = nominal.copy()
        wave = np.sin(2.0 * np.pi * frequency_hz * time_s)
        q[BASE_Z] += AMPLITUDE_M * faded(time_s, over_s=1.0 / frequency_hz) * wave
        return q

    return track(model, motion, duration_s=duration_s, period_s=PERIOD_S)


def sole_positions(model: RobotModel, q: Array) -> list[Array]:
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, q)
    return [data.oMf[frame].translation for frame in model.sole_ids]


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize(
    ("frequency_hz", "duration_s", "relative"),
    [
        pytest.param(0.96, 3.0, 0.1, id="fast platform"),
        pytest.param(0.24, 8.0, 0.3, id="slow platform"),
    ],
)
def test_heaving_ground_is_seen_as_heaving(
    model: RobotModel, frequency_hz: float, duration_s: float, relative: float
) -> None:
    """Legs alone see nothing of it: their error would be the whole motion."""
    run = heave(model, frequency_hz=frequency_hz, duration_s=duration_s)
    truth = run.q_true[:, BASE_Z] - run.q_true[0, BASE_Z]
    assert rms(truth) > 0.4 * AMPLITUDE_M
    assert rms(run.q[:, BASE_Z] - run.q_true[:, BASE_Z]) < relative * rms(truth)
    assert rms(run.ground_height - truth) < relative * rms(truth)
    climb = run.v_true[:, BASE_Z]
    assert rms(run.v[:, BASE_Z] - climb) < relative * rms(climb)


def test_heaving_ground_moves_nothing_sideways(model: RobotModel) -> None:
    run = heave(model, frequency_hz=0.96, duration_s=2.0)
    np.testing.assert_allclose(run.q[:, :2], run.q_true[:, :2], atol=1e-6)
    assert run.tilt_error.max() < 1e-6


def leaning(model: RobotModel, time_s: float) -> Array:
    """Return joint offsets of a sway about the ankles, soles flat on the ground."""
    angle = LEAN_RAD * faded(time_s, over_s=1.0) * np.sin(np.pi * time_s)
    return joint_offsets(model, ankle_pitch=angle)


def squatting(model: RobotModel, time_s: float) -> Array:
    """Return joint offsets that bend and stretch the knees, base upright."""
    wave = 0.5 - 0.5 * np.cos(np.pi * time_s)
    angle = BEND_RAD * faded(time_s, over_s=1.0) * wave
    return joint_offsets(model, hip_pitch=-angle, knee=2.0 * angle, ankle_pitch=-angle)


@pytest.mark.parametrize("move", [leaning, squatting])
def test_own_motion_over_still_ground_is_followed(
    model: RobotModel, move: Callable[[RobotModel, float], Array]
) -> None:
    on_soles = StandingOnSoles(model)
    run = track(
        model,
        lambda time_s: on_soles(model.nominal + move(model, time_s)),
        duration_s=4.0,
        period_s=PERIOD_S,
    )
    travelled = np.ptp(run.q_true[:, :3], axis=0).max()
    assert travelled > 10.0 * POSITION_M
    np.testing.assert_allclose(run.q[:, :3], run.q_true[:, :3], atol=POSITION_M)
    np.testing.assert_allclose(run.v[:, :3], run.v_true[:, :3], atol=SPEED_M_S)
    assert run.tilt_error.max() < TILT_RAD
    np.testing.assert_array_equal(run.q[:, 7:], run.q_true[:, 7:])


def test_swaying_widely_does_not_lift_the_robot(model: RobotModel) -> None:
    """The inertial unit is off the base's origin, and turning accelerates it.

    Towards the origin and along its circle: over a sway the two cancel, so that
    making up for one of them alone is worse than for none.
    """
    on_soles = StandingOnSoles(model)

    def motion(time_s: float) -> Array:
        wave = faded(time_s, over_s=1.0) * np.sin(SWAY_RAD_S * time_s)
        return on_soles(model.nominal + joint_offsets(model, ankle_pitch=0.2 * wave))

    run = track(model, motion, duration_s=3.0, period_s=FINE_S)
    steady = slice(len(run.time_s) // 2, None)
    height, truth = run.q[steady, BASE_Z], run.q_true[steady, BASE_Z]
    assert height.mean() == pytest.approx(truth.mean(), abs=LIFT_M)


def test_turning_is_integrated_without_loss(model: RobotModel) -> None:
    """On a turntable, yaw is what the gyroscope has summed up."""
    nominal = model.nominal_configuration()

    def motion(time_s: float) -> Array:
        """Reach full speed soon, and keep it in the test's second half."""
        angle = TURNTABLE_RAD_S * (time_s - (1.0 - np.exp(-9.0 * time_s)) / 9.0)
        q = nominal.copy()
        q[3:7] = 0.0, 0.0, np.sin(0.5 * angle), np.cos(0.5 * angle)
        return q

    settings = msgspec.structs.replace(EstimatorSettings(), yaw_gain=0.0)
    run = track(model, motion, duration_s=3.0, period_s=PERIOD_S, settings=settings)
    turned, truly = (
        np.unwrap(2.0 * np.arctan2(q[:, 5], q[:, 6])) for q in (run.q, run.q_true)
    )
    middle = len(run.time_s) // 2
    assert turned[-1] - turned[middle] == pytest.approx(
        truly[-1] - truly[middle], abs=YAW_RAD
    )


@pytest.mark.parametrize("side", [0, 1], ids=["left", "right"])
def test_the_loaded_foot_stays_where_it_stands(model: RobotModel, side: int) -> None:
    """The other one may go where it likes: it does not carry the robot."""
    q = model.nominal_configuration()
    names = list(model.pin_model.names)[2:]
    other = "right" if side == 0 else "left"
    q[7 + names.index(f"{other}_hip_roll")] += -0.1 if other == "right" else 0.1
    robot = KinematicRobot(model, lambda _: q)
    estimator = Estimator(model, EstimatorSettings(), period_s=PERIOD_S)
    estimator.calibrate(robot.snapshot(0.0), wrenches=None)
    wrenches = robot.wrenches(0.0, left_share=1.0 - side)
    for _ in range(round(LOADED_AFTER_S / PERIOD_S)):
        estimator.update(robot.snapshot(0.0), wrenches=wrenches)
    nominal = sole_positions(model, model.nominal_configuration())
    estimated = sole_positions(model, estimator.q)
    np.testing.assert_allclose(estimated[side][:2], nominal[side][:2], atol=1e-6)
    assert np.linalg.norm(estimated[1 - side][:2] - nominal[1 - side][:2]) > 0.01
