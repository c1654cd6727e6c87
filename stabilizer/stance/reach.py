"""How far ground may move under a robot that stays upright over it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

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

    def fits(self, ground: GroundPose) -> bool:
        """Whether the robot can stand upright with its CoM where it was."""
        wanted = Wanted(
            q=self._nominal,
            apart_m=self._apart,
            com_height_m=self._height - ground.z,
            roll=ground.roll,
            pitch=ground.pitch,
        )
        return self._solver.solve(wanted, steps=_STEPS).is_good

    def largest_share(self, poses: Iterable[GroundPose]) -> float:
        """Part of all these that fits, between 0 and 1.

        Args:
            poses: extremes of one motion.
        """
        listed = [pose for pose in poses if any(pose)]
        if all(self.fits(pose) for pose in listed):
            return 1.0
        return _bisect(
            lambda share: all(
                self.fits(GroundPose(*(share * value for value in pose)))
                for pose in listed
            )
        )

    def reach(self) -> Reach:
        """Search each direction by itself."""
        rise, sink = (self._farthest(GroundPose(z=s * FARTHEST_M)) for s in (-1.0, 1.0))
        up, down = (
            self._farthest(GroundPose(pitch=s * FARTHEST_RAD)) for s in (-1.0, 1.0)
        )
        left, right = (
            self._farthest(GroundPose(roll=s * FARTHEST_RAD)) for s in (-1.0, 1.0)
        )
        return Reach(
            rise_m=FARTHEST_M * rise,
            sink_m=FARTHEST_M * sink,
            roll_rad=FARTHEST_RAD * min(left, right),
            pitch_rad=(FARTHEST_RAD * up, FARTHEST_RAD * down),
        )

    def _farthest(self, pose: GroundPose) -> float:
        """Part of one motion that fits."""
        return self.largest_share([pose])


def _bisect(fits: Callable[[float], bool]) -> float:
    """Largest share of 1 that fits, from below."""
    if fits(1.0):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low
