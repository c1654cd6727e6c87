"""Sensor biases are estimated from the motion of robot and ground."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import EstimatorSettings
from surefoot.stabilizer.estimation.estimator import Estimator
from surefoot.stabilizer.model import GRAVITY, RobotModel
from tests.stabilizer.estimator_run import tilt_between
from tests.stabilizer.kinematic_robot import KinematicRobot

PERIOD_S = 0.005
CALIBRATION_S = 0.3
TILT_RAD, HEIGHT_M = 1e-3, 3e-3
"""They mean one and three millimetres at the centre of mass."""
ACCEL = [np.array(axes) for axes in ([0.3, 0.0, 0.0], [-0.2, 0.3, 0.1], [0, 0, -0.3])]
GYRO = np.array([0.02, -0.02, 0.02])
NO_BIAS = np.zeros(3)
BASE_Z = 2
Disturb = Callable[[Array], Array]


@dataclass(frozen=True)
class Readings:
    """Error-free readings along a motion, with a row per tick."""

    period_s: float
    rows: list[tuple[Snapshot, Array]]


def at_rest(model: RobotModel, *, duration_s: float) -> Readings:
    robot = KinematicRobot(model, lambda _: model.nominal_configuration())
    row = robot.snapshot(0.0), robot.wrenches(0.0)
    return Readings(PERIOD_S, [row] * round(duration_s / PERIOD_S))


@pytest.fixture(scope="module")
def heaving(model: RobotModel) -> Readings:
    """Return a second of rest, then ground that heaves."""

    def motion(time_s: float) -> Array:
        q = model.nominal_configuration().copy()
        moved = max(time_s - 1.0, 0.0)
        q[BASE_Z] += 0.04 * np.tanh(moved**3) * np.sin(2.0 * np.pi * 0.5 * moved)
        return q

    robot, period_s = KinematicRobot(model, motion), 2.0 * PERIOD_S
    times = period_s * np.arange(round(3.0 / period_s))
    rows = [(robot.snapshot(float(t)), robot.wrenches(float(t))) for t in times]
    return Readings(period_s, rows)


def follow(
    model: RobotModel,
    readings: Readings,
    *,
    accel: Array = NO_BIAS,
    gyro: Array = NO_BIAS,
    disturb: Disturb = lambda wrenches: wrenches,
) -> Estimator:
    """Return the estimator after a motion; it was calibrated at the start."""
    period_s = readings.period_s
    estimator = Estimator(model, EstimatorSettings(), period_s=period_s)
    for tick, (truth, felt) in enumerate(readings.rows):
        snapshot = replace(
            truth,
            linear_acceleration=truth.linear_acceleration + accel,
            angular_velocity=truth.angular_velocity + gyro,
        )
        if tick * period_s < CALIBRATION_S:
            estimator.calibrate(snapshot, wrenches=disturb(felt))
        else:
            estimator.update(snapshot, wrenches=disturb(felt))
    return estimator


@pytest.mark.parametrize("accel", ACCEL)
def test_a_biased_accelerometer_neither_leans_nor_sinks_the_robot(
    model: RobotModel, accel: Array
) -> None:
    q = model.nominal_configuration()
    estimator = follow(model, at_rest(model, duration_s=3.0), accel=accel)
    assert tilt_between(q, estimator.q) < TILT_RAD
    assert estimator.q[BASE_Z] == pytest.approx(q[BASE_Z], abs=HEIGHT_M)


def test_a_bias_learnt_at_rest_does_no_harm_on_ground_that_heaves(
    model: RobotModel, heaving: Readings
) -> None:
    heights = [
        follow(model, heaving, accel=accel).q[BASE_Z] for accel in (NO_BIAS, ACCEL[1])
    ]
    assert heights[1] == pytest.approx(heights[0], abs=HEIGHT_M)


@pytest.mark.parametrize("offset", [[30.0, -30.0, 0, 0, 0, 0], [0, 0, 0, 5.0, 5.0, 0]])
def test_feet_that_are_off_alone_are_outvoted(
    model: RobotModel, offset: list[float]
) -> None:
    """Force sensors with an offset would show a lean of three degrees."""
    q, offsets = model.nominal_configuration(), np.array(2 * offset)
    estimator = follow(
        model, at_rest(model, duration_s=1.0), disturb=lambda F: F + offsets
    )
    assert tilt_between(q, estimator.q) < 2.0 * TILT_RAD


def test_a_push_is_not_taken_for_a_bias(model: RobotModel) -> None:
    """A hand that leans on the robot for a second, after ten of standing."""
    ticks = 0

    def pushed(wrenches: Array) -> Array:
        nonlocal ticks
        ticks += 1
        force = 40.0 if ticks * PERIOD_S > 10.0 else 0.0
        return wrenches - np.array([0, 0.5 * force, 0, 0, 0, 0] * 2)

    estimator = follow(model, at_rest(model, duration_s=11.0), disturb=pushed)
    lean = tilt_between(model.nominal_configuration(), estimator.q)
    assert lean < 0.1 * 40.0 / model.weight


@pytest.mark.parametrize(("left", "right"), [(300.0, 0.0), (0.0, -300.0)])
def test_a_normal_force_that_is_far_off_is_told_by_foot(
    model: RobotModel, left: float, right: float
) -> None:
    """Their sum is not the weight, and they seem to be pressed elsewhere."""
    off = np.zeros(12)
    off[[2, 8]] = left, right
    readings = at_rest(model, duration_s=1.0)
    estimator = follow(model, readings, disturb=lambda F: F + off)
    np.testing.assert_allclose(estimator.force_offsets, [left, right], atol=3.0)


@pytest.mark.parametrize(("lasts_s", "expected"), [(0.6, -250.0), (0.1, 0.0)])
def test_a_normal_force_that_suddenly_is_off_is_told_from_an_impact(
    model: RobotModel, lasts_s: float, expected: float
) -> None:
    """Told within two seconds, the foot had long yielded to what it did not feel."""
    ticks, begins, rest_s = 0, round(3.0 / PERIOD_S), 0.6

    def disturbed(wrenches: Array) -> Array:
        nonlocal ticks
        ticks += 1
        off = np.zeros(12)
        is_off = begins <= ticks < begins + round(lasts_s / PERIOD_S)
        off[8] = -250.0 if is_off else 0.0
        return wrenches + off

    readings = at_rest(model, duration_s=3.0 + rest_s)
    estimator = follow(model, readings, disturb=disturbed)
    np.testing.assert_allclose(estimator.force_offsets, [0.0, expected], atol=25.0)


def test_a_payload_is_no_offset(model: RobotModel) -> None:
    load = np.zeros(12)
    load[[2, 8]] = 0.04 * model.weight
    readings = at_rest(model, duration_s=1.0)
    estimator = follow(model, readings, disturb=lambda F: F + load)
    assert not any(estimator.force_offsets)


def test_gyroscope_off_by_more_than_slow_ground_turns(model: RobotModel) -> None:
    """Gravity's direction stays put: it is the gyroscope, not the ground."""
    q = model.nominal_configuration()
    estimator = follow(model, at_rest(model, duration_s=2.0), gyro=GYRO)
    assert np.linalg.norm(GYRO) > EstimatorSettings().still_rate_rad_s
    assert tilt_between(q, estimator.q) < TILT_RAD
    np.testing.assert_allclose(estimator.v[3:6], 0.0, atol=1e-4)


@pytest.mark.parametrize(("axis", "size"), [(0, 0.03), (1, -0.02)])
def test_a_gyroscope_that_goes_off_later_is_told_and_learnt(
    model: RobotModel, axis: int, size: float
) -> None:
    """Learnt like a drift, the lean would last for a minute."""
    off = np.zeros(3)
    off[axis] = size
    period_s = 2.0 * PERIOD_S
    [(truth, felt)] = at_rest(model, duration_s=PERIOD_S).rows
    estimator = Estimator(model, EstimatorSettings(), period_s=period_s)
    leans, told_s = [], np.inf
    for time_s in np.arange(0.0, 25.0, period_s).tolist():
        if time_s < CALIBRATION_S:
            estimator.calibrate(truth, wrenches=felt)
            continue
        wrong = truth.angular_velocity + (off if time_s > 1.0 else NO_BIAS)
        estimator.update(replace(truth, angular_velocity=wrong), wrenches=felt)
        leans.append(tilt_between(model.nominal_configuration(), estimator.q))
        if estimator.gyro_is_off:
            told_s = min(told_s, time_s)
    assert told_s < 12.0
    assert max(leans) > 2.0 * abs(size)
    assert leans[-1] < 0.15 * max(leans)


def test_ground_that_speeds_up_and_brakes_is_no_gyroscope_that_is_off(
    model: RobotModel,
) -> None:
    """As in a bus, with 1 m/s^2 for three seconds each."""

    def motion(time_s: float) -> Array:
        q = model.nominal_configuration().copy()
        speeds, brakes = np.clip([time_s - 1.0, time_s - 6.0], 0.0, 3.0)
        after_s = max(time_s - 4.0, 0.0)
        q[0] += 0.5 * speeds**2 + 3.0 * after_s - 0.5 * brakes**2
        q[0] -= 3.0 * max(time_s - 9.0, 0.0)
        return q

    robot = KinematicRobot(model, motion)
    rows = [
        (robot.snapshot(time_s), robot.wrenches(time_s))
        for time_s in np.arange(0.0, 15.0, 2.0 * PERIOD_S).tolist()
    ]
    estimator = follow(model, Readings(2.0 * PERIOD_S, rows))
    assert not estimator.gyro_is_off


def test_the_robot_knows_the_gravity_of_its_place(
    model: RobotModel, heaving: Readings
) -> None:
    here = 9.77
    estimator = follow(
        model,
        heaving,
        accel=np.array([0.0, 0.0, here - GRAVITY]),
        disturb=lambda F: F * here / GRAVITY,
    )
    plain = follow(model, heaving)
    assert estimator.q[BASE_Z] == pytest.approx(plain.q[BASE_Z], abs=HEIGHT_M)
