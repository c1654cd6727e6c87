"""The controller on firm, level ground, in closed loop."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.control.reference import standing
from surefoot.stabilizer.model import GRAVITY, RobotModel
from tests.stabilizer.closed_loop import Run, run_closed_loop

pytestmark = pytest.mark.closed_loop

DURATION_S = 5.0
UPRIGHT_FROM_S = 1.0
"""Time after which the servos' sag at the start is compensated [s]."""
DRIFT_M = 2e-3
ESTIMATE_M = 3e-3
WEIGHT_RELATIVE = 0.01
WRENCH_N, WRENCH_NM = 0.25, 0.02
"""Tolerances of 4 s means: five times the sensors' remaining noise."""
NORMAL_ROWS = [2, 8]


@pytest.fixture(scope="module")
def run(walker: Robot) -> Run:
    """Run five seconds with the noise of the shipped scenarios."""
    return run_closed_loop(walker, duration_s=DURATION_S)


@pytest.fixture
def com_over_soles(run: Run) -> Array:
    """Return (n, 3) the true CoM relative to the midpoint of the soles [m]."""
    over: Array = run.com_true - run.soles_true.mean(axis=1)
    return over


@pytest.fixture
def later(run: Run) -> slice:
    """Return which ticks count."""
    return slice(int(np.searchsorted(run.time_s, UPRIGHT_FROM_S)), None)


def test_robot_stands(run: Run) -> None:
    assert not run.fell
    assert run.statuses == {"ok"}


def test_centre_of_mass_stays_where_it_should_be(
    model: RobotModel, com_over_soles: Array, later: slice
) -> None:
    error = com_over_soles - standing(model).com
    assert np.abs(error[later]).max() < DRIFT_M


def test_soles_stay_where_they_stand(run: Run) -> None:
    assert np.abs(run.soles_true - run.soles_true[0]).max() < DRIFT_M


def test_measured_normal_forces_carry_the_weight(
    model: RobotModel, run: Run, later: slice
) -> None:
    weight = model.mass * GRAVITY
    total = run.F_meas[later][:, NORMAL_ROWS].sum(axis=1)
    assert total.mean() == pytest.approx(weight, rel=WEIGHT_RELATIVE)
    assert np.median(np.abs(total - weight)) < WEIGHT_RELATIVE * weight


def test_compensated_wrenches_are_those_of_the_contacts(run: Run, later: slice) -> None:
    """Sign, frame, lever and plate weight, against the simulator's contacts."""
    error = (run.F_meas - run.F_true)[later].mean(axis=0).reshape(2, 6)
    assert np.abs(error[:, :3]).max() < WRENCH_N
    assert np.abs(error[:, 3:]).max() < WRENCH_NM


def test_estimated_centre_of_mass_is_the_true_one(
    run: Run, com_over_soles: Array, later: slice
) -> None:
    assert np.abs((run.com - com_over_soles)[later]).max() < ESTIMATE_M


def test_posture_is_held_while_the_sensors_are_calibrated(
    walker: Robot, run: Run
) -> None:
    calibration = run.time_s < ControllerSettings().estimator.calibration_s - 2e-3
    assert calibration.any()
    np.testing.assert_array_equal(
        run.commands[calibration],
        np.broadcast_to(walker.nominal, run.commands[calibration].shape),
    )
    assert not np.array_equal(run.commands[-1], walker.nominal)


def test_commands_never_jump(walker: Robot, run: Run) -> None:
    fastest = ControllerSettings().dik.velocity_limit_rad_s * walker.period_s
    assert np.abs(np.diff(run.commands, axis=0)).max() <= fastest * (1.0 + 1e-9)
