"""Views into MuJoCo's state, looked up once: reading them each tick is cheap."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from surefoot.schemas.arrays import Vec3
from surefoot.sim_robot.quaternion import xyzw
from surefoot.sim_robot.robot_spec import SENSOR_SOLES
from surefoot.sim_robot.truth import PlantTruth, PlatformPose
from surefoot.sim_robot.world import World

_LEFT = SENSOR_SOLES.start
_RIGHT = SENSOR_SOLES.start + 6


class PlantView:
    """True state, straight from the arrays the simulation works in.

    Attributes:
        com: (3,) centre of mass, world [m]; live, like all arrays here.
        sole_left: (3,) sole frame's origin, world [m].
        sole_right: (3,) the same of the right foot.
        upper_names: links above the ankles, in the order of :meth:`heights`.
    """

    def __init__(self, world: World, data: mujoco.MjData) -> None:
        """Find the arrays; they stay those of ``data`` for good."""
        base = world.base_body
        left, right = world.sole_bodies
        self.com: Vec3 = data.subtree_com[base]
        self.sole_left: Vec3 = data.xpos[left]
        self.sole_right: Vec3 = data.xpos[right]
        self._base_position = data.qpos[:3]
        self._base_quat_wxyz = data.qpos[3:7]
        self._base_vertical = data.xmat[base, 6:9]
        self._base_up = world.base_up.tolist()
        self._sole_verticals = data.xmat[left, 6:9], data.xmat[right, 6:9]
        self._com_velocity = data.subtree_linvel[base]
        self._heights = data.xpos[:, 2]
        self._height_bodies = np.array([base, left, right, *world.upper_bodies])
        self.upper_names = [world.model.body(i).name for i in world.upper_bodies]
        self._sensors = data.sensordata
        self._platforms = [
            (data.xpos[body], data.xquat[body])
            for body, plan in zip(world.ground_bodies, world.platforms, strict=True)
            if plan.in_scenario
        ]

    @property
    def upright(self) -> float:
        """Cosine of the angle by which the base leans from its nominal attitude."""
        x, y, z = self._base_vertical.tolist()
        up_x, up_y, up_z = self._base_up
        return float(x * up_x + y * up_y + z * up_z)

    @property
    def sole_tilts(self) -> tuple[float, float]:
        """Of the left and right sole against the horizontal [rad]."""
        left, right = (min(axis.item(2), 1.0) for axis in self._sole_verticals)
        return math.acos(left), math.acos(right)

    @property
    def normal_forces(self) -> tuple[float, float]:
        """Of the ground on the left and right sole, along the sole's z axis [N]."""
        # MuJoCo's sign is that of the robot on the ground.
        sensors = self._sensors
        return -sensors.item(_LEFT + 2), -sensors.item(_RIGHT + 2)

    @property
    def vertical_forces(self) -> tuple[float, float]:
        """Of the ground on the left and right sole, along the world's vertical [N]."""
        force = self._sensors
        left, right = self._sole_verticals
        return (
            -left.item(0) * force.item(_LEFT)
            - left.item(1) * force.item(_LEFT + 1)
            - left.item(2) * force.item(_LEFT + 2),
            -right.item(0) * force.item(_RIGHT)
            - right.item(1) * force.item(_RIGHT + 1)
            - right.item(2) * force.item(_RIGHT + 2),
        )

    def heights(self) -> list[float]:
        """Return world z of base, soles, then every link above the ankles [m]."""
        heights: list[float] = self._heights.take(self._height_bodies).tolist()
        return heights

    def truth(self, tick: int) -> PlantTruth:
        """Copy the true state; the CoM's velocity must have been computed."""
        wrenches = -self._sensors[SENSOR_SOLES]
        return PlantTruth(
            tick=tick,
            base_position=self._base_position.copy(),
            base_quat_xyzw=xyzw(self._base_quat_wxyz),
            upright=self.upright,
            com=self.com.copy(),
            com_velocity=self._com_velocity.copy(),
            sole_left=self.sole_left.copy(),
            sole_right=self.sole_right.copy(),
            F_left=wrenches[:6],
            F_right=wrenches[6:],
            vertical_forces=self.vertical_forces,
            platforms=tuple(
                PlatformPose(position=position.copy(), quat_xyzw=xyzw(quat_wxyz))
                for position, quat_wxyz in self._platforms
            ),
        )
