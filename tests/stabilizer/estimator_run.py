"""Runs the estimator along a motion, and records truth and estimate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import EstimatorSettings
from surefoot.stabilizer.estimation.estimator import Estimator
from surefoot.stabilizer.model import RobotModel
from tests.stabilizer.kinematic_robot import UNBIASED, Biases, KinematicRobot, Motion


@dataclass(frozen=True)
class EstimatorRun:
    """A run of the estimator, with one row per tick.

    Attributes:
        time_s: (n,) time [s].
        q_true: (n, 7 + n_a) true configuration.
        q: (n, 7 + n_a) estimated configuration.
        v_true: (n, n_v) true velocity.
        v: (n, n_v) estimated velocity.
        tilt_error: (n,) angle between true and estimated vertical [rad].
        ground_height: (n,) estimated height of the ground [m].
    """

    time_s: Array
    q_true: Array
    q: Array
    v_true: Array
    v: Array
    tilt_error: Array
    ground_height: Array


def track(
    model: RobotModel,
    motion: Motion,
    *,
    duration_s: float,
    period_s: float,
    settings: EstimatorSettings | None = None,
) -> EstimatorRun:
    """Calibrate at time 0, then follow the motion by joints and IMU alone."""
    robot = KinematicRobot(model, motion)
    estimator = Estimator(model, settings or EstimatorSettings(), period_s=period_s)
    estimator.calibrate(robot.snapshot(0.0), wrenches=None)
    times = np.asarray(period_s * np.arange(1, round(duration_s / period_s) + 1), float)
    rows: dict[str, list[Array | float]] = {
        name: [] for name in EstimatorRun.__dataclass_fields__ if name != "time_s"
    }
    for time_s in times:
        estimator.update(robot.snapshot(time_s), wrenches=None)
        q_true = motion(time_s)
        rows["q_true"].append(q_true)
        rows["q"].append(estimator.q.copy())
        rows["v_true"].append(robot.velocity(time_s))
        rows["v"].append(estimator.v.copy())
        rows["tilt_error"].append(tilt_between(q_true, estimator.q))
        rows["ground_height"].append(estimator.ground_height)
    return EstimatorRun(
        time_s=times, **{name: np.array(values) for name, values in rows.items()}
    )


def resting(
    model: RobotModel,
    q: Array,
    *,
    settings: EstimatorSettings,
    duration_s: float,
    period_s: float,
    calibrated_with: Biases = UNBIASED,
    biases: Biases = UNBIASED,
) -> Estimator:
    """Return the estimator after some time at rest; biases may change meanwhile."""
    robot = KinematicRobot(model, lambda _: q)
    estimator = Estimator(model, settings, period_s=period_s)
    estimator.calibrate(robot.snapshot(0.0, calibrated_with), wrenches=None)
    snapshot = robot.snapshot(0.0, biases)
    for _ in range(round(duration_s / period_s)):
        estimator.update(snapshot, wrenches=None)
    return estimator


def tilt_between(q_a: Array, q_b: Array) -> float:
    """Return the angle between the verticals of two base attitudes [rad]."""
    up_a, up_b = (pin.Quaternion(q[3:7]).toRotationMatrix()[2] for q in (q_a, q_b))
    return float(np.arcsin(min(1.0, float(np.linalg.norm(np.cross(up_a, up_b))))))
