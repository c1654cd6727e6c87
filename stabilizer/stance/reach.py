"""How far ground may move under a robot that stays upright over it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.stabilizer.stance.solver import StanceSolver, Wanted

FARTHEST_M = 0.5
FARTHEST_RAD = math.radians(30.0)
_HALVINGS = 6
_STEPS = 25
"""From the nominal posture it is never far."""


class GroundPose(NamedTuple):
    """Where ground is, against where the robot stands on it in its nominal posture.

    Attributes:
        z: up [m].
        roll: [rad].
        pitch: [rad].
    """

    z: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0

    def scaled(self, share: float) -> GroundPose:
        """A part of it."""
        return GroundPose(share * self.z, share * self.roll, share * self.pitch)


class Ground(NamedTuple):
    """What is under the feet.

    Attributes:
        left: under the left foot, turned about its sole; or under both, turned about
            the middle between them.
        right: under the right foot; None when there is one ground under both.
    """

    left: GroundPose
    right: GroundPose | None = None

    def scaled(self, share: float) -> Ground:
        """A part of all motions."""
        right = None if self.right is None else self.right.scaled(share)
        return Ground(self.left.scaled(share), right)


@dataclass(frozen=True)
class Reach:
    """What one direction of moving ground may amount to.

    Attributes:
        rise_m: of the CoM over the feet: ground that sinks by so much.
        sink_m: of the CoM: ground that rises by so much.
        roll_rad: smaller one of both signs.
        pitch_rad: (2,) toes up, toes down.
    """

    rise_m: float
    sink_m: float
    roll_rad: float
    pitch_rad: tuple[float, float]


class ReachSearch:
    """Tries postures on moved ground, from the nominal one."""

    def __init__(self, solver: StanceSolver, nominal: Array) -> None:
        """Take the nominal posture for what is wanted.

        Args:
            solver: of the robot.
            nominal: (n_a,) in model order [rad].
        """
        self._solver, self._nominal = solver, nominal
        left, right, com = solver.place(nominal)
        self._apart = float(left[1] - right[1])
        self._height = float(com[2] - 0.5 * (left[2] + right[2]))

    def fits(self, ground: Ground) -> bool:
        """Whether the robot can stand upright with its CoM where it was."""
        left, right = ground.left, ground.right or ground.left
        between = np.array([0.0, self._apart, left.z - right.z])
        if ground.right is None:
            between[1] = self._apart * math.cos(left.roll)
            between[2] = self._apart * math.sin(left.roll)
        wanted = Wanted(
            q=self._nominal,
            between=between,
            com_height_m=self._height - 0.5 * (left.z + right.z),
            turned=((left.roll, left.pitch), (right.roll, right.pitch)),
        )
        return self._solver.solve(wanted, steps=_STEPS, exact=False).is_good

    def largest_share(self, grounds: Iterable[Ground]) -> float:
        """Part of all these that fits, between 0 and 1.

        Args:
            grounds: extremes of one motion.
        """
        listed = list(grounds)
        share = 1.0
        for ground in listed:
            if self.fits(ground.scaled(share)):
                continue
            share *= self._part(ground.scaled(share))
        return share

    def _part(self, ground: Ground) -> float:
        return _bisect(lambda share: self.fits(ground.scaled(share)))

    def reach(self, enough: Reach | None = None) -> Reach:
        """Search each direction by itself.

        Args:
            enough: no direction that gets so far is searched any further.
        """
        up, down = math.inf, math.inf
        rise, sink, roll = math.inf, math.inf, math.inf
        if enough is not None:
            (up, down), roll = enough.pitch_rad, enough.roll_rad
            rise, sink = enough.rise_m, enough.sink_m
        return Reach(
            rise_m=self._farthest(GroundPose(z=-1.0), FARTHEST_M, rise),
            sink_m=self._farthest(GroundPose(z=1.0), FARTHEST_M, sink),
            roll_rad=min(
                self._farthest(GroundPose(roll=sign), FARTHEST_RAD, roll)
                for sign in (-1.0, 1.0)
            ),
            pitch_rad=(
                self._farthest(GroundPose(pitch=-1.0), FARTHEST_RAD, up),
                self._farthest(GroundPose(pitch=1.0), FARTHEST_RAD, down),
            ),
        )

    def _farthest(self, one: GroundPose, most: float, enough: float) -> float:
        """How much of one motion of the ground under both feet fits."""
        if enough < most and self.fits(Ground(one.scaled(enough))):
            return enough
        return most * self.largest_share([Ground(one.scaled(most))])


def _bisect(fits: Callable[[float], bool]) -> float:
    """Largest share of 1 that fits, from below."""
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low
