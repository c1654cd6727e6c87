"""Where the surface of a foot is, from the shapes of its URDF."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from typing import Any, Literal

import coal
import numpy as np
import pinocchio as pin

from surefoot.robot_io.errors import RobotFileError
from surefoot.schemas.arrays import Mat, Vec3

Tag = Literal["collision", "visual"]
_RING = 24
"""Corners that stand for a circle."""


def surface_points(
    root: ElementTree.Element, links: Iterable[str], *, tag: Tag, down: Vec3
) -> Mat:
    """Return points of which the convex hull is that of the links' shapes.

    Args:
        root: the URDF; meshes by paths that can be opened.
        links: that do not move against each other.
        tag: which of their shapes.
        down: (3,) where the ground is, in the root link at zero; round shapes get a
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
        words = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise RobotFileError(
            f"the shapes of {', '.join(links)} cannot be read: {words}"
        ) from error
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
    for link in bare.iter("link"):
        for kind in ("collision", "visual"):
            if kind == tag and link.get("name") in links:
                continue
            for shape in link.findall(kind):
                link.remove(shape)
    return ElementTree.tostring(bare, encoding="unicode")


def _points(geometry: Any, *, down: Vec3) -> Mat:
    """(n, 3) in the shape's own frame."""
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
