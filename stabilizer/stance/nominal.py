"""Chooses the posture a robot stands in: knees bent, room all round."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from surefoot.robot_io.errors import RobotFileError
from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.stabilizer.stance.legs import Leg, find_leg
from surefoot.stabilizer.stance.reach import Reach, ReachSearch
from surefoot.stabilizer.stance.solver import Found, StanceSolver, Wanted

BENT_TO = (0.80, 0.83, 0.86, 0.89, 0.92, 0.95)
"""Shares of its length to which a leg may be bent; earlier ones are tried first."""
KNEE_ROOM_RAD = 0.2
"""Kept between the knee and its straight leg, which cannot follow its ground."""
MARGIN_RAD = 0.02
"""Kept to the ends of all joint ranges."""
RISE_SHARE, SINK_SHARE = 0.14, 0.24
"""Of the leg's length: travel asked for when nobody says how much."""
TILT_RAD = math.radians(10.0)
"""Of the ground, asked for in each direction."""
KEPT_SHARE = 0.9
"""Of the reach that is found: what the controller is told of."""


@dataclass(frozen=True)
class NominalPosture:
    """A posture to stand in.

    Attributes:
        q: (n_a,) in model order [rad].
        lower: (n_a,) what joints may use: their range, and knees not straight [rad].
        upper: (n_a,) [rad].
        legs: left and right.
        knees: joint names.
        com_travel_m: how far the CoM may sink (negative) and rise.
        asked_m: sink and rise that were asked for, both positive.
    """

    q: Array
    lower: Array
    upper: Array
    legs: tuple[Leg, Leg]
    knees: tuple[str, str]
    com_travel_m: tuple[float, float]
    asked_m: tuple[float, float]

    def knee_angle(self, side: int) -> float:
        """Of the left (0) or right (1) knee [rad]."""
        return float(self.q[self.legs[side].knee_index])

    def knee_ahead(self, model: pin.Model, leg: Leg, R_world_base: Mat) -> float:
        """How far a knee is ahead of the line from its hip to its ankle [m]."""
        place = leg.joints.index(leg.knee)
        data = self._kinematics(model)
        above, knee, below = (
            R_world_base @ data.oMi[leg.joints[place + step]].translation
            for step in (-1, 0, 1)
        )
        down = (knee[2] - above[2]) / (below[2] - above[2])
        return float(knee[0] - above[0] - down * (below[0] - above[0]))

    def sole_place(self, model: pin.Model, frame: str) -> Vec3:
        """(3,) where a frame is in the base link [m]."""
        data = self._kinematics(model)
        place: Vec3 = data.oMf[
            model.getFrameId(frame, pin.FrameType.BODY)
        ].translation.copy()
        return place

    def _kinematics(self, model: pin.Model) -> pin.Data:
        data = model.createData()
        q = np.concatenate((pin.neutral(model)[:7], self.q))
        pin.framesForwardKinematics(model, data, q)
        return data


def find_nominal(
    model: pin.Model,
    sole_ids: list[int],
    *,
    R_world_base: Mat,
    apart_m: float,
    rise_m: float | None = None,
    sink_m: float | None = None,
) -> NominalPosture:
    """Bend the knees as far as the travel needs and the ankles allow.

    Of all bends that can be stood in, the one is taken whose reach, against what was
    asked for, is largest where it is smallest; of equal ones the first tried.

    Args:
        model: with a floating base.
        sole_ids: frames of left and right sole.
        R_world_base: (3, 3) attitude of the base when upright.
        apart_m: distance between the soles along y.
        rise_m: how far the CoM should be able to rise over the feet.
        sink_m: how far to sink, positive.

    Raises:
        RobotFileError: a leg has no knee, or there is no such posture.
    """
    lower, upper = model.lowerPositionLimit[7:].copy(), model.upperPositionLimit[7:]
    upper = upper.copy()
    left, right = (
        find_leg(model, sole_id, lower=lower, upper=upper, side=side)
        for sole_id, side in zip(sole_ids, ("left", "right"), strict=True)
    )
    for leg in (left, right):
        _keep_bent(leg, lower, upper)
    asked_rise = RISE_SHARE * left.longest if rise_m is None else rise_m
    asked_sink = SINK_SHARE * left.longest if sink_m is None else sink_m
    solver = StanceSolver(
        model,
        sole_ids,
        R_world_base=R_world_base,
        lower=lower + np.minimum(MARGIN_RAD, 0.25 * (upper - lower)),
        upper=upper - np.minimum(MARGIN_RAD, 0.25 * (upper - lower)),
        is_leg=leg_mask(model, (left, right)),
    )
    tilt = TILT_RAD / KEPT_SHARE
    enough = Reach(
        rise_m=asked_rise / KEPT_SHARE,
        sink_m=asked_sink / KEPT_SHARE,
        roll_rad=tilt,
        pitch_rad=(tilt, tilt),
    )
    between = np.array([0.0, apart_m, 0.0])
    best: tuple[float, Found, Reach] | None = None
    nearest: Found | None = None
    for share in BENT_TO:
        knees = {leg.knee_index: leg.bent(share) for leg in (left, right)}
        found = solver.solve(
            Wanted(q=np.clip(0.0, lower, upper), between=between, joints=knees)
        )
        if nearest is None or found.error < nearest.error:
            nearest = found
        if not found.is_good:
            continue
        reach = ReachSearch(solver, found.q).reach(enough)
        score = _score(reach, asked_rise=asked_rise, asked_sink=asked_sink)
        if best is None or score > best[0] + 1e-3:
            best = (score, found, reach)
        if score == 1.0:
            break
    if best is None:
        assert nearest is not None
        raise RobotFileError(
            "no posture was found with both soles flat, side by side, and the centre "
            f"of mass over them: the best is {1e3 * nearest.error:.0f} mm or mrad off; "
            "are left and right soles those of two legs with at least pitch at hip, "
            "knee and ankle, and are the joint ranges right?"
        )
    _, found, reach = best
    travel = (
        -round(KEPT_SHARE * min(reach.sink_m, asked_sink / KEPT_SHARE), 3),
        round(KEPT_SHARE * min(reach.rise_m, asked_rise / KEPT_SHARE), 3),
    )
    return NominalPosture(
        q=found.q,
        lower=lower,
        upper=upper,
        legs=(left, right),
        knees=(str(model.names[left.knee]), str(model.names[right.knee])),
        com_travel_m=travel,
        asked_m=(asked_sink, asked_rise),
    )


def _score(reach: Reach, *, asked_rise: float, asked_sink: float) -> float:
    """Smallest part, at most 1, of what was asked for."""
    return min(
        1.0,
        reach.rise_m / asked_rise,
        reach.sink_m / asked_sink,
        min(*reach.pitch_rad, reach.roll_rad) / TILT_RAD,
    )


def leg_mask(model: pin.Model, legs: tuple[Leg, Leg]) -> NDArray[np.bool_]:
    """(n_a,) which joints belong to a leg."""
    mask = np.zeros(model.nv - 6, dtype=bool)
    for leg in legs:
        mask[[_index(model, joint) for joint in leg.joints]] = True
    return mask


def _index(model: pin.Model, joint: int) -> int:
    return int(model.idx_vs[joint]) - 6


def _keep_bent(leg: Leg, lower: Array, upper: Array) -> None:
    """Narrow the knee's range, in place, so that the leg is never straight."""
    index = leg.knee_index
    stop = leg.straight + leg.bends * KNEE_ROOM_RAD
    if leg.bends > 0.0:
        lower[index] = min(max(lower[index], stop), upper[index])
    else:
        upper[index] = max(min(upper[index], stop), lower[index])
