"""Both feet's wrenches as one, and the zero-moment point that goes with it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from schemas.arrays import Array, Mat, Vec3
from stabilizer.model import skew

LEAST_FOOT_FORCE_N = 1.0
"""A foot that feels less does not count [N]."""
LEAST_NET_FORCE_N = 1.0
"""With less there is no zero-moment point [N]."""


class Plane(NamedTuple):
    """Plane of the zero-moment point: origin (3,) [m] and unit normal (3,)."""

    origin: Vec3
    normal: Vec3


def contact_plane(
    R_world_sole: list[Mat], p_sole: list[Vec3], in_contact: list[bool]
) -> Plane:
    """Between two standing feet, or of the one that stands.

    Args:
        R_world_sole: rotations of left and right sole.
        p_sole: (3,) positions in the world [m].
        in_contact: which feet stand.
    """
    if in_contact[0] != in_contact[1]:
        foot = 0 if in_contact[0] else 1
        return Plane(p_sole[foot], R_world_sole[foot][:, 2])
    normal = R_world_sole[0][:, 2] + R_world_sole[1][:, 2]
    normal /= np.linalg.norm(normal)
    return Plane(0.5 * (p_sole[0] + p_sole[1]), normal)


def sole_to_world(R_world_sole: Mat, p_sole: Vec3, point: Vec3) -> Mat:
    """(6, 6) map of a sole-frame wrench to world axes, about a point.

    The moment is taken about ``point``, never about the world's origin: far from
    there, rounding and the lever of small force errors would swamp it.

    Args:
        R_world_sole: rotation of the sole.
        p_sole: (3,) its position [m].
        point: (3,) what moments are about [m].
    """
    X = np.zeros((6, 6))
    X[:3, :3] = R_world_sole
    X[3:, 3:] = R_world_sole
    X[3:, :3] = skew(p_sole - point) @ R_world_sole
    return X


def net_wrench(
    F: Array, R_world_sole: list[Mat], p_sole: list[Vec3], point: Vec3
) -> Array:
    """(6,) sum of both feet's wrenches, world axes, about a point.

    Args:
        F: (12,) wrenches of the ground on the soles, sole frames.
        R_world_sole: rotations of the soles.
        p_sole: (3,) their positions [m].
        point: (3,) what moments are about [m].
    """
    total = np.zeros(6)
    for side in (0, 1):
        foot = F[6 * side : 6 * side + 6]
        if foot[2] <= LEAST_FOOT_FORCE_N:
            continue
        total += sole_to_world(R_world_sole[side], p_sole[side], point) @ foot
    return total


def zero_moment_point(wrench: Array, plane: Plane, *, otherwise: Vec3) -> Vec3:
    """(3,) the point of the plane about which the wrench has no tangential moment.

    Args:
        wrench: (6,) world axes, about the plane's origin.
        plane: where the point lies.
        otherwise: (3,) the answer without any force.
    """
    force, moment = wrench[:3], wrench[3:]
    normal_force = float(plane.normal @ force)
    if normal_force < LEAST_NET_FORCE_N:
        return otherwise
    point: Vec3 = plane.origin + np.cross(plane.normal, moment) / normal_force
    return point
