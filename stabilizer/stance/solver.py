"""Solves for postures with soles level under the CoM, and finds how far they reach."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from surefoot.schemas.arrays import Array, Mat, Vec3

MUST = 1e3
"""Weight of what a posture must fulfil, against that of what it should."""
LEG_PULL, OTHER_PULL = 0.01, 30.0
"""Weight of the joints' distance from their wanted positions [1/rad]: no posture gets
better by a raised arm."""
GOOD = 2e-3
"""Error of soles and CoM up to which a posture is good [m, rad]."""
_INSIDE_RAD = 1e-6
MOST_STEPS = 80
FARTHEST_M = 0.5
_HALVINGS = 6
_STEPS = 25
"""Most steps of a search on moved ground: it begins near, in the nominal posture."""


@dataclass(frozen=True)
class Wanted:
    """Requirements and wishes for a posture.

    Attributes:
        q: (n_a,) wanted positions of joints that are otherwise free [rad].
        between: (3,) required vector from right to left sole [m].
        joints: velocity index to required angle [rad].
        com_height_m: required height above the middle of the soles; None: free.
        turned: roll and pitch of the ground under left and right sole [rad].
    """

    q: Array
    between: Vec3
    joints: Mapping[int, float] = field(default_factory=dict)
    com_height_m: float | None = None
    turned: tuple[tuple[float, float], tuple[float, float]] = ((0.0, 0.0), (0.0, 0.0))


@dataclass(frozen=True)
class Found:
    """A posture.

    Attributes:
        q: (n_a,) in model order [rad].
        error: largest deviation of soles, CoM and joints from their requirements [m,
            rad].
    """

    q: Array
    error: float

    @property
    def is_good(self) -> bool:
        """Whether the requirements are met."""
        return self.error < GOOD


class StanceSolver:
    """Least squares over the joints of a robot whose base stays upright."""

    def __init__(
        self,
        model: pin.Model,
        sole_ids: list[int],
        *,
        R_world_base: Mat,
        lower: Array,
        upper: Array,
        is_leg: NDArray[np.bool_],
    ) -> None:
        """Prepare.

        Args:
            model: with a floating base.
            sole_ids: frames of left and right sole, z up, x ahead.
            R_world_base: (3, 3) attitude of the base when upright.
            lower: (n_a,) lower ends of what joints may use, model order [rad].
            upper: (n_a,) upper ends [rad].
            is_leg: (n_a,) whether a joint lies between the base and a sole.
        """
        self._model, self._data = model, model.createData()
        self._soles = sole_ids
        self._base = np.concatenate(
            (np.zeros(3), pin.Quaternion(R_world_base).coeffs())
        )
        room = np.minimum(_INSIDE_RAD, 0.25 * (upper - lower))
        self.lower, self.upper = lower + room, upper - room
        self._pull = np.where(is_leg, LEG_PULL, OTHER_PULL)

    def solve(
        self, wanted: Wanted, *, steps: int = MOST_STEPS, exact: bool = True
    ) -> Found:
        """Find a posture.

        Args:
            wanted: requirements and wishes.
            steps: number of steps after which it gives up.
            exact: whether to go on until nothing changes, not only until good or stuck.
        """
        from scipy.optimize import least_squares

        begin = wanted.q.copy()
        for index, angle in wanted.joints.items():
            begin[index] = angle
        found = least_squares(
            lambda q: self._residual(q, wanted),
            np.clip(begin, self.lower, self.upper),
            jac=lambda q: self._jacobian(q, wanted),
            bounds=(self.lower - _INSIDE_RAD / 2.0, self.upper + _INSIDE_RAD / 2.0),
            xtol=1e-10 if exact else 1e-6,
            ftol=1e-10 if exact else 1e-3,
            gtol=1e-10,
            max_nfev=steps,
        )
        must = found.fun[: len(found.fun) - len(self._pull)] / MUST
        return Found(q=found.x, error=float(np.abs(must).max()))

    def place(self, q: Array) -> tuple[Vec3, Vec3, Vec3]:
        """Return left sole, right sole and CoM of a posture.

        Args:
            q: (n_a,) [rad].

        Returns:
            (3,) each, world axes, from the base link's origin [m].
        """
        self._kinematics(q)
        left, right = (self._data.oMf[i].translation.copy() for i in self._soles)
        return left, right, self._data.com[0].copy()

    def _kinematics(self, q: Array) -> None:
        full = np.concatenate((self._base, q))
        pin.centerOfMass(self._model, self._data, full)
        pin.updateFramePlacements(self._model, self._data)

    def _residual(self, q: Array, wanted: Wanted) -> Array:
        self._kinematics(q)
        left, right = (self._data.oMf[i] for i in self._soles)
        turns = [
            pin.log3(ground.T @ pose.rotation)
            for ground, pose in zip(_grounds(wanted), (left, right), strict=True)
        ]
        apart = left.translation - right.translation - wanted.between
        over = self._data.com[0] - 0.5 * (left.translation + right.translation)
        if wanted.com_height_m is None:
            over = over[:2]
        else:
            over[2] -= wanted.com_height_m
        given = [q[index] - angle for index, angle in wanted.joints.items()]
        must = MUST * np.concatenate((*turns, apart, over, given))
        return np.concatenate((must, self._pull * (q - wanted.q)))

    def _jacobian(self, q: Array, wanted: Wanted) -> Mat:
        full = np.concatenate((self._base, q))
        model, data = self._model, self._data
        J_com = pin.jacobianCenterOfMass(model, data, full)[:, 6:]
        pin.computeJointJacobians(model, data, full)
        pin.updateFramePlacements(model, data)
        turns, moves = [], []
        for i, ground in zip(self._soles, _grounds(wanted), strict=True):
            J = pin.getFrameJacobian(model, data, i, pin.LOCAL)[:, 6:]
            R = data.oMf[i].rotation
            turns.append(pin.Jlog3(ground.T @ R) @ J[3:])
            moves.append(R @ J[:3])
        apart = moves[0] - moves[1]
        over = J_com - 0.5 * (moves[0] + moves[1])
        if wanted.com_height_m is None:
            over = over[:2]
        given = np.zeros((len(wanted.joints), len(q)))
        for row, index in enumerate(wanted.joints):
            given[row, index] = 1.0
        must = MUST * np.vstack((*turns, apart, over, given))
        return np.vstack((must, np.diag(self._pull)))


def _grounds(wanted: Wanted) -> list[Mat]:
    """Return the rotation from the ground under each sole to the world, (3, 3)."""
    return [pin.rpy.rpyToMatrix(roll, pitch, 0.0) for roll, pitch in wanted.turned]


FARTHEST_RAD = math.radians(30.0)


class GroundPose(NamedTuple):
    """Pose of ground, relative to that in the nominal posture.

    Attributes:
        z: height [m].
        roll: [rad].
        pitch: [rad].
    """

    z: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0

    def scaled(self, share: float) -> GroundPose:
        """Return a part of this motion."""
        return GroundPose(share * self.z, share * self.roll, share * self.pitch)


class Ground(NamedTuple):
    """What is under the feet.

    Attributes:
        left: under the left foot, turned about its sole; or under both feet, turned
            about the middle between them.
        right: under the right foot; None for one ground under both.
    """

    left: GroundPose
    right: GroundPose | None = None

    def scaled(self, share: float) -> Ground:
        """Return a part of all motions."""
        right = None if self.right is None else self.right.scaled(share)
        return Ground(self.left.scaled(share), right)


@dataclass(frozen=True)
class Reach:
    """Largest motions of the ground, each by itself.

    Attributes:
        rise_m: rise of the CoM over the feet: ground that sinks by this.
        sink_m: sink of the CoM: ground that rises by this.
        roll_rad: roll, the smaller one of both signs.
        pitch_rad: (2,) pitch with toes up, toes down.
    """

    rise_m: float
    sink_m: float
    roll_rad: float
    pitch_rad: tuple[float, float]


class ReachSearch:
    """Tries postures on moved ground, starting from the nominal one."""

    def __init__(self, solver: StanceSolver, nominal: Array) -> None:
        """Take the nominal posture as the wanted one.

        Args:
            solver: of the robot.
            nominal: (n_a,) nominal posture in model order [rad].
        """
        self._solver, self._nominal = solver, nominal
        left, right, com = solver.place(nominal)
        self._apart = float(left[1] - right[1])
        self._height = float(com[2] - 0.5 * (left[2] + right[2]))

    def fits(self, ground: Ground) -> bool:
        """Return whether the robot can stand upright with its CoM where it was."""
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
        """Return the part of all these motions that fits, between 0 and 1."""
        listed = list(grounds)
        share = 1.0
        for ground in listed:
            if self.fits(ground.scaled(share)):
                continue
            share *= self._part(ground.scaled(share))
        return share

    def _part(self, ground: Ground) -> float:
        return _bisect(lambda share: self.fits(ground.scaled(share)))

    def step_share(self, ways: Iterable[Vec3]) -> float:
        """Return the part of all these steps that fits, between 0 and 1.

        With both soles flat, the base upright and the CoM over their middle, as high as
        in the nominal posture.

        Args:
            ways: (3,) each, from the right to the left sole [m].
        """
        beside, share = np.array([0.0, self._apart, 0.0]), 1.0
        for way in ways:
            reached = share * (way - beside)
            if not self._spans(beside + reached):
                share *= _bisect(partial(self._spans_part, beside, reached))
        return share

    def _spans_part(self, beside: Vec3, way: Vec3, part: float) -> bool:
        return self._spans(beside + part * way)

    def _spans(self, between: Vec3) -> bool:
        wanted = Wanted(self._nominal, between, com_height_m=self._height)
        return self._solver.solve(wanted, steps=_STEPS, exact=False).is_good

    def reach(self, enough: Reach | None = None) -> Reach:
        """Search each direction by itself, none farther than ``enough``."""
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
        """Return how much of one motion of ground under both feet fits."""
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
