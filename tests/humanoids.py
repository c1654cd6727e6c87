"""Other humanoids: URDFs from the wheels that hold them, and what makes them robots.

None is part of this project. ``pip install -e '.[humanoids]'`` brings the wheels;
without them the tests that ask for one are skipped.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

import pytest

from surefoot.robot_files.new_robot import NewRobot, NewRobotOptions, new_robot


@dataclass(frozen=True)
class Humanoid:
    """A robot of a wheel.

    Attributes:
        wheel: what to install.
        urdf: how the path of its URDF ends.
        options: what is to be said about it.
    """

    wheel: str
    urdf: str
    options: NewRobotOptions

    def find(self) -> Path:
        """Return its URDF; without the wheel the test is skipped."""
        try:
            listed = files(self.wheel) or []
        except PackageNotFoundError:
            pytest.skip(f"no {self.wheel}: pip install -e '.[humanoids]'")
        return next(
            Path(str(f.locate())).resolve()
            for f in listed
            if str(f).endswith(self.urdf)
        )

    def make(self, out: Path) -> NewRobot:
        """Make the robot as the command does."""
        return new_robot(self.find(), self.options, out=out)


_EXAMPLE = "example-robot-data"
_JVRC = ("jvrc_description", "urdf/jvrc1.urdf")
HUMANOIDS = {
    "jvrc": Humanoid(
        *_JVRC, NewRobotOptions("L_ANKLE_P_S", "R_ANKLE_P_S", name="jvrc")
    ),
    "jvrc-legs": Humanoid(
        *_JVRC,
        NewRobotOptions("L_ANKLE_P_S", "R_ANKLE_P_S", name="jvrc-legs", legs_only=True),
    ),
    "talos": Humanoid(
        _EXAMPLE,
        "robots/talos_reduced.urdf",
        NewRobotOptions("left_sole_link", "right_sole_link", repair_inertias=True),
    ),
    "g1": Humanoid(
        _EXAMPLE,
        "urdf/g1_29dof_rev_1_0.urdf",
        NewRobotOptions("left_ankle_roll_link", "right_ankle_roll_link", name="g1"),
    ),
    "romeo": Humanoid(
        _EXAMPLE,
        "urdf/romeo.urdf",
        NewRobotOptions("l_sole", "r_sole", repair_inertias=True),
    ),
    "icub": Humanoid(
        "icub-models",
        "iCubGazeboV2_7/model.urdf",
        NewRobotOptions("l_sole", "r_sole", name="icub"),
    ),
}
