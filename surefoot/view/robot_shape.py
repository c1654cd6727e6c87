"""A robot's shape and forward kinematics from its URDF, for pictures only."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.urdf_check import rotation
from surefoot.schemas.arrays import Array, Mat, Vec3


class _Joint(NamedTuple):
    """One joint of the URDF.

    Attributes:
        parent: name of the parent link.
        child: name of the child link.
        origin: (4, 4) parent link from joint at zero.
        axis: (3,) unit direction.
        bus_index: index in bus order; None for a fixed joint.
        slides: whether it is prismatic.
    """

    parent: str
    child: str
    origin: Mat
    axis: Vec3
    bus_index: int | None
    slides: bool


class RobotShape:
    """The mesh of each link, and the poses of the links.

    Attributes:
        meshes: mesh (trimesh) by link, in link axes; links without a shape are missing.
    """

    def __init__(self, robot: Robot) -> None:
        """Read the URDF.

        Raises:
            RobotFileError: a mesh is missing or cannot be read.
        """
        import yourdfpy

        _check_meshes(robot.urdf_path)
        try:
            urdf = yourdfpy.URDF.load(
                str(robot.urdf_path), build_scene_graph=True, load_meshes=True
            )
            self._base = robot.file.base_link
            self._joints = _sorted_joints(urdf, robot)
            self.meshes = _link_meshes(urdf)
        except (ValueError, TypeError, KeyError, IndexError, AttributeError) as error:
            words = (str(error).strip() or type(error).__name__).splitlines()[0]
            raise RobotFileError(
                f"{robot.urdf_path}: its shapes cannot be drawn: {words}"
            ) from error

    def poses(self, q: Array) -> dict[str, Mat]:
        """Return the poses of the links.

        Args:
            q: (n_a,) joint positions in bus order [rad].

        Returns:
            (4, 4) base from link, by link.
        """
        found: dict[str, Mat] = {self._base: np.eye(4)}
        for joint in self._joints:
            pose = found[joint.parent] @ joint.origin
            if joint.bus_index is not None:
                moved, R = q[joint.bus_index], pose[:3, :3]
                if joint.slides:
                    pose[:3, 3] += R @ joint.axis * moved
                else:
                    R[:] = R @ rotation(joint.axis, moved)
            found[joint.child] = pose
        return found


def _check_meshes(urdf_path: Path) -> None:
    """Refuse missing meshes; only pictures need them, so runs do not check this.

    Raises:
        RobotFileError: names the link and the path that was tried.
    """
    for link in ElementTree.parse(urdf_path).getroot().iter("link"):
        for mesh in link.iterfind("visual/geometry/mesh"):
            name = mesh.get("filename", "")
            place = f"{urdf_path}: link {link.get('name')!r}: mesh {name!r}"
            if "://" in name and not name.startswith("file://"):
                raise RobotFileError(
                    f"{place}: expected a path relative to the URDF; copy the mesh "
                    "beside it, or leave out the <visual>"
                )
            path = urdf_path.parent / name.removeprefix("file://")
            if not path.is_file():
                raise RobotFileError(
                    f"{place}: no such file: {path}; put it there, or leave out the "
                    "<visual>"
                )


def _sorted_joints(urdf: Any, robot: Robot) -> list[_Joint]:
    """Sort joints so that parents come before children."""
    index = {name: i for i, name in enumerate(robot.joint_names)}
    children: dict[str, list[Any]] = {}
    for joint in urdf.robot.joints:
        children.setdefault(joint.parent, []).append(joint)
    joints, links = [], [robot.file.base_link]
    while links:
        for joint in children.get(links.pop(), []):
            links.append(joint.child)
            joints.append(
                _Joint(
                    parent=joint.parent,
                    child=joint.child,
                    origin=np.eye(4) if joint.origin is None else joint.origin,
                    axis=np.eye(3)[0] if joint.axis is None else joint.axis,
                    bus_index=index.get(joint.name),
                    slides=joint.type == "prismatic",
                )
            )
    return joints


def _link_meshes(urdf: Any) -> dict[str, Any]:
    """Return all visuals of a link as one mesh."""
    import trimesh

    parts: dict[str, list[Any]] = {}
    graph = urdf.scene.graph
    for node in graph.nodes_geometry:
        link = graph.transforms.parents[node]
        pose, name = graph.get(node, link)
        mesh = urdf.scene.geometry[name].copy()
        # Primitives recompute their vertices; a plain mesh keeps the transform.
        plain = trimesh.Trimesh(
            mesh.vertices, mesh.faces, face_colors=_colour(mesh), process=False
        )
        plain.apply_transform(pose)
        parts.setdefault(link, []).append(plain)
    return {link: trimesh.util.concatenate(found) for link, found in parts.items()}


def _colour(mesh: Any) -> Any:
    visual: Any = mesh.visual
    material = getattr(visual, "material", None)
    if material is not None:
        return material.main_color
    return visual.main_color if visual.kind is None else visual.face_colors
