"""The Walker with other frames and another joint order, for tests.

In its URDF frames are turned and shifted, and joints are listed in another order. Its
physics is the Walker's. So every result for it must be the Walker's, in other frames
and another order. Its files are made from the Walker's at each use.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from benchmarks.mounted import Drawing, placement, write_mounted
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array, Vec6

SHUFFLE_SEED = 32

FEET = (
    placement((0.02, -0.01, -0.015), (np.pi, 0.0, 0.7)),
    placement((-0.01, 0.0, 0.01), (1.2, -0.4, -2.5)),
)
"""The left sensor has z down, as many are mounted; the right one is turned freely."""
TURN = placement((0.0, 0.0, 0.0), (2.4, -0.9, 3.0))
"""Attitude of the IMU: its x axis points backward and down."""
TURNED = Drawing(imu=TURN, feet=FEET)
"""Readings are the Walker's in turned frames: see :meth:`Awkward.snapshot`."""
AWKWARD = Drawing(
    base=placement((0.04, -0.03, 0.11), (1.3, 0.4, -2.8)),
    imu=placement((0.09, -0.12, 0.15), (2.4, -0.9, 3.0)),
    feet=FEET,
)
"""The IMU is off-centre, too, and the base's frame is moved."""


@dataclass(frozen=True)
class Awkward:
    """An awkward robot, and the conversions from the Walker to it.

    Attributes:
        robot: the robot, loaded from its files.
        walker: the Walker.
        drawing: how the frames differ.
        order: (n_a,) ``its_values = walkers_values[order]``, on the bus.
    """

    robot: Robot
    walker: Robot
    drawing: Drawing
    order: NDArray[np.intp]

    def joints(self, values: Array) -> Array:
        """Return (..., n_a) the Walker's joint values in this robot's order."""
        return values[..., self.order]

    def back(self, values: Array) -> Array:
        """Return (..., n_a) this robot's joint values in the Walker's order."""
        return values[..., np.argsort(self.order)]

    def configuration(self, q: Array) -> Array:
        """Return (7 + n_a,) the same pose of the body; Pinocchio orders joints by name.

        The model's base has upright axes, whatever the axes of the base link.
        """
        moved = q.copy()
        moved[:3] = pin.XYZQUATToSE3(q[:7]).act(self.drawing.base.translation)
        return moved

    def snapshot(self, reading: Snapshot) -> Snapshot:
        """Return this robot's readings where the Walker has the given ones.

        Raises:
            ValueError: the IMU is shifted; then its readings depend on the motion, and
                not only on the Walker's reading.
        """
        unit = self.drawing.imu
        if unit.translation.any():
            raise ValueError("the inertial unit is not where the Walker's is")
        attitude = pin.Quaternion(reading.quat_xyzw) * pin.Quaternion(unit.rotation)
        return replace(
            reading,
            q=self.joints(reading.q),
            dq=self.joints(reading.dq),
            effort=self.joints(reading.effort),
            quat_xyzw=attitude.coeffs().copy(),
            angular_velocity=reading.angular_velocity @ unit.rotation,
            linear_acceleration=reading.linear_acceleration @ unit.rotation,
            ft_left=_seen_from(self.drawing.feet[0], reading.ft_left),
            ft_right=_seen_from(self.drawing.feet[1], reading.ft_right),
        )


def make_awkward(folder: Path, drawing: Drawing) -> Awkward:
    """Write the robot's two files and load them.

    Args:
        folder: where the folder ``awkward`` with ``awkward.toml`` and ``awkward.urdf``
            is made.
        drawing: how the frames differ.
    """
    walker = load_robot("walker")
    rng = np.random.default_rng(SHUFFLE_SEED)
    order = rng.permutation(walker.n_a)
    parts = rng.permutation(len(ElementTree.parse(walker.urdf_path).getroot()))
    inside = folder / "awkward"
    inside.mkdir()
    path = write_mounted(inside, drawing, joints=order, elements=parts)
    robot = load_robot(str(path))
    return Awkward(robot=robot, walker=walker, drawing=drawing, order=order)


def _seen_from(frame: pin.SE3, wrench: Vec6) -> Vec6:
    """Return (6,) the same wrench in a frame with a given pose in the present one."""
    seen: Vec6 = frame.actInv(pin.Force(wrench)).vector.copy()
    return seen
