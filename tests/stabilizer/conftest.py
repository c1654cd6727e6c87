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
    """Not to be written."""
    return RobotModel(walker)


@pytest.fixture
def rig(model: RobotModel) -> Rig:
    """With default settings."""
    return Rig(model)


@pytest.fixture
def snapshot(model: RobotModel) -> Snapshot:
    """At rest in the nominal stance."""
    return standing_snapshot(model)


@pytest.fixture(scope="session")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Awkward:
    """Sensors turned, joints in another order: readings follow from the Walker's."""
    return make_awkward(tmp_path_factory.mktemp("turned"), TURNED)


@pytest.fixture(scope="session")
def awkward(tmp_path_factory: pytest.TempPathFactory) -> Awkward:
    """The inertial unit off-centre, too, and the base's origin elsewhere."""
    return make_awkward(tmp_path_factory.mktemp("awkward"), AWKWARD)
