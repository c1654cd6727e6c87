"""The Walker and its model, built once."""

from __future__ import annotations

import pytest

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.stabilizer.model import RobotModel
from tests.stabilizer.rig import Rig


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
