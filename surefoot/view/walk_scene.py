"""Footsteps, DCM and wanted ZMP of a robot that walks."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Mat
from surefoot.view.scene_state import (
    SceneState,
    WalkSight,
    odometry_in_world,
    sole_corners,
)

AWAY = (0.0, 0.0, -50.0)
PLANNED, TAKEN, DCM = (240, 150, 20), (20, 105, 220), (0, 150, 160)
MOST_TAKEN, MOST_PLANNED = 12, 6
MOVED_M = 0.01
"""A foot set down farther than this from where it was has taken a step [m]."""
LIFT_M = 0.008
"""Clear of the ground that soles are drawn on."""
FOLLOWED = 0.08
"""Part of the way to the feet that the picture goes along in a frame [1]."""


class WalkScene:
    """Nodes of a walk; nowhere to be seen while the robot stands.

    Attributes:
        middle: (2,) between the feet, smoothed: what the picture follows [m].
    """

    def __init__(self, scene: Any, robot: Robot) -> None:
        """Add all nodes.

        Args:
            scene: ``server.scene`` of viser.
            robot: its soles.
        """
        self._feet = robot.file.foot
        self._taken: deque[Array] = deque(maxlen=MOST_TAKEN)
        self._last: list[Array | None] = [None, None]
        self.middle: Array = np.zeros(2)
        self._frame = scene.add_frame("/world/walk", show_axes=False)
        nothing = np.zeros((4, 2, 3)) + AWAY
        # As many lines as ever: the browser makes a line of another length anew.
        self._taken_lines, self._planned_lines = (
            scene.add_line_segments(
                f"/world/walk/{name}",
                np.tile(nothing, (count, 1, 1)),
                colour,
                thickness=0.007,
            )
            for name, count, colour in (
                ("taken", MOST_TAKEN, TAKEN),
                ("planned", MOST_PLANNED, PLANNED),
            )
        )
        self._dcm, self._dcm_reference, self._zmp = (
            scene.add_cylinder(
                f"/world/walk/{name}", radius, 0.005, colour, position=AWAY
            )
            for name, radius, colour in (
                ("dcm", 0.022, DCM),
                ("dcm_reference", 0.03, PLANNED),
                ("zmp_reference", 0.014, PLANNED),
            )
        )

    def update(self, state: SceneState, soles: tuple[Mat, Mat]) -> None:
        """Move everything to a state.

        Args:
            state: of the scene.
            soles: (4, 4) world from sole, left and right.
        """
        walk = state.walk
        if self._frame.visible is not (walk is not None):
            self._frame.visible = walk is not None
            self._taken.clear()
            self._last = [None, None]
            self.middle[:] = 0.0
        if walk is None or not any(walk.on_ground):
            return
        self._note_steps(walk)
        side = 0 if walk.on_ground[0] else 1
        ground = np.eye(3)
        if state.platforms:
            ground = state.platforms[min(side, len(state.platforms) - 1)][:3, :3]
        T = odometry_in_world(walk, soles, ground)
        x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
        self._frame.wxyz, self._frame.position = (w, x, y, z), tuple(T[:3, 3])
        planned = list(walk.planned[:MOST_PLANNED])
        self._planned_lines.points = self._outlines(planned, MOST_PLANNED)
        level = float(walk.footholds[side][2]) + LIFT_M
        for node, place, up in (
            (self._dcm_reference, walk.dcm_reference, 0.0),
            (self._dcm, walk.dcm, 0.003),
            (self._zmp, walk.zmp_reference, 0.006),
        ):
            node.position = (float(place[0]), float(place[1]), level + up)
        middle = T @ [*walk.footholds[:, :3].mean(axis=0), 1.0]
        self.middle += FOLLOWED * (middle[:2] - self.middle)

    def _note_steps(self, walk: WalkSight) -> None:
        """Keep the footholds that a foot has left."""
        changed = False
        for side, place in enumerate(walk.footholds):
            last = self._last[side]
            if not walk.on_ground[side]:
                continue
            if last is None or np.hypot(*(place - last)[:2]) > MOVED_M:
                self._taken.append(place.copy())
                self._last[side], changed = place.copy(), True
        if changed:
            self._taken_lines.points = self._outlines(list(self._taken), MOST_TAKEN)

    def _outlines(self, places: list[Array], count: int) -> Array:
        """Return (4 count, 2, 3) edges of soles, those that are missing far away."""
        edges = np.zeros((count, 4, 2, 3)) + AWAY
        for index, (x, y, z, yaw) in enumerate(places):
            sole = np.eye(4)
            sole[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
            sole[:3, 3] = x, y, z + LIFT_M
            corners = sole_corners(self._feet[0], sole)
            edges[index] = np.stack((corners, np.roll(corners, -1, axis=0)), axis=1)
        return edges.reshape(-1, 2, 3)
