"""Where the pressure is, and where it can be."""

from __future__ import annotations

import numpy as np

from schemas.arrays import Array, Mat, Vec3, Vec6
from schemas.robot_file import Foot

F_Z, M_X, M_Y = 2, 3, 4
LEAST_FORCE_N = 20.0
"""Below it a foot's centre of pressure is noise."""


def pressure_point(F: Vec6) -> Vec3:
    """Centre of pressure of a foot.

    Args:
        F: (6,) wrench of the ground at the sole, sole frame.

    Returns:
        (3,) in the sole frame [m]; its origin when hardly anything presses.
    """
    if F[F_Z] < LEAST_FORCE_N:
        return np.zeros(3)
    return np.array([-F[M_Y] / F[F_Z], F[M_X] / F[F_Z], 0.0])


def zero_moment_point(wrenches: Array, soles: tuple[Mat, Mat]) -> Vec3 | None:
    """Pressure of both feet in one point.

    Args:
        wrenches: (12,) of the ground at left and right sole, sole frames.
        soles: (4, 4) world from sole, left and right.

    Returns:
        (3,) in the world [m]; None while nothing presses.
    """
    total, weighted = 0.0, np.zeros(3)
    for F, sole in zip((wrenches[:6], wrenches[6:]), soles, strict=True):
        force = max(float(F[F_Z]), 0.0)
        total += force
        weighted += force * (sole[:3, :3] @ pressure_point(F) + sole[:3, 3])
    return None if total < LEAST_FORCE_N else weighted / total


def sole_corners(foot: Foot, sole: Mat) -> Mat:
    """(4, 3) corners of a sole in the world [m].

    Args:
        foot: its rectangle.
        sole: (4, 4) world from sole.
    """
    signs = np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]])
    corners = signs * np.array([foot.half_length_m, foot.half_width_m, 0.0])
    moved: Mat = corners @ sole[:3, :3].T + sole[:3, 3]
    return moved


def support_polygon(corners: Mat) -> Mat:
    """Hull of what stands on the ground, seen from above.

    Args:
        corners: (m, 3) of all soles that stand, m at least 3.

    Returns:
        (k, 3) the corners that bound it, in order.
    """
    from scipy.spatial import ConvexHull

    hull: Mat = corners[ConvexHull(corners[:, :2]).vertices]
    return hull
