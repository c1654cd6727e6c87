"""Draws pictures of a run afterwards, without a window."""

from __future__ import annotations

import math
import os
import sys
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.scenario import Scenario
from surefoot.sim_robot.catalogue import SimulationError
from surefoot.sim_robot.conventions import wxyz
from surefoot.sim_robot.ground import Ground, PlatformPlan
from surefoot.sim_robot.still_ground import FLOOR_Z_M
from surefoot.sim_robot.world import build_world

LEGS = 6
LEG_LEAN_RAD = 0.42
LEG_INSET, LEG_SPREAD = 0.75, 0.95
"""Where the legs hold the platform and where they stand, in parts of its half size."""
CYLINDER_SHARE = 0.55
CYLINDER_RADIUS_M, CYLINDER_RGBA = 0.028, (0.25, 0.28, 0.33, 1.0)
ROD_RADIUS_M, ROD_RGBA = 0.016, (0.74, 0.77, 0.80, 1.0)
_QUICK_SHADOW_PIXELS, _QUICK_SAMPLES = 4096, 4
_NO_GL = (
    "no picture can be drawn: {reason}. Set MUJOCO_GL=egl (or osmesa) before Python "
    "starts; on Debian: apt-get install libegl1 libgl1-mesa-dri (or libosmesa6)"
)
SIZE = 16


class RenderError(SimulationError):
    """No picture can be drawn here; the message says what to install or set."""


@dataclass(frozen=True)
class Camera:
    """Point of view of a picture.

    Attributes:
        target: (3,) point in the middle of the picture, world [m].
        distance: distance from there [m].
        azimuth_deg: 180 looks at the robot's face, 90 from its right side.
        elevation_deg: negative looks down.
    """

    target: tuple[float, float, float] = (0.0, 0.0, 0.45)
    distance: float = 2.75
    azimuth_deg: float = 150.0
    elevation_deg: float = -11.0


class Renderer:
    """Draws moments of a run of one robot and scenario.

    Needs OpenGL without a window: EGL or OSMesa. Use it in a ``with`` block.
    """

    def __init__(
        self,
        robot: Robot,
        scenario: Scenario,
        *,
        width: int,
        height: int,
        quick: bool = False,
    ) -> None:
        """Set up the drawing.

        Args:
            robot: the robot of the run.
            scenario: the scenario of the run.
            width: width of the pictures [pixels].
            height: height of the pictures [pixels].
            quick: coarser shadows and edges, several times as fast on a processor;
                for the many pictures of a film.

        Raises:
            RenderError: this machine cannot draw; the message says what to install.
        """
        self._world = build_world(robot, scenario, scenery=True)
        model = self._world.model
        self._data = mujoco.MjData(model)
        self._ground = Ground(
            self._world.platforms, self._data, after=len(self._world.seesaws)
        )
        if quick:
            model.vis.quality.shadowsize = _QUICK_SHADOW_PIXELS
            model.vis.quality.offsamples = _QUICK_SAMPLES
        model.vis.global_.offwidth = max(width, model.vis.global_.offwidth)
        model.vis.global_.offheight = max(height, model.vis.global_.offheight)
        self._drawing = _open_drawing(model, width=width, height=height)

    def __enter__(self) -> Renderer:
        """Return itself."""
        return self

    def __exit__(self, *why: object) -> None:
        """Free OpenGL's resources."""
        self._drawing.close()

    def draw(
        self,
        *,
        time_s: float,
        base_position: Vec3,
        base_quat_xyzw: Array,
        q: Array,
        seesaws: Sequence[float] = (),
        camera: Camera | None = None,
    ) -> NDArray[np.uint8]:
        """Draw one moment.

        Args:
            time_s: time of the run, which places the platforms [s].
            base_position: (3,) world [m].
            base_quat_xyzw: (4,) world from base.
            q: (n_a,) joint positions, bus order [rad].
            seesaws: angle of each seesaw, in order [rad]; at rest when left out.
            camera: point of view; shows the whole robot when not given.

        Returns:
            (height, width, 3) red, green, blue from the top left.
        """
        data = self._data
        data.qpos[:3] = base_position
        data.qpos[3:7] = wxyz(base_quat_xyzw)
        data.qpos[self._world.joint_qpos] = q
        if seesaws:
            data.qpos[-len(seesaws) :] = seesaws
        self._ground.aim(time_s)
        self._ground.arrive()
        mujoco.mj_forward(self._world.model, data)
        self._drawing.update_scene(data, camera=_mj_camera(camera or Camera()))
        self._add_legs()
        image: NDArray[np.uint8] = self._drawing.render()
        return image

    def draw_recorded(
        self, arrays: Mapping[str, Array], *, row: int, camera: Camera | None = None
    ) -> NDArray[np.uint8]:
        """Draw one tick of a recorded run.

        Args:
            arrays: signals of the run by name.
            row: row of the tick; negative counts from the end.
            camera: point of view; shows the whole robot when not given.
        """
        return self.draw(
            time_s=float(arrays["time_s"][row]),
            base_position=arrays["true_base_pose"][row, :3],
            base_quat_xyzw=arrays["true_base_pose"][row, 3:],
            q=arrays["q"][row],
            seesaws=self._seesaw_angles(arrays, row),
            camera=camera,
        )

    def _seesaw_angles(self, arrays: Mapping[str, Array], row: int) -> list[float]:
        from scipy.spatial.transform import Rotation

        tiles = [ground for ground in self._world.still if ground.tip_rad]
        if not tiles:
            return []
        quats = arrays["true_platform_pose"][row, -len(tiles) :, 3:]
        angles = []
        attitudes = Rotation.from_quat(quats).as_matrix()
        for tile, attitude in zip(tiles, attitudes, strict=True):
            turned = tile.R_world_top.T @ attitude
            is_roll = tile.tip_axis == "roll"
            sin, cos = turned[2, 1] if is_roll else turned[0, 2], turned[2, 2]
            angles.append(float(np.arctan2(sin, cos)))
        return angles

    def _add_legs(self) -> None:
        """Draw each platform on six cylinders, like a motion base."""
        for body, plan in zip(
            self._world.ground_bodies, self._world.platforms, strict=True
        ):
            rotation = self._data.xmat[body].reshape(3, 3)
            for foot, head in _legs_at_rest(plan):
                head_in_world = self._data.xpos[body] + rotation @ head
                middle = foot + CYLINDER_SHARE * (head_in_world - foot)
                self._add_rod(
                    foot, middle, radius=CYLINDER_RADIUS_M, rgba=CYLINDER_RGBA
                )
                self._add_rod(middle, head_in_world, radius=ROD_RADIUS_M, rgba=ROD_RGBA)

    def _add_rod(
        self,
        start: Vec3,
        end: Vec3,
        *,
        radius: float,
        rgba: tuple[float, float, float, float],
    ) -> None:
        scene = self._drawing.scene
        if scene.ngeom >= scene.maxgeom:
            return
        geom = scene.geoms[scene.ngeom]
        kind = mujoco.mjtGeom.mjGEOM_CAPSULE
        mujoco.mjv_initGeom(
            geom,
            kind,
            np.zeros(3),
            np.zeros(3),
            np.eye(3).ravel(),
            np.array(rgba, dtype=np.float32),
        )
        mujoco.mjv_connector(geom, kind, radius, start, end)
        scene.ngeom += 1


def _legs_at_rest(plan: PlatformPlan) -> list[tuple[Vec3, Vec3]]:
    """Return six legs in pairs: foot in the world, head from the platform's centre."""
    legs = []
    for leg in range(LEGS):
        towards = math.tau * (leg + 0.5) / LEGS
        apart = LEG_LEAN_RAD if leg % 2 else -LEG_LEAN_RAD
        head = plan.box_centre + LEG_INSET * plan.half_size * [
            math.cos(towards),
            math.sin(towards),
            -1.0,
        ]
        foot = (
            plan.top_centre
            + plan.box_centre
            + LEG_SPREAD
            * plan.half_size
            * [
                math.cos(towards + apart),
                math.sin(towards + apart),
                0.0,
            ]
        )
        foot[2] = FLOOR_Z_M
        legs.append((foot, head))
    return legs


def _has_gl() -> bool:
    """Return whether MuJoCo can use OpenGL here.

    Without a display it falls back on GLFW, which aborts the whole process when it is
    asked a second time. So here, and only here, the environment is read outside the
    command line.
    """
    if sys.platform != "linux" or os.environ.get("MUJOCO_GL"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _mj_camera(camera: Camera) -> mujoco.MjvCamera:
    view = mujoco.MjvCamera()
    view.lookat[:] = camera.target
    view.distance = camera.distance
    view.azimuth = camera.azimuth_deg
    view.elevation = camera.elevation_deg
    return view


def _open_drawing(model: mujoco.MjModel, *, width: int, height: int) -> mujoco.Renderer:
    if not _has_gl():
        raise RenderError(_NO_GL.format(reason="no display, and MUJOCO_GL is not set"))
    try:
        with warnings.catch_warnings():
            # Without a display GLFW warns first; the error below says it better.
            warnings.simplefilter("ignore")
            return mujoco.Renderer(model, height, width)
    except Exception as error:  # Each OpenGL back end raises its own kind.
        raise RenderError(_NO_GL.format(reason=error)) from error


def draw_small_picture() -> None:
    """Draw an empty world with the backend of ``MUJOCO_GL``."""
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    with mujoco.Renderer(model, SIZE, SIZE) as renderer:
        renderer.update_scene(mujoco.MjData(model))
        renderer.render()


if __name__ == "__main__":
    draw_small_picture()
