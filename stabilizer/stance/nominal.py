"""Nominal posture, and what a robot standing in it can do."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from surefoot.robot_io.errors import RobotFileError
from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.stabilizer.model import GRAVITY, N_BASE_V, RobotModel
from surefoot.stabilizer.stance.legs import ONE_FOOT_SHARE, Leg, find_leg, knee_torques
from surefoot.stabilizer.stance.solver import (
    Found,
    Reach,
    ReachSearch,
    StanceSolver,
    Wanted,
)

DIRECTIONS = 8
"""Directions of pushes, from ahead to the left."""
_ALONG = 1e-9
BENT_TO = (0.80, 0.83, 0.86, 0.89, 0.92, 0.95)
"""Leg lengths to try, as shares of the longest; earlier ones come first."""
KNEE_ROOM_RAD = 0.2
"""Margin of the knee to a straight leg, which cannot follow its ground."""
MARGIN_RAD = 0.02
"""Margin to the ends of all joint ranges."""
RISE_SHARE, SINK_SHARE = 0.14, 0.24
"""Default travel, as a part of the leg's length."""
KEPT_SHARE = 0.9
"""Part of the found reach that the controller is told."""


@dataclass(frozen=True)
class Standing:
    """A robot at rest in its nominal posture, z up and x ahead.

    Attributes:
        mass: [kg].
        com: (3,) CoM from the middle between the soles [m].
        soles: (2, 3) soles from there [m].
        sole_tilt: (2,) tilt of the soles against level [rad].
        sole_yaw: (2,) heading of the soles against ahead [rad].
        sensor_up: (2,) cosine of the angle between each sensor's z axis and up.
        plates: (2,) mass below each force-torque sensor [kg].
        torques: (n_a,) torques that hold the posture, bus order [N m].
        sag: (n_a,) deflection of the servos under these torques, bus order [rad].
        com_sag: (3,) resulting motion of the CoM against the feet [m].
    """

    mass: float
    com: Vec3
    soles: Mat
    sole_tilt: Array
    sole_yaw: Array
    sensor_up: Array
    plates: Array
    torques: Array
    sag: Array
    com_sag: Vec3


def stand(model: RobotModel) -> Standing:
    """Compute the standing robot, with half the weight and balance on each foot."""
    pin_model = model.pin_model
    q = model.nominal_configuration()
    data = pin_model.createData()
    pin.computeAllTerms(pin_model, data, q, np.zeros(model.n_v))
    pin.updateFramePlacements(pin_model, data)
    poses = [data.oMf[i] for i in model.sole_ids]
    J_soles = np.vstack(
        [
            pin.getFrameJacobian(pin_model, data, i, pin.LOCAL_WORLD_ALIGNED)
            for i in model.sole_ids
        ]
    )
    # Of all wrenches that carry the base the smallest is taken: an even load.
    weight = data.nle
    wrenches = np.linalg.pinv(J_soles[:, :N_BASE_V].T) @ weight[:N_BASE_V]
    torques = (weight - J_soles.T @ wrenches)[N_BASE_V:]
    torques_bus = torques[model.to_bus]
    sag_bus = torques_bus / model.robot.kp
    # Joints give way against their torque; the base moves so that the soles stay.
    given = -sag_bus[model.to_model]
    J_base = np.linalg.pinv(J_soles[:, :N_BASE_V])
    v = np.concatenate((-J_base @ (J_soles[:, N_BASE_V:] @ given), given))
    sensors = [
        data.oMf[pin_model.getFrameId(foot.ft_link, pin.FrameType.BODY)].rotation[2, 2]
        for foot in model.robot.file.foot
    ]
    soles = np.array([pose.translation for pose in poses])
    return Standing(
        mass=model.mass,
        com=data.com[0].copy(),
        soles=soles,
        sole_tilt=np.array([math.acos(min(1.0, p.rotation[2, 2])) for p in poses]),
        sole_yaw=np.array(
            [math.atan2(p.rotation[1, 0], p.rotation[0, 0]) for p in poses]
        ),
        sensor_up=np.array(sensors),
        plates=np.array([plate.mass for plate in model.plates]),
        torques=torques_bus,
        sag=sag_bus,
        com_sag=data.Jcom @ v,
    )


def capture_limits(model: RobotModel) -> Array:
    """Return the impulses M sqrt(g / h) d that a standing robot can just catch.

    Each moves the capture point by the distance d to the edge of the soles' hull.

    Returns:
        (8,) impulses from ahead to the left, every 45 degrees [N s].
    """
    from scipy.spatial import ConvexHull

    pin_model = model.pin_model
    data = pin_model.createData()
    q = model.nominal_configuration()
    pin.framesForwardKinematics(pin_model, data, q)
    com = pin.centerOfMass(pin_model, data, q)
    poses = [data.oMf[i] for i in model.sole_ids]
    corners = np.array(
        [
            pose.act(np.array([along * length, across * width, 0.0]))
            for pose, (length, width) in zip(poses, model.half_sizes, strict=True)
            for along in (-1.0, 1.0)
            for across in (-1.0, 1.0)
        ]
    )
    edges = ConvexHull(corners[:, :2]).equations
    room = -(edges[:, :2] @ com[:2] + edges[:, 2])
    height = float(com[2] - corners[:, 2].mean())
    impulses = np.empty(DIRECTIONS)
    for i in range(DIRECTIONS):
        angle = math.tau * i / DIRECTIONS
        towards = edges[:, :2] @ (math.cos(angle), math.sin(angle))
        ahead = towards > _ALONG
        metres = max(0.0, float(np.min(room[ahead] / towards[ahead])))
        impulses[i] = model.mass * math.sqrt(GRAVITY / height) * metres
    return impulses


def reach_search(model: RobotModel) -> ReachSearch:
    """Return a search for ground under a robot, within its usable joint ranges."""
    margin = np.minimum(MARGIN_RAD, 0.25 * (model.upper - model.lower))
    solver = StanceSolver(
        model.pin_model,
        model.sole_ids,
        R_world_base=np.eye(3),
        lower=model.lower + margin,
        upper=model.upper - margin,
        is_leg=model.is_leg,
    )
    return ReachSearch(solver, np.clip(model.nominal, solver.lower, solver.upper))


TILT_RAD = math.radians(10.0)
"""Tilt of the ground that is asked for in each direction."""


@dataclass(frozen=True)
class NominalPosture:
    """A posture to stand in.

    Attributes:
        q: (n_a,) posture in model order [rad].
        lower: (n_a,) lower ends of usable ranges, with knees not straight [rad].
        upper: (n_a,) upper ends [rad].
        legs: left and right leg.
        com_travel_m: range of the CoM: sink (negative) and rise.
        asked_m: requested sink and rise, both positive.
        one_foot_share: part of its torque that a knee needs to carry the robot alone.
    """

    q: Array
    lower: Array
    upper: Array
    legs: tuple[Leg, Leg]
    com_travel_m: tuple[float, float]
    asked_m: tuple[float, float]
    one_foot_share: float

    def knee_angle(self, side: int) -> float:
        """Angle of the left (0) or right (1) knee [rad]."""
        return float(self.q[self.legs[side].knee_index])

    def knee_ahead(self, model: pin.Model, leg: Leg, R_world_base: Mat) -> float:
        """Return how far a knee is ahead of the line from hip to ankle [m]."""
        place = leg.joints.index(leg.knee)
        data = self._kinematics(model)
        above, knee, below = (
            R_world_base @ data.oMi[leg.joints[place + step]].translation
            for step in (-1, 0, 1)
        )
        down = (knee[2] - above[2]) / (below[2] - above[2])
        return float(knee[0] - above[0] - down * (below[0] - above[0]))

    def sole_place(self, model: pin.Model, frame: str) -> Vec3:
        """Return the place of a frame in the base link, (3,) [m]."""
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
    """Find the bend of the knees that gives the travel within ankles and torques.

    Among all bends in which the robot can stand, the best has the largest smallest
    ratio of reach to request; of equal ones the first tried is taken. Unless the rise
    is given, bends in which one knee can carry the robot come first. Those in which
    both together cannot come last.

    Args:
        model: with a floating base.
        sole_ids: frames of left and right sole.
        R_world_base: (3, 3) attitude of the base when upright.
        apart_m: distance between the soles along y.
        rise_m: requested rise of the CoM over the feet.
        sink_m: requested sink, positive.

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
    best: tuple[int, float, Found, Reach] | None = None
    knees = [leg.knee_index + N_BASE_V for leg in (left, right)]
    limits = model.effortLimit[knees]
    base = np.zeros(model.nq - len(lower))
    base[3:] = pin.Quaternion(R_world_base).coeffs()
    nearest: Found | None = None
    for share in BENT_TO:
        bent = {leg.knee_index: leg.bent(share) for leg in (left, right)}
        found = solver.solve(
            Wanted(q=np.clip(0.0, lower, upper), between=between, joints=bent)
        )
        if nearest is None or found.error < nearest.error:
            nearest = found
        if not found.is_good:
            continue
        reach = ReachSearch(solver, found.q).reach(enough)
        score = _score(reach, asked_rise=asked_rise, asked_sink=asked_sink)
        needed = knee_torques(model, np.append(base, found.q), knees, sole_ids) / limits
        feet = _feet_needed(float(needed.max()), asked=rise_m is None)
        if feet == CANNOT:  # of these the one that needs least
            score = -float(needed.max())
        if best is None or (feet, score - 1e-3) > best[:2]:
            best = (feet, score, found, reach)
        if feet == ON_ONE and score == 1.0:
            break
    if best is None:
        assert nearest is not None
        raise RobotFileError(
            "no posture was found with both soles flat, side by side, and the centre "
            f"of mass over them: the best is {1e3 * nearest.error:.0f} mm or mrad off; "
            "are left and right soles those of two legs with at least pitch at hip, "
            "knee and ankle, and are the joint ranges right?"
        )
    _, _, found, reach = best
    needed = knee_torques(model, np.append(base, found.q), knees, sole_ids) / limits
    travel = (
        -round(KEPT_SHARE * min(reach.sink_m, asked_sink / KEPT_SHARE), 3),
        round(KEPT_SHARE * min(reach.rise_m, asked_rise / KEPT_SHARE), 3),
    )
    return NominalPosture(
        q=found.q,
        lower=lower,
        upper=upper,
        legs=(left, right),
        com_travel_m=travel,
        asked_m=(asked_sink, asked_rise),
        one_foot_share=float(needed.max()),
    )


CANNOT, ON_TWO, ON_ONE = 0, 1, 2
"""Whether knees hold the robot: not at all, on both feet, or on one."""


def _feet_needed(share: float, *, asked: bool) -> int:
    """Return how knees hold a robot, given the torque share of one knee alone.

    Args:
        share: of the weaker knee, on one foot [1].
        asked: whether holding it on one foot counts.
    """
    if share > 2.0 * ONE_FOOT_SHARE:
        return CANNOT
    return ON_ONE if share <= ONE_FOOT_SHARE or not asked else ON_TWO


def _score(reach: Reach, *, asked_rise: float, asked_sink: float) -> float:
    """Return the smallest ratio, at most 1, of reach to request."""
    return min(
        1.0,
        reach.rise_m / asked_rise,
        reach.sink_m / asked_sink,
        min(*reach.pitch_rad, reach.roll_rad) / TILT_RAD,
    )


def leg_mask(model: pin.Model, legs: tuple[Leg, Leg]) -> NDArray[np.bool_]:
    """Return which joints belong to a leg, (n_a,)."""
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
