"""The reflection at the robot's x-z plane, which exchanges left and right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.stabilizer.model import N_BASE_V, RobotModel

VECTOR = np.array([1.0, -1.0, 1.0])
"""Reflects positions, velocities, accelerations and forces."""
PSEUDOVECTOR = -VECTOR
"""Reflects rotations, angular velocities and moments."""
_SIX = np.concatenate((VECTOR, PSEUDOVECTOR))


class Mirror:
    """Mirrors the robot's readings and commands.

    The partner of each joint follows from the names, its sign from the axes; the
    robot's tables are not used.
    """

    def __init__(self, model: RobotModel) -> None:
        names = model.robot.joint_names
        self._partner = np.array([names.index(_other_side(name)) for name in names])
        q = np.zeros(model.pin_model.nq)
        q[6] = 1.0
        J = pin.computeJointJacobians(model.pin_model, model.pin_model.createData(), q)
        axes = J[3:, N_BASE_V:][:, model.to_bus]
        partners = axes[:, self._partner]
        self._sign = np.sum(partners * PSEUDOVECTOR[:, None] * axes, axis=0)

    def joints(self, values: Array) -> Array:
        """Mirror (n_a,) positions, velocities or torques in bus order."""
        mirrored = np.empty_like(values)
        mirrored[self._partner] = self._sign * values
        return mirrored

    def wrenches(self, stacked: Array) -> Array:
        """Mirror (12,) wrenches of left and right foot in their own frames."""
        return np.concatenate((_SIX * stacked[6:], _SIX * stacked[:6]))

    twists = wrenches

    def snapshot(self, snapshot: Snapshot) -> Snapshot:
        """Return the readings of the mirrored robot."""
        x, y, z, w = snapshot.quat_xyzw
        return replace(
            snapshot,
            q=self.joints(snapshot.q),
            dq=self.joints(snapshot.dq),
            effort=self.joints(snapshot.effort),
            quat_xyzw=np.array([-x, y, -z, w]),
            angular_velocity=PSEUDOVECTOR * snapshot.angular_velocity,
            linear_acceleration=VECTOR * snapshot.linear_acceleration,
            ft_left=_SIX * snapshot.ft_right,
            ft_right=_SIX * snapshot.ft_left,
        )


def _other_side(name: str) -> str:
    if name.startswith("left"):
        return name.replace("left", "right", 1)
    return name.replace("right", "left", 1)
