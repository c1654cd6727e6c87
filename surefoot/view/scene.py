"""Robot, ground, ghost and forces in a viser scene."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.schemas.messages import GroundBlock
from surefoot.view.robot_shape import RobotShape
from surefoot.view.scene_state import (
    F_Z,
    LEAST_FORCE_N,
    SceneState,
    nominal_state,
    pose,
    pressure_point,
    sole_corners,
    support_polygon,
    zero_moment_point,
)
from surefoot.view.walk import AWAY, DCM, WalkScene

METRES_PER_NEWTON = 1e-3
MEASURED_BESIDE_M = 0.09
WANTED_BESIDE_M = 0.13
"""Sideways offsets of the arrows, which the legs would hide [m]."""
GHOST_SKIN_M = 0.006
"""Distance of the ghost's surface outside the robot's, so that it is visible [m]."""
CORNERS = 8
"""Largest number of corners of the support polygon of two soles."""
FLOOR_M = -0.35
"""Height of the floor's grid, below all motions of the ground [m]."""
MEASURED = (20, 105, 220)
WANTED = (240, 150, 20)
GHOST = (70, 160, 255)
COM = (225, 60, 70)
ZMP = (130, 60, 200)
POLYGON = (25, 160, 95)
GROUND = (196, 201, 208)
LEGEND = (
    (MEASURED, "measured force of the ground, 1 m per kN"),
    (WANTED, "desired force, beside it"),
    (WANTED, "desired centre of mass"),
    (COM, "centre of mass"),
    (ZMP, "zero moment point, measured"),
    (POLYGON, "support polygon"),
)
"""Colours and their meaning."""
WALK_LEGEND = (
    (DCM, "walking: divergent component of motion"),
    (WANTED, "planned steps, desired DCM and ZMP"),
    (MEASURED, "steps taken"),
)
GHOST_OPACITY = 0.16
POLYGON_LIFT_M = 0.012
"""Height of the polygon's lines above the ground, so that they are visible [m]."""


class Scene:
    """A scene whose nodes are made once and moved for each state.

    It works on a live server, and on one that only records for a replay.
    """

    def __init__(self, scene: Any, robot: Robot, shape: RobotShape) -> None:
        """Add all nodes, in the robot's nominal posture."""
        self._scene, self._robot, self._shape = scene, robot, shape
        self._platforms: list[Any] = []
        self._blocks: list[GroundBlock] = []
        self._drawn: list[Any] = []
        self._world = scene.add_frame("/world", show_axes=False)
        self._set_stage()
        self._base = scene.add_frame("/world/robot", show_axes=False)
        self._ghost = scene.add_frame("/world/ghost", show_axes=False)
        self._links = {
            link: scene.add_mesh_trimesh(f"/world/robot/{link}", mesh)
            for link, mesh in shape.meshes.items()
        }
        self._ghost_links = {
            link: scene.add_mesh_simple(
                f"/world/ghost/{link}",
                np.asarray(mesh.vertices + GHOST_SKIN_M * mesh.vertex_normals),
                np.asarray(mesh.faces),
                color=GHOST,
                opacity=GHOST_OPACITY,
                cast_shadow=False,
                receive_shadow=False,
            )
            for link, mesh in shape.meshes.items()
        }
        nothing = np.zeros((2, 2, 3)) + AWAY
        self._measured = scene.add_arrows(
            "/world/forces/measured",
            nothing,
            MEASURED,
            shaft_radius=0.009,
            head_radius=0.021,
            head_length=0.045,
        )
        self._wanted = scene.add_arrows(
            "/world/forces/wanted",
            nothing,
            WANTED,
            shaft_radius=0.006,
            head_radius=0.016,
            head_length=0.04,
        )
        self._stance = scene.add_frame("/world/stance", show_axes=False)
        self._polygon = scene.add_line_segments(
            "/world/stance/polygon", np.zeros((CORNERS, 2, 3)), POLYGON, thickness=0.012
        )
        self._plumb = scene.add_line_segments(
            "/world/balance/plumb", nothing, COM, thickness=0.004
        )
        self._com = scene.add_icosphere("/world/balance/com", 0.028, COM, position=AWAY)
        self._reference = scene.add_icosphere(
            "/world/balance/com_reference", 0.036, WANTED, opacity=0.4, position=AWAY
        )
        self._zmp = scene.add_cylinder(
            "/world/balance/zmp", 0.03, 0.006, ZMP, position=AWAY
        )
        self._below = scene.add_icosphere(
            "/world/balance/below", 0.014, COM, position=AWAY
        )
        self._walk = WalkScene(scene, robot)
        self.update(nominal_state(robot, shape))

    def show_ghost(self, wanted: bool) -> None:
        """Show or hide the commanded posture."""
        self._ghost.visible = wanted
        _place(self._ghost_at(self._state))

    def show_forces(self, wanted: bool) -> None:
        """Show or hide the wrench arrows."""
        self._measured.visible = self._wanted.visible = wanted

    def update(self, state: SceneState) -> None:
        """Move all nodes to a state."""
        self._state = state
        links = self._shape.poses(state.q)
        placed = [(self._base, state.base)]
        placed += [(node, links[link]) for link, node in self._links.items()]
        if self._ghost.visible:
            placed += self._ghost_at(state)
        placed += self._platforms_at(state.platforms)
        _place(placed)
        self._lay_ground(state.ground)
        left, right = (
            state.base @ links[foot.sole_frame] for foot in self._robot.file.foot
        )
        self._draw_forces(state, (left, right))
        self._draw_balance(state, (left, right))
        self._walk.update(state, (left, right))
        x, y = self._walk.middle
        self._world.position = (-x, -y, 0.0)

    def _ghost_at(self, state: SceneState) -> list[tuple[Any, Mat]]:
        links = self._shape.poses(state.q_command)
        nodes = [(node, links[link]) for link, node in self._ghost_links.items()]
        return [(self._ghost, state.base), *nodes]

    def _draw_forces(self, state: SceneState, soles: tuple[Mat, Mat]) -> None:
        if state.F_meas is not None:
            self._measured.points = _arrows(
                state.F_meas, soles, beside=MEASURED_BESIDE_M
            )
        if state.F_id is not None:
            self._wanted.points = _arrows(state.F_id, soles, beside=WANTED_BESIDE_M)

    def _draw_balance(self, state: SceneState, soles: tuple[Mat, Mat]) -> None:
        standing = [
            sole_corners(foot, sole)
            for foot, sole, stands in zip(
                self._robot.file.foot, soles, state.in_contact, strict=True
            )
            if stands
        ]
        if self._polygon.visible is not bool(standing):
            self._polygon.visible = bool(standing)
        if standing:
            # Always the same number of edges: for another number the browser makes a
            # new line and shows nothing meanwhile. Surplus corners repeat the last one.
            hull = support_polygon(np.vstack(standing))
            missing = CORNERS - len(hull)
            hull = np.vstack((hull, np.repeat(hull[-1:], missing, axis=0)))
            edges = np.stack((hull, np.roll(hull, -1, axis=0)), axis=1)
            # Relative to the ground: browsers move nodes at once, but show new points
            # some frames later, when the ground has moved on.
            ground = soles[0].copy()
            ground[:3, 3] = 0.5 * (soles[0][:3, 3] + soles[1][:3, 3])
            _place([(self._stance, ground)])
            lifted = edges + np.array([0.0, 0.0, POLYGON_LIFT_M])
            self._polygon.points = (lifted - ground[:3, 3]) @ ground[:3, :3]
        zmp = None
        if state.F_meas is not None:
            zmp = zero_moment_point(state.F_meas, soles)
        self._zmp.position = AWAY if zmp is None else tuple(zmp)
        if state.com is not None:
            self._com.position = tuple(state.com)
            foot = state.com.copy()
            foot[2] = 0.5 * (soles[0][2, 3] + soles[1][2, 3])
            self._plumb.points = np.array([[state.com, foot]])
            self._below.position = tuple(foot)
        if state.com_reference is not None:
            self._reference.position = tuple(state.com_reference)

    def _platforms_at(self, poses: list[Mat]) -> list[tuple[Any, Mat]]:
        while len(self._platforms) < len(poses):
            name = f"/world/ground/platform_{len(self._platforms)}"
            self._platforms.append(self._scene.add_frame(name, show_axes=False))
        return list(zip(self._platforms, poses, strict=False))

    def _lay_ground(self, blocks: list[GroundBlock]) -> None:
        """Draw the blocks of the ground when they are first known or have changed."""
        if not blocks or blocks == self._blocks:
            return
        self._blocks = blocks
        for node in self._drawn:
            node.remove()
        self._drawn = []
        for index, block in enumerate(blocks):
            T_block = pose(block.position, block.quat_xyzw)
            middle = T_block @ [0.0, 0.0, -0.5 * block.size[2], 1.0]
            on = "" if block.platform < 0 else f"platform_{block.platform}/"
            x, y, z, w = block.quat_xyzw
            node = self._scene.add_box(
                f"/world/ground/{on}block_{index}",
                GROUND,
                tuple(block.size),
                position=tuple(middle[:3]),
                wxyz=(w, x, y, z),
            )
            self._drawn.append(node)

    def _set_stage(self) -> None:
        scene = self._scene
        scene.set_up_direction("+z")
        # viser loads its environment maps from the internet; plain lights need none.
        scene.configure_environment_map(hdri=None)
        scene.configure_default_lights(enabled=False)
        scene.add_light_ambient("/lights/all", intensity=1.1)
        for name, position, intensity, shadow in (
            ("key", (2.5, 1.5, 4.0), 2.2, True),
            ("fill", (-2.0, -3.0, 2.5), 1.0, False),
        ):
            scene.add_light_directional(
                f"/lights/{name}",
                intensity=intensity,
                position=position,
                cast_shadow=shadow,
            )
        scene.add_grid(
            "/world/floor",
            width=6.0,
            height=6.0,
            cell_size=0.25,
            section_size=1.0,
            cell_color=(225, 228, 232),
            section_color=(200, 205, 212),
            position=(0.0, 0.0, FLOOR_M),
        )


def _place(placed: list[tuple[Any, Mat]]) -> None:
    """Set the poses of nodes; one conversion for all is faster than one for each."""
    poses = np.array([T for _, T in placed])
    turns = Rotation.from_matrix(poses[:, :3, :3]).as_quat(scalar_first=True)
    for (node, T), turn in zip(placed, turns, strict=True):
        node.wxyz = turn
        node.position = T[:3, 3]


def _arrows(wrenches: Array, soles: tuple[Mat, Mat], *, beside: float) -> Array:
    """Return (2, 2, 3) start and end of the force at each sole's pressure point [m].

    Args:
        wrenches: (12,) at left and right sole, in sole frames [N, N m].
        soles: (4, 4) world from sole, left and right.
        beside: sideways offset away from the robot's midline [m].
    """
    arrows = np.empty((2, 2, 3))
    for i, (F, sole) in enumerate(
        zip((wrenches[:6], wrenches[6:]), soles, strict=True)
    ):
        outward: Vec3 = pressure_point(F)
        outward[1] += beside if i == 0 else -beside
        if F[F_Z] < LEAST_FORCE_N:  # a foot in the air gets no arrow
            arrows[i] = AWAY
            continue
        start = sole[:3, :3] @ outward + sole[:3, 3]
        arrows[i] = start, start + METRES_PER_NEWTON * (sole[:3, :3] @ F[:3])
    return arrows
