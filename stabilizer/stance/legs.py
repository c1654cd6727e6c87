"""The two legs of a model: their joints, and which of them is the knee."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pinocchio as pin

from surefoot.robot_io.errors import RobotFileError
from surefoot.schemas.arrays import Array

_SAMPLES = 181
LEAST_BEND = 0.02
"""Of its length: a leg that no joint shortens by more than this has no knee."""


@dataclass(frozen=True)
class Leg:
    """One leg.

    Attributes:
        joints: of Pinocchio, from the base to the sole.
        knee: the one that shortens the leg most.
        knee_index: its place in model order.
        angles: (n,) of the knee, over its range [rad].
        lengths: (n,) from the joint before the knee to the one after it [m].
    """

    joints: tuple[int, ...]
    knee: int
    knee_index: int
    angles: Array
    lengths: Array

    @property
    def longest(self) -> float:
        """With the knee as straight as it gets [m]."""
        return float(self.lengths.max())

    @property
    def straight(self) -> float:
        """Angle of the knee then [rad]."""
        return float(self.angles[int(np.argmax(self.lengths))])

    @property
    def bends(self) -> float:
        """Sign of the angle that bends the knee, to the side with more room."""
        room_above = float(self.angles[-1]) - self.straight
        return 1.0 if room_above >= self.straight - float(self.angles[0]) else -1.0

    def bent(self, share: float) -> float:
        """Angle at which the leg has this share of its longest length [rad].

        As near to it as the range allows.
        """
        side = (self.angles - self.straight) * self.bends >= 0.0
        angles, lengths = self.angles[side], self.lengths[side]
        return float(angles[int(np.argmin(np.abs(lengths - share * self.longest)))])


def find_leg(
    model: pin.Model, sole_id: int, *, lower: Array, upper: Array, side: str
) -> Leg:
    """Follow the joints from a sole to the base.

    Args:
        model: with a floating base.
        sole_id: frame of the sole.
        lower: (n_a,) ends of the joint ranges, model order [rad].
        upper: (n_a,) the upper ones [rad].
        side: for messages.

    Raises:
        RobotFileError: no joint shortens the leg.
    """
    joints: list[int] = []
    joint = model.frames[sole_id].parentJoint
    while joint > 1:
        joints.insert(0, int(joint))
        joint = model.parents[joint]
    best, bend = None, 0.0
    for middle, after in pairwise(joints[1:]):
        index = model.idx_qs[middle] - 7
        angles = np.linspace(lower[index], upper[index], _SAMPLES)
        lengths = _lengths(model, middle, after, angles)
        if np.ptp(lengths) > bend:
            best, bend = (middle, angles, lengths), float(np.ptp(lengths))
    if best is None or bend < LEAST_BEND * best[2].max():
        names = ", ".join(model.names[j] for j in joints) or "none"
        raise RobotFileError(
            f"the {side} leg has no knee: none of its joints ({names}) shortens it; is "
            "the sole the end of a leg, and are its joints movable?"
        )
    knee, angles, lengths = best
    return Leg(
        joints=tuple(joints),
        knee=knee,
        knee_index=int(model.idx_vs[knee]) - 6,
        angles=angles,
        lengths=lengths,
    )


def _lengths(model: pin.Model, middle: int, after: int, angles: Array) -> Array:
    """(n,) distance between the joints on either side, at angles of the middle one."""
    up = model.jointPlacements[middle].translation
    R = model.jointPlacements[middle].rotation
    down = model.jointPlacements[after].translation
    data = model.joints[middle].createData()
    q = pin.neutral(model)
    lengths = np.empty(len(angles))
    for i, angle in enumerate(angles):
        q[model.idx_qs[middle]] = angle
        model.joints[middle].calc(data, q)
        moved = data.M.rotation @ down + data.M.translation
        lengths[i] = float(np.linalg.norm(up + R @ moved))
    return lengths
