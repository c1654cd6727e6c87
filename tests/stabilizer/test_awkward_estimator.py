"""The estimate does not depend on where and how the IMU is mounted.

The left foot stands and the legs move freely, so the body turns about all axes, and
each term of the IMU's lever arm counts.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import EstimatorSettings
from surefoot.stabilizer.estimation.estimator import Estimator
from surefoot.stabilizer.model import RobotModel
from tests.awkward_robot import Awkward
from tests.stabilizer.estimator_run import tilt_between
from tests.stabilizer.kinematic_robot import (
    KinematicRobot,
    Motion,
    StandingOnSoles,
    joint_offsets,
)

PERIOD_S = 0.001
SETTLE_S, MOVE_S = 0.6, 1.2
"""Time until only the left foot counts, and duration of the motion [s]."""
SETTINGS = msgspec.structs.replace(
    EstimatorSettings(), tilt_bandwidth=2.0, height_bandwidth=2.0
)
"""Quick, so that effects of legs and lever show within a second."""
LEAN_RAD = 0.5
"""Large, so that the lever's vertical part shows in the horizontal, too."""
SWAY_RAD, SWAY_RAD_S = 0.3, 4.0
TILT_RAD, SPEED_M_S, HEIGHT_M = 2e-3, 4e-3, 1e-3
"""Tolerances of the estimate.

The estimator uses the legs' readings of the last tick. At 2 rad/s, 5 rad/s^2 and a
metre above the foot this costs 5 mm/s. A lever arm with a wrong sign costs much more.
"""
SAME = 1e-10
"""Rounding over 2000 ticks: some 1e-16 each in numbers up to 10."""


@pytest.fixture
def swaying(model: RobotModel) -> Motion:
    """Return a motion of the Walker on its left sole that moves all left leg joints."""
    rng = np.random.default_rng(41)
    names = list(model.pin_model.names)[2:]
    left_leg = np.array([name.startswith("left") for name in names]) & model.is_leg
    size = np.where(left_leg, SWAY_RAD, 0.0)
    phase = rng.uniform(0.0, 2.0 * np.pi, size=model.n_a)
    pace = SWAY_RAD_S * rng.uniform(0.7, 1.3, size=model.n_a)
    leaning = model.nominal + joint_offsets(model, ankle_pitch=LEAN_RAD)
    on_soles = StandingOnSoles(model)

    def motion(time_s: float) -> Array:
        moved = max(time_s - SETTLE_S, 0.0)
        begun = np.tanh(4.0 * moved**3)
        wave = np.sin(pace * moved + phase) * begun
        return on_soles(leaning + size * wave)

    return motion


def ticks() -> Array:
    count = round((SETTLE_S + MOVE_S) / PERIOD_S)
    return PERIOD_S * np.arange(1, count + 1)


class Followed:
    """The estimator's results along a motion, with a row per tick."""

    def __init__(self, model: RobotModel, motion: Motion) -> None:
        robot = KinematicRobot(model, motion)
        estimator = Estimator(model, SETTINGS, period_s=PERIOD_S)
        estimator.calibrate(robot.snapshot(0.0), wrenches=None)
        q, v, q_true, v_true = [], [], [], []
        for time_s in ticks():
            wrenches = robot.wrenches(time_s, left_share=1.0)
            estimator.update(robot.snapshot(time_s), wrenches=wrenches)
            if time_s > SETTLE_S:
                q.append(estimator.q.copy())
                v.append(estimator.v.copy())
                q_true.append(motion(time_s))
                v_true.append(robot.velocity(time_s))
        self.q, self.v = np.array(q), np.array(v)
        self.q_true, self.v_true = np.array(q_true), np.array(v_true)

    @property
    def tilt_error(self) -> float:
        pairs = zip(self.q_true, self.q, strict=True)
        return max(tilt_between(truth, estimate) for truth, estimate in pairs)


def test_a_unit_turned_in_its_place_gives_the_same_estimate(
    turned: Awkward, model: RobotModel, swaying: Motion
) -> None:
    plain, other = Followed(model, swaying), Followed(RobotModel(turned.robot), swaying)
    assert np.abs(plain.v[:, 3:6]).max() > 1.0
    np.testing.assert_allclose(other.q, plain.q, rtol=0.0, atol=SAME)
    np.testing.assert_allclose(other.v, plain.v, rtol=0.0, atol=SAME)


@pytest.mark.parametrize("which", ["walker", "turned", "awkward"])
def test_the_estimate_is_the_truth_wherever_the_unit_sits(
    request: pytest.FixtureRequest, model: RobotModel, swaying: Motion, which: str
) -> None:
    motion, its_model = swaying, model
    if which != "walker":
        other: Awkward = request.getfixturevalue(which)
        its_model = RobotModel(other.robot)
        motion = in_its_frames(other, swaying)
    run = Followed(its_model, motion)
    assert run.tilt_error < TILT_RAD
    np.testing.assert_allclose(run.q[:, 2], run.q_true[:, 2], rtol=0.0, atol=HEIGHT_M)
    np.testing.assert_allclose(
        run.v[:, :6], run.v_true[:, :6], rtol=0.0, atol=SPEED_M_S
    )


def in_its_frames(robot: Awkward, motion: Motion) -> Callable[[float], Array]:
    return lambda time_s: robot.configuration(motion(time_s))
