"""Body and legs of a robot, found from its kinematics, and what its knees carry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pinocchio as pin

from surefoot.robot_io.errors import RobotFileError
from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.stabilizer.model import N_BASE_V, RobotModel

SNAP_RAD = np.radians(15.0)
"""Angle to an axis of a link within which a direction snaps to it [rad]."""
SNAP_AHEAD_RAD = np.radians(3.0)
LEAST_APART_M = 0.02
_SAMPLES = 181
LEAST_BEND = 0.02
"""Part of its length by which some joint must shorten a leg with a knee."""
ONE_FOOT_SHARE = 0.85
"""Part of a knee's torque for carrying the robot alone; the rest moves it."""


@dataclass(frozen=True)
class Body:
    """Pinocchio's model of a URDF with a floating base.

    Attributes:
        model: as Pinocchio reads it.
        data: with all joints at zero: frames, CoM and subtree masses.
    """

    model: pin.Model
    data: pin.Data

    @property
    def mass(self) -> float:
        """Mass of the whole robot [kg]."""
        return float(self.data.mass[0])

    def placement(self, link: str) -> pin.SE3:
        """Pose of a link in the base link, all joints at zero."""
        return self.data.oMf[self.frame(link)]

    def frame(self, link: str) -> int:
        """Pinocchio's frame id of a link; a joint may have the same name."""
        frame_id: int = self.model.getFrameId(link, pin.FrameType.BODY)
        return frame_id

    def carried_share(self, joint: str) -> float:
        """Part of the robot's mass that a joint carries."""
        return float(self.data.mass[self.model.getJointId(joint)]) / self.mass


@dataclass(frozen=True)
class Directions:
    """Up and ahead of a robot in its base link, all joints at zero.

    Attributes:
        up: (3,) unit vector.
        ahead: (3,) unit vector, perpendicular to ``up``.
        is_exact: whether up is an axis of a frame, or was given.
    """

    up: Vec3
    ahead: Vec3
    is_exact: bool = True

    @property
    def R_upright_base(self) -> Mat:  # noqa: N802
        """(3, 3) rotation of the base link in a frame with x ahead and z up."""
        R: Mat = np.vstack((self.ahead, np.cross(self.up, self.ahead), self.up))
        return R


def read_body(text: str, *, source: str) -> Body:
    """Build the model.

    Raises:
        RobotFileError: Pinocchio refuses it.
    """
    try:
        model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    except (ValueError, RuntimeError) as error:
        words = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise RobotFileError(f"{source}: Pinocchio refuses it: {words}") from error
    data = model.createData()
    q = pin.neutral(model)
    pin.framesForwardKinematics(model, data, q)
    pin.centerOfMass(model, data, q)
    pin.computeSubtreeMasses(model, data)
    return Body(model, data)


def find_directions(
    body: Body, left: str, places: tuple[Vec3, Vec3], *, up: Vec3 | None = None
) -> Directions:
    """Find up, from the feet to the CoM, and ahead, from right and left foot.

    A direction snaps to a near axis of the base link or of the left foot.

    Args:
        body: body with all joints at zero.
        left: link of the left foot.
        places: (3,) each, places of left and right foot in the base link [m].
        up: (3,) unit vector, if known.

    Raises:
        RobotFileError: both feet are at one place.
    """
    p_left, p_right = places
    frames = (np.eye(3), body.placement(left).rotation)
    is_exact = True
    if up is None:
        rough = body.data.com[0] - 0.5 * (p_left + p_right)
        rough = rough / np.linalg.norm(rough)
        up = _snapped(rough, frames, within=SNAP_RAD)
        is_exact = up is not rough
    across = p_left - p_right
    across = across - (across @ up) * up
    apart = float(np.linalg.norm(across))
    if apart < LEAST_APART_M:
        raise RobotFileError(
            f"the soles are {1e3 * apart:.0f} mm apart with all joints at zero; name "
            "one link of each foot"
        )
    ahead = np.cross(across / apart, up)
    snapped = _snapped(ahead, frames, within=SNAP_AHEAD_RAD)
    if abs(snapped @ up) < 1e-6:
        ahead = snapped
    return Directions(up=up, ahead=ahead / np.linalg.norm(ahead), is_exact=is_exact)


def _snapped(direction: Vec3, frames: tuple[Mat, ...], *, within: float) -> Vec3:
    """Return the nearest axis of the first frame with one near, else the direction."""
    for frame in frames:
        axes = np.vstack((frame.T, -frame.T))
        near = axes[int(np.argmax(axes @ direction))]
        if near @ direction > np.cos(within):
            snapped: Vec3 = near
            return snapped
    return direction


@dataclass(frozen=True)
class Leg:
    """One leg.

    Attributes:
        joints: Pinocchio's joint ids, from the base to the sole.
        knee: id of the joint that shortens the leg most.
        knee_index: index of the knee in model order.
        angles: (n,) angles of the knee over its range [rad].
        lengths: (n,) distances from the joint before the knee to the one after it [m].
    """

    joints: tuple[int, ...]
    knee: int
    knee_index: int
    angles: Array
    lengths: Array

    @property
    def longest(self) -> float:
        """Length with the knee as straight as possible [m]."""
        return float(self.lengths.max())

    @property
    def straight(self) -> float:
        """Angle of the straightest knee [rad]."""
        return float(self.angles[int(np.argmax(self.lengths))])

    @property
    def bends(self) -> float:
        """Sign of the angle that bends the knee: the side with more room."""
        room_above = float(self.angles[-1]) - self.straight
        return 1.0 if room_above >= self.straight - float(self.angles[0]) else -1.0

    def bent(self, share: float) -> float:
        """Return the knee angle at this share of the leg's longest length [rad].

        It is as near to the share as the range allows.
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
        lower: (n_a,) lower ends of the joint ranges, model order [rad].
        upper: (n_a,) upper ends [rad].
        side: side of the leg, for messages.

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


def knee_torques(
    model: pin.Model, q: Array, knees: Sequence[int], sole_ids: Sequence[int]
) -> Array:
    """Return the torque of each knee while its foot alone carries the robot.

    The soles stay in place; only rotations of the leg in its own plane count.

    Args:
        model: with a floating base.
        q: (n_q,) posture, the base upright.
        knees: velocity indices of left and right knee.
        sole_ids: frames of the soles.

    Returns:
        (2,) magnitudes [N m].
    """
    data = model.createData()
    pin.computeAllTerms(model, data, q, np.zeros(model.nv))
    torques = np.empty(len(knees))
    for side, (knee, sole_id) in enumerate(zip(knees, sole_ids, strict=True)):
        J = pin.getFrameJacobian(model, data, sole_id, pin.LOCAL_WORLD_ALIGNED)
        wrench = np.linalg.solve(J[:, :6].T, data.nle[:6])
        wrench[[3, 5]] = 0.0
        torques[side] = abs(data.nle[knee] - J[:, knee] @ wrench)
    return torques


def _lengths(model: pin.Model, middle: int, after: int, angles: Array) -> Array:
    """Return the distances between the neighbours of a joint at its angles, (n,)."""
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


def one_foot_share(model: RobotModel) -> float:
    """Return the part of its torque that a knee needs to carry the robot alone.

    Returns:
        The larger share of both knees; 0 for legs without one.
    """
    return max((share for _, share in _loaded_legs(model)), default=0.0)


def one_foot_sink(model: RobotModel) -> float:
    """Return how far the CoM may sink from nominal while one foot carries the robot.

    A knee then needs :data:`ONE_FOOT_SHARE` of its torque. By virtual work it needs the
    weight times the change of the leg's length with its angle.

    Returns:
        The depth of the weaker leg [m], 0 if its nominal posture needs as much;
        infinite for legs without a knee.
    """
    depths = [math.inf]
    for leg, share in _loaded_legs(model):
        nominal = model.nominal[leg.knee_index]
        slopes = np.abs(np.gradient(leg.lengths, leg.angles))
        shares = share * slopes / np.interp(nominal, leg.angles, slopes)
        deeper = (leg.angles - nominal) * leg.bends > 0.0
        length = np.interp(nominal, leg.angles, leg.lengths)
        borne = length - leg.lengths[deeper & (shares <= ONE_FOOT_SHARE)]
        weak = length - leg.lengths[deeper & (shares > ONE_FOOT_SHARE)]
        first_weak = np.min(weak, initial=math.inf)
        depths.append(np.max(borne[borne < first_weak], initial=0.0))
    return float(min(depths))


def _loaded_legs(model: RobotModel) -> list[tuple[Leg, float]]:
    """Return legs, each with its knee's share of torque if it carries all; or none."""
    pin_model = model.pin_model
    try:
        legs = [
            find_leg(pin_model, id_, lower=model.lower, upper=model.upper, side=side)
            for id_, side in zip(model.sole_ids, ("left", "right"), strict=True)
        ]
    except RobotFileError:
        return []
    knees = [leg.knee_index for leg in legs]
    q = model.nominal_configuration()
    rows = [N_BASE_V + knee for knee in knees]
    torques = knee_torques(pin_model, q, rows, model.sole_ids)
    shares: list[float] = (torques / model.torque_limit[knees]).tolist()
    return list(zip(legs, shares, strict=True))
