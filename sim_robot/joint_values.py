"""Values of a scenario that are given for all joints, or by joint."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array
from surefoot.schemas.validation import nearest
from surefoot.sim_robot.errors import ScenarioError


def per_joint(
    value: float | Mapping[str, float], robot: Robot, *, what: str, default: float = 0.0
) -> Array:
    """Spread a value over the joints, (n_a,) in bus order.

    Args:
        value: for all joints, or by the name of a joint.
        robot: names the joints.
        what: path of the key, for errors.
        default: of the joints that are not named.

    Raises:
        ScenarioError: no such joint.
    """
    if not isinstance(value, Mapping):
        return np.full(robot.n_a, float(value))
    spread = np.full(robot.n_a, default)
    for name, number in value.items():
        if name not in robot.joint_names:
            raise ScenarioError(
                f"{what}: {robot.file.name} has no joint {name!r}"
                f"{nearest(name, robot.joint_names)}; there are "
                f"{', '.join(robot.joint_names)}",
                field=what,
            )
        spread[robot.joint_names.index(name)] = number
    return spread
