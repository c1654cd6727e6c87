"""The order of joints in the robot file is the order of the bus, and no more."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import build_settings
from surefoot.stabilizer.control.whole_body import WholeBodyController
from surefoot.stabilizer.model import RobotModel
from tests.stabilizer.standing_snapshot import standing_reference, standing_snapshot

Order = NDArray[np.int64]
TICKS = 120
SETTINGS = build_settings(
    {}, overrides=["estimator.calibration_s=0.02", "dik.ramp_in_s=0.02"]
)


@pytest.fixture
def order(walker: Robot) -> Order:
    """(n_a,) a shuffle that leaves hardly any joint where it was."""
    return np.random.default_rng(32).permutation(walker.n_a)


@pytest.fixture
def shuffled(walker: Robot, order: Order) -> Robot:
    """The same robot, its joints listed in another order."""
    joints = [walker.file.joint[i] for i in order]
    return replace(
        walker,
        file=msgspec.structs.replace(walker.file, joint=joints),
        lower=walker.lower[order],
        upper=walker.upper[order],
    )


def answers(robot: Robot, *, snapshots: list[Snapshot], posture: Array) -> Array:
    """(ticks, n_a) commands on the bus, while a planner asks for a posture."""
    controller = WholeBodyController(robot, SETTINGS)
    controller.start(snapshots[0], robot.nominal)
    reference = msgspec.structs.replace(
        standing_reference(controller.model), posture=posture.tolist()
    )
    return np.array([controller.step(s, reference).q_command.copy() for s in snapshots])


def test_model_is_the_same(shuffled: Robot, model: RobotModel) -> None:
    other = RobotModel(shuffled)
    for name in ("lower", "upper", "torque_limit", "velocity_limit", "nominal"):
        np.testing.assert_array_equal(getattr(other, name), getattr(model, name))
    np.testing.assert_array_equal(other.pin_model.armature, model.pin_model.armature)


def test_commands_come_in_the_order_of_the_bus(
    walker: Robot, shuffled: Robot, model: RobotModel, order: Order
) -> None:
    rng = np.random.default_rng(33)
    snapshot = standing_snapshot(model)
    readings = [
        replace(
            snapshot,
            q=snapshot.q + 1e-3 * rng.normal(size=walker.n_a),
            dq=1e-2 * rng.normal(size=walker.n_a),
            ft_left=snapshot.ft_left + rng.normal(size=6),
        )
        for _ in range(TICKS)
    ]
    reordered = [replace(s, q=s.q[order], dq=s.dq[order]) for s in readings]
    posture = walker.nominal + 0.05 * rng.normal(size=walker.n_a)
    expected = answers(walker, snapshots=readings, posture=posture)
    actual = answers(shuffled, snapshots=reordered, posture=posture[order])
    assert np.abs(expected[-1] - walker.nominal).max() > 1e-3
    np.testing.assert_array_equal(actual, expected[:, order])
