"""The Walker and its model, built once."""

from __future__ import annotations

import pytest

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.stabilizer.model import RobotModel
from tests.awkward_robot import AWKWARD, TURNED, Awkward, make_awkward
from tests.stabilizer.rig import Rig
from tests.stabilizer.standing_snapshot import standing_snapshot


@pytest.fixture(scope="session")
def walker() -> Robot:
    return load_robot("walker")


@pytest.fixture(scope="session")
def model(walker: Robot) -> RobotModel:
    """Return the Walker's model, which tests must not change."""
    return RobotModel(walker)


@pytest.fixture
def rig(model: RobotModel) -> Rig:
    """Return a rig with default settings."""
    return Rig(model)


@pytest.fixture
def snapshot(model: RobotModel) -> Snapshot:
    """Return the sensors of the Walker at rest in the nominal stance."""
    return standing_snapshot(model)


@pytest.fixture(scope="session")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Awkward:
    """Return a Walker with turned sensors and joints in another order."""
    return make_awkward(tmp_path_factory.mktemp("turned"), TURNED)


@pytest.fixture(scope="session")
def awkward(tmp_path_factory: pytest.TempPathFactory) -> Awkward:
    """Return the same with the IMU off-centre and another base frame."""
    return make_awkward(tmp_path_factory.mktemp("awkward"), AWKWARD)
