"""The rectangle a foot stands on, from points of its surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from surefoot.robot_io.errors import RobotFileError
from surefoot.schemas.arrays import Array, Mat, Vec3

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

STEEPEST_RAD = np.radians(35.0)
"""A face that leans more than this in the zero posture is no sole."""
SAME_FACE_RAD = np.radians(3.0)
LEVEL_RAD = np.radians(2.0)
"""A face that leans less than this is level: meshes are not exact."""
FLAT_M = 0.002
"""Points this near to the lowest face are part of the sole."""
SMALLEST_M = 0.01
"""A rectangle narrower than this is none."""


@dataclass(frozen=True)
class Sole:
    """A contact rectangle.

    Attributes:
        centre: (3,) its middle, in the frame of the points [m].
        R: (3, 3) that frame from the sole's: x ahead, z out of the ground.
        half_length: along x [m].
        half_width: along y [m].
        share: its area over that of the whole face.
    """

    centre: Vec3
    R: Mat
    half_length: float
    half_width: float
    share: float


def fit_sole(points: Mat, *, up: Vec3, ahead: Vec3) -> Sole:
    """Find the largest rectangle inside the face a foot stands on.

    The face is the one of the convex hull that looks down with the largest area; what
    lies outside the hull's faces cannot touch flat ground.

    Args:
        points: (n, 3) of the foot's surface [m].
        up: (3,) away from the ground, roughly, of length one.
        ahead: (3,) where the foot points, of length one.

    Raises:
        RobotFileError: there is no such face.
    """
    from scipy.spatial import ConvexHull, QhullError

    normal = _face_normal(points, up)
    x = ahead - (ahead @ normal) * normal
    x /= np.linalg.norm(x)
    R = np.column_stack((x, np.cross(normal, x), normal))
    inside = points @ R
    height = float(inside[:, 2].min())
    face = inside[inside[:, 2] < height + FLAT_M, :2]
    try:
        outline = ConvexHull(face)
    except (QhullError, ValueError) as error:
        raise RobotFileError(
            "the foot touches flat ground with an edge or a point, not with a face"
        ) from error
    low, high = _largest_rectangle(outline)
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    if half.min() < SMALLEST_M / 2.0:
        raise RobotFileError(
            f"the face the foot stands on holds a rectangle of {2e3 * half[0]:.0f} x "
            f"{2e3 * half[1]:.0f} mm, too small to stand on"
        )
    return Sole(
        centre=R @ np.array([*middle, height]),
        R=R,
        half_length=float(half[0]),
        half_width=float(half[1]),
        share=float(4.0 * half.prod() / outline.volume),
    )


def _face_normal(points: Mat, up: Vec3) -> Vec3:
    """(3,) out of the ground, of the largest face that looks down."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError) as error:
        raise RobotFileError("the foot's shapes are flat or empty") from error
    normals = -hull.equations[:, :3]
    corners = points[hull.simplices]
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    looks_down = normals @ up > np.cos(STEEPEST_RAD)
    if not looks_down.any():
        raise RobotFileError("no face of the foot looks down in the zero posture")
    normals, areas = normals[looks_down], areas[looks_down]
    is_same = normals @ normals.T > np.cos(SAME_FACE_RAD)
    best = is_same[int(np.argmax(is_same @ areas))]
    mean: Vec3 = areas[best] @ normals[best]
    mean /= np.linalg.norm(mean)
    return up if mean @ up > np.cos(LEVEL_RAD) else mean


def _largest_rectangle(outline: ConvexHull) -> tuple[Array, Array]:
    """Lower and upper corner of the largest upright rectangle in a convex outline.

    Maximises the sum of the logarithms of its sides, which is concave, over the
    outline's edges a x <= b: of each edge only the corner farthest along a counts.
    """
    from scipy.optimize import minimize

    a, b = outline.equations[:, :2], -outline.equations[:, 2]
    towards_high, towards_low = np.maximum(a, 0.0), np.minimum(a, 0.0)
    G = np.hstack((towards_low, towards_high))
    corners = outline.points[outline.vertices]
    scale = np.ptp(corners, axis=0).max()
    middle = corners.mean(axis=0)
    start = np.concatenate((middle - 1e-3 * scale, middle + 1e-3 * scale))
    found = minimize(
        lambda z: -float(np.sum(np.log(np.maximum(z[2:] - z[:2], 1e-9) / scale))),
        start,
        jac=lambda z: np.concatenate((s := 1.0 / np.maximum(z[2:] - z[:2], 1e-9), -s)),
        constraints={"type": "ineq", "fun": lambda z: b - G @ z, "jac": lambda _: -G},
        method="SLSQP",
        options={"maxiter": 200, "ftol": 1e-10},
    )
    return found.x[:2], found.x[2:]
