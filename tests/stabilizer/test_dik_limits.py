"""Joint commands stay within velocity and position limits."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.model import N_BASE_V, RobotModel
from tests.stabilizer.explicit_dik import velocity_range
from tests.stabilizer.rig import Rig
from tests.stabilizer.states import nominal_state, states_near_stance

STATES = 25
SPREAD, SPEED = 0.1, 0.5
WITHIN = 1e-6
"""Violation that the interior point method may leave [rad/s, rad]."""
WILD_TWIST = 3.0
PERIOD_S = 0.001
TICKS = 400
EAGER_GAIN = 50.0
"""Posture gain at which a joint moves to its reference at full speed [1/s]."""


def eager(settings: ControllerSettings) -> ControllerSettings:
    """Return settings whose posture task outweighs the others."""
    dik = msgspec.structs.replace(
        settings.dik,
        posture_gain=EAGER_GAIN,
        posture_weight=1e3,
        leg_posture_weight=1e3,
    )
    return msgspec.structs.replace(settings, dik=dik)


def joint_velocity(rig: Rig, r: Array, q_command: Array) -> Array:
    solution = rig.solve_dik(r, q_command=q_command)
    assert solution.ok, solution.status
    return solution.x[N_BASE_V:].copy()


def test_velocity_limits_hold_and_are_reached(rig: Rig) -> None:
    rng = np.random.default_rng(15)
    fastest = np.minimum(
        rig.model.velocity_limit, rig.settings.dik.velocity_limit_rad_s
    )
    closest = np.inf
    for state in states_near_stance(
        rig.model, count=STATES, seed=16, spread=SPREAD, speed=SPEED
    ):
        rig.go(state)
        # In the middle of the ranges only the velocity limits act.
        middle = 0.5 * (rig.model.lower + rig.model.upper)
        v_joint = joint_velocity(rig, WILD_TWIST * rng.normal(size=12), middle)
        assert (np.abs(v_joint) <= fastest + WITHIN).all()
        closest = min(closest, float((fastest - np.abs(v_joint)).min()))
    assert closest < WITHIN


def test_joint_range_bounds_the_velocity(rig: Rig) -> None:
    rng = np.random.default_rng(17)
    for state in states_near_stance(
        rig.model, count=STATES, seed=18, spread=SPREAD, speed=SPEED
    ):
        rig.go(state)
        q_command = rng.uniform(rig.model.lower, rig.model.upper)
        lower, upper = velocity_range(rig, q_command)
        v_joint = joint_velocity(rig, WILD_TWIST * rng.normal(size=12), q_command)
        assert (v_joint >= lower - WITHIN).all()
        assert (v_joint <= upper + WITHIN).all()


@pytest.mark.parametrize("end", ["lower", "upper"])
def test_joint_at_its_limit_does_not_go_on(model: RobotModel, end: str) -> None:
    rig = Rig(model, eager(ControllerSettings()))
    rig.go(nominal_state(model))
    margin = rig.settings.dik.limit_margin_rad
    if end == "upper":
        q_command = model.upper - margin
        rig.stance.posture[:] = model.upper + 1.0
        v_joint = joint_velocity(rig, np.zeros(12), q_command)
        assert (v_joint <= WITHIN).all()
    else:
        q_command = model.lower + margin
        rig.stance.posture[:] = model.lower - 1.0
        v_joint = joint_velocity(rig, np.zeros(12), q_command)
        assert (v_joint >= -WITHIN).all()


@pytest.mark.parametrize("beyond", [-1.0, 1.0], ids=["lower", "upper"])
def test_damper_keeps_the_integrated_command_inside(
    model: RobotModel, beyond: float
) -> None:
    """A posture out of reach pulls every joint to the end of its range, no further."""
    rig = Rig(model, eager(ControllerSettings()))
    rig.go(nominal_state(model))
    margin = rig.settings.dik.limit_margin_rad
    lowest, highest = model.lower + margin, model.upper - margin
    rig.stance.posture[:] = (highest if beyond > 0.0 else lowest) + beyond
    q_command = model.nominal.copy()
    for _ in range(TICKS):
        q_command += PERIOD_S * joint_velocity(rig, np.zeros(12), q_command)
        assert (q_command >= np.minimum(lowest, model.nominal) - WITHIN).all()
        assert (q_command <= np.maximum(highest, model.nominal) + WITHIN).all()
    reached = highest - q_command if beyond > 0.0 else q_command - lowest
    assert np.median(reached) < margin


def test_command_outside_its_range_comes_back(rig: Rig, model: RobotModel) -> None:
    rig.go(nominal_state(model))
    over = model.upper + 0.05
    v_joint = joint_velocity(rig, np.zeros(12), over)
    assert (v_joint < 0.0).all()
