"""The mirror of the symmetry tests is a reflection."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from surefoot.stabilizer.model import RobotModel
from tests.stabilizer.mirror import VECTOR, Mirror

STATES = 20
TOLERANCE = 1e-9


@pytest.fixture
def mirror(model: RobotModel) -> Mirror:
    return Mirror(model)


def test_twice_mirrored_is_unchanged(model: RobotModel, mirror: Mirror) -> None:
    rng = np.random.default_rng(28)
    joints, wrenches = rng.normal(size=model.n_a), rng.normal(size=12)
    np.testing.assert_allclose(mirror.joints(mirror.joints(joints)), joints)
    np.testing.assert_allclose(mirror.wrenches(mirror.wrenches(wrenches)), wrenches)


def test_nominal_posture_is_its_own_mirror_image(
    model: RobotModel, mirror: Mirror
) -> None:
    nominal = model.robot.nominal
    np.testing.assert_allclose(mirror.joints(nominal), nominal, atol=TOLERANCE)


def test_mirrored_joints_mirror_the_mass(model: RobotModel, mirror: Mirror) -> None:
    """The robot itself is symmetric: its centre of mass goes to the other side."""
    rng = np.random.default_rng(29)
    data = model.pin_model.createData()
    for _ in range(STATES):
        joints = rng.uniform(model.robot.lower, model.robot.upper)
        coms = []
        for values in (joints, mirror.joints(joints)):
            q = np.concatenate((np.zeros(6), [1.0], values[model.to_model]))
            coms.append(pin.centerOfMass(model.pin_model, data, q).copy())
        np.testing.assert_allclose(coms[1], VECTOR * coms[0], atol=TOLERANCE)
