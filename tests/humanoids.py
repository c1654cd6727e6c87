"""Other humanoids; a test is skipped without the package that holds the robot."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.humanoids import HUMANOIDS, NoWheelError
from surefoot.robot_files.new_robot import NewRobot


def make_humanoid(name: str, out: Path) -> NewRobot:
    """Make one of these robots as ``surefoot new-robot`` does."""
    try:
        return HUMANOIDS[name].make(out)
    except NoWheelError as error:
        pytest.skip(str(error))
