"""Makes controllers by the name they have on the command line."""

from __future__ import annotations

from robot_io.robot import Robot
from schemas.settings import ControllerSettings
from stabilizer.controller import Controller
from stabilizer.hold import HoldController
from stabilizer.whole_body import WholeBodyController
from stabilizer.zmp.zmp_controller import ZmpController

CONTROLLERS = (WholeBodyController.name, ZmpController.name, HoldController.name)


def make_controller(
    name: str, robot: Robot, settings: ControllerSettings
) -> Controller:
    """Makes a controller, ready to be started.

    Args:
        name: one of CONTROLLERS.
        robot: what its files say.
        settings: of all controllers.

    Raises:
        ValueError: there is no such controller.
    """
    if name == WholeBodyController.name:
        return WholeBodyController(robot, settings)
    if name == ZmpController.name:
        return ZmpController(robot, settings)
    if name == HoldController.name:
        return HoldController(robot.n_a)
    raise ValueError(
        f"controller: got {name!r}, expected one of {', '.join(CONTROLLERS)}"
    )
