"""What a force sensor reads above what hangs below it, on a foot off the ground."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.stabilizer.estimation.wrench_compensation import (
    WrenchCompensation,
    wrench_shift,
)
from surefoot.stabilizer.model import RobotModel


def foot_offsets(model: RobotModel, mean: Snapshot) -> Array:
    """Return what both sensors read but for the weight of the foot below them.

    Args:
        model: the robot.
        mean: of readings of a robot at rest, both feet off the ground; the
            accelerometer tells where up is.

    Returns:
        (2, 6) [force; moment] of left and right, sensor frames [N, N m].
    """
    q = model.nominal_configuration()
    q[7:] = mean.q[model.to_model]
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, q)
    up_in_base = model.T_base_imu.rotation @ mean.linear_acceleration
    up_in_base /= np.linalg.norm(up_in_base)
    # Only the row of "up" counts: which way a sole looks is no matter for a weight.
    R_world_sole = []
    for sole in model.sole_ids:
        R = np.zeros((3, 3))
        R[2] = data.oMf[sole].rotation.T @ up_in_base
        R_world_sole.append(R)
    at_soles = WrenchCompensation(model).update(
        mean.ft_left, mean.ft_right, R_world_sole
    )
    return np.array(
        [
            np.linalg.solve(wrench_shift(T.rotation, T.translation), wrench)
            for T, wrench in zip(
                model.T_sensor_sole, (at_soles[:6], at_soles[6:]), strict=True
            )
        ]
    )
