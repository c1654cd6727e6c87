"""The swing foot's task is met exactly where it can be."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from surefoot.schemas.settings import WalkSettings
from surefoot.stabilizer.control.tasks import standing_tasks
from surefoot.stabilizer.control.tsid import Tsid
from surefoot.stabilizer.dynamics import SOLE_ROWS
from surefoot.stabilizer.walking.swing import SwingReference, SwingTask
from tests.stabilizer.rig import Rig
from tests.stabilizer.states import State, states_near_stance

DT = 1e-6
EXACT = 1e-9


def some_state(
    rig: Rig, *, seed: int, spread: float = 0.2, speed: float = 0.5
) -> State:
    (state,) = states_near_stance(
        rig.model, count=1, seed=seed, spread=spread, speed=speed
    )
    return state


@pytest.mark.parametrize("side", [0, 1])
def test_on_its_reference_the_sole_keeps_its_motion(rig: Rig, side: int) -> None:
    dynamics = rig.go(some_state(rig, seed=side))
    R, twist = dynamics.R_world_sole[side], dynamics.v_sole[SOLE_ROWS[side]]
    reference = SwingReference()
    reference.p[:] = dynamics.p_sole[side]
    reference.R[:] = R
    reference.v[:] = reference.v_ahead[:] = R @ twist[:3]
    reference.w[:] = R @ twist[3:]
    task = SwingTask(side, reference, WalkSettings())
    wanted, r = np.zeros(6), np.zeros(6)
    task.compare(dynamics)
    task.twist(dynamics, r)
    np.testing.assert_allclose(r, twist, atol=EXACT)
    # A point without acceleration: its velocity stands still in the world.
    task.acceleration(dynamics, rig.stance, wanted)
    turned = pin.exp3(-DT * twist[3:]) @ twist[:3]
    np.testing.assert_allclose(wanted[:3], (turned - twist[:3]) / DT, atol=1e-4)
    np.testing.assert_allclose(wanted[3:], 0.0, atol=EXACT)


@pytest.mark.parametrize("side", [0, 1])
def test_errors_are_pulled_back(rig: Rig, side: int) -> None:
    dynamics = rig.go(some_state(rig, seed=9))
    R = dynamics.R_world_sole[side]
    reference = SwingReference()
    offset, turn = np.array([0.01, -0.02, 0.03]), np.array([0.02, 0.01, -0.03])
    reference.p[:] = dynamics.p_sole[side] + offset
    reference.R[:] = R @ pin.exp3(turn)
    r = np.zeros(6)
    task = SwingTask(side, reference, WalkSettings())
    task.compare(dynamics)
    task.twist(dynamics, r)
    gain = WalkSettings().swing_gain
    np.testing.assert_allclose(r[:3], gain * offset @ R, atol=EXACT)
    np.testing.assert_allclose(r[3:], gain * turn, atol=EXACT)


def test_the_first_qp_reaches_the_swing_acceleration(rig: Rig) -> None:
    """With one foot down the other leg is free: its task costs the others little."""
    rig.go(some_state(rig, seed=4, spread=0.02, speed=0.0))
    references = (SwingReference(), SwingReference())
    swing = [SwingTask(s, ref, WalkSettings()) for s, ref in enumerate(references)]
    tasks = standing_tasks(rig.model, rig.settings)
    tsid = Tsid(rig.model, rig.settings.tsid, tasks, swing=swing)
    side, dynamics = 1, rig.dynamics
    reference = references[side]
    reference.p[:] = dynamics.p_sole[side]
    reference.R[:] = dynamics.R_world_sole[side]
    reference.a[:] = 0.3, -0.2, 1.0
    swing[side].compare(dynamics)
    solution = tsid.solve(
        dynamics,
        rig.stance,
        in_contact=[True, False],
        allowed=np.full(2, rig.largest_force),
        airborne=side,
    )
    assert solution.ok
    qdd = tsid.A @ tsid.tau + tsid.b
    rows = SOLE_ROWS[side]
    reached = dynamics.J_contact[rows] @ qdd + dynamics.Jdot_v_contact[rows]
    wanted = np.zeros(6)
    swing[side].acceleration(dynamics, rig.stance, wanted)
    assert np.linalg.norm(reached - wanted) < 0.2 * np.linalg.norm(wanted)
