"""Finds the sole of a foot from the shapes of its links."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import coal
import numpy as np
import pinocchio as pin

from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.urdf_check import drop
from surefoot.schemas.arrays import Array, Mat, Vec3

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

Tag = Literal["collision", "visual"]
_RING = 24
"""Number of corners that stand for a circle."""
FLAT_M = 0.002
"""Distance to the lowest face within which points are part of the sole."""
SMALLEST_M = 0.01
"""Least width of a rectangle."""


def surface_points(
    root: ElementTree.Element, links: Iterable[str], *, tag: Tag, down: Vec3
) -> Mat:
    """Return points whose convex hull is that of the links' shapes.

    Args:
        root: the URDF; meshes by paths that can be opened.
        links: links that do not move against each other.
        tag: kind of their shapes.
        down: (3,) direction of the ground in the root link at zero; round shapes get a
            point there.

    Returns:
        (n, 3) in the root link, all joints at zero [m]; empty without such shapes.

    Raises:
        RobotFileError: a shape cannot be read.
    """
    text = _only_these(root, set(links), tag)
    kinds = {"collision": pin.GeometryType.COLLISION, "visual": pin.GeometryType.VISUAL}
    try:
        model = pin.buildModelFromXML(text)
        found = pin.buildGeomFromUrdfString(model, text, kinds[tag])
    except (ValueError, RuntimeError) as error:
        words = _unreadable(root, links, tag) or " ".join(str(error).split())
        raise RobotFileError(f"their shapes cannot be read: {words}") from error
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    points = [np.empty((0, 3))]
    for shape in found.geometryObjects:
        pose = data.oMi[shape.parentJoint] * shape.placement
        inside = _points(shape.geometry, down=pose.rotation.T @ down)
        points.append(inside @ pose.rotation.T + pose.translation)
    return np.vstack(points)


def _only_these(root: ElementTree.Element, links: set[str], tag: Tag) -> str:
    bare = copy.deepcopy(root)
    drop(bare, ("material",))
    for link in bare.iter("link"):
        for kind in ("collision", "visual"):
            if kind == tag and link.get("name") in links:
                continue
            for shape in link.findall(kind):
                link.remove(shape)
    return ElementTree.tostring(bare, encoding="unicode")


def _unreadable(root: ElementTree.Element, links: Iterable[str], tag: Tag) -> str:
    """Return which mesh of these links cannot be read, in words; empty for none."""
    names = set(links)
    for link in root.iter("link"):
        if link.get("name", "") not in names:
            continue
        for mesh in link.iterfind(f"{tag}/geometry/mesh"):
            name = mesh.get("filename", "")
            try:
                coal.MeshLoader().load(name, np.ones(3))
            except (ValueError, RuntimeError):
                return (
                    f"mesh {name} is no whole .stl, .obj or .dae (of Git LFS, fetch it "
                    "first; others, convert)"
                )
    return ""


def _points(geometry: Any, *, down: Vec3) -> Mat:
    """Return points of a shape in its own frame, (n, 3)."""
    if isinstance(geometry, coal.Box):
        return _corners(np.array(geometry.halfSide).ravel())
    if isinstance(geometry, coal.Sphere):
        return _ball(geometry.radius, down)
    if isinstance(geometry, coal.Cylinder):
        return _rings(geometry.radius, geometry.halfLength)
    if isinstance(geometry, coal.Capsule):
        ball = _ball(geometry.radius, down)
        shift = np.array([0.0, 0.0, geometry.halfLength])
        return np.vstack((ball - shift, ball + shift))
    if isinstance(geometry, coal.BVHModelBase):
        return np.array(geometry.vertices(), dtype=np.float64)
    if isinstance(geometry, coal.ConvexBase):
        return np.array(geometry.points(), dtype=np.float64)
    raise RobotFileError(
        f"a shape of the kind {type(geometry).__name__} is not known; make it a box, "
        "sphere, cylinder or mesh"
    )


def _corners(half: Vec3) -> Mat:
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
    corners: Mat = signs * half
    return corners


def _ball(radius: float, down: Vec3) -> Mat:
    directions: Mat = np.vstack((np.eye(3), -np.eye(3), down))
    return radius * directions


def _rings(radius: float, half_length: float) -> Mat:
    angles = np.linspace(0.0, 2.0 * np.pi, _RING, endpoint=False)
    ring = radius * np.column_stack((np.cos(angles), np.sin(angles)))
    ends = [np.column_stack((ring, np.full(_RING, z))) for z in (-1.0, 1.0)]
    points = np.vstack(ends)
    points[:, 2] *= half_length
    return points


STEEPEST_RAD = np.radians(35.0)
"""Lean in the zero posture above which a face is no sole."""
SAME_FACE_RAD = np.radians(3.0)
LEVEL_RAD = np.radians(2.0)
"""Lean below which a face is level: meshes are not exact."""


@dataclass(frozen=True)
class Sole:
    """A contact rectangle.

    Attributes:
        centre: (3,) middle of the rectangle, in the frame of the points [m].
        R: (3, 3) rotation of the sole in that frame: x ahead, z out of the ground.
        half_length: half of the sole along x [m].
        half_width: half of the sole along y [m].
        share: area of the rectangle over that of the whole face.
    """

    centre: Vec3
    R: Mat
    half_length: float
    half_width: float
    share: float


def fit_sole(points: Mat, *, up: Vec3, ahead: Vec3) -> Sole:
    """Find the largest rectangle inside the face on which a foot stands.

    It is the largest face of the convex hull that looks down. Points that lie outside
    the hull's faces cannot touch flat ground.

    Args:
        points: (n, 3) points of the foot's surface [m].
        up: (3,) unit vector, roughly away from the ground.
        ahead: (3,) unit vector to where the foot points.

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
    """Return the normal (3,) of the largest face that looks down, out of the ground."""
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
    """Return lower and upper corner of the largest upright rectangle in an outline.

    It maximises the sum of the logarithms of its sides, which is concave, within the
    convex outline's edges a x <= b. For each edge only the corner farthest along a
    counts.
    """
    from scipy.optimize import minimize

    corners = outline.points[outline.vertices]
    scale, middle = np.ptp(corners, axis=0), corners.mean(axis=0)
    # Relative to the outline's middle and size, so that all numbers are near 1.
    a = outline.equations[:, :2] * scale
    b = -outline.equations[:, 2] - outline.equations[:, :2] @ middle
    length = np.linalg.norm(a, axis=1)
    a, b = a / length[:, None], b / length
    G = np.hstack((np.minimum(a, 0.0), np.maximum(a, 0.0)))
    # Half of the square around the middle that just fits: a start well inside.
    half = 0.5 * float((b / np.abs(a).sum(axis=1)).min())
    found = minimize(
        lambda z: -float(np.sum(np.log(np.maximum(z[2:] - z[:2], 1e-9)))),
        [-half, -half, half, half],
        jac=lambda z: np.concatenate((s := 1.0 / np.maximum(z[2:] - z[:2], 1e-9), -s)),
        constraints={"type": "ineq", "fun": lambda z: b - G @ z, "jac": lambda _: -G},
        method="SLSQP",
        options={"maxiter": 200, "ftol": 1e-10},
    )
    best = found.x
    if not found.success or (b - G @ best).min() < -1e-6:
        best = np.array([-half, -half, half, half])
    return middle + scale * best[:2], middle + scale * best[2:]
