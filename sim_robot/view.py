"""Views into MuJoCo's state, looked up once: reading them each tick is cheap."""

from __future__ import annotations

import mujoco

from sim_robot.quaternion import xyzw
from sim_robot.robot_spec import SENSOR_SOLES
from sim_robot.truth import PlantTruth, PlatformPose
from sim_robot.world import World


class PlantView:
    """True state, straight from the arrays the simulation works in."""

    def __init__(self, world: World, data: mujoco.MjData) -> None:
        """Finds the arrays; they stay those of ``data`` for good."""
        base = world.base_body
        left, right = world.sole_bodies
        self._base_position = data.qpos[:3]
        self._base_quat_wxyz = data.qpos[3:7]
        self._base_z_axis = data.xmat[base, 6:9]
        self._com = data.subtree_com[base]
        self._com_velocity = data.subtree_linvel[base]
        self._sole_left, self._sole_right = data.xpos[left], data.xpos[right]
        self._heights = data.xpos[:, 2]
        self._upper_bodies = world.upper_bodies
        self._soles = data.sensordata[SENSOR_SOLES]
        self._platforms = [
            (data.xpos[body], data.xquat[body])
            for body, plan in zip(world.ground_bodies, world.platforms, strict=True)
            if plan.in_scenario
        ]

    def base_height(self) -> float:
        """Base origin, world z [m]."""
        return float(self._base_position[2])

    def base_upright(self) -> float:
        """Cosine of the angle between the base's z axis and the vertical."""
        return float(self._base_z_axis[2])

    def sole_heights(self) -> tuple[float, float]:
        """Left and right sole, world z [m]."""
        return float(self._sole_left[2]), float(self._sole_right[2])

    def lowest_link(self) -> float:
        """Lowest origin of the links above the ankles, world z [m]."""
        return float(self._heights.take(self._upper_bodies).min())

    def truth(self, tick: int) -> PlantTruth:
        """Copies the true state; the CoM's velocity must have been computed."""
        # MuJoCo's sign is that of the robot on the ground.
        wrenches = -self._soles
        return PlantTruth(
            tick=tick,
            base_position=self._base_position.copy(),
            base_quat_xyzw=xyzw(self._base_quat_wxyz),
            com=self._com.copy(),
            com_velocity=self._com_velocity.copy(),
            sole_left=self._sole_left.copy(),
            sole_right=self._sole_right.copy(),
            F_left=wrenches[:6],
            F_right=wrenches[6:],
            platforms=tuple(
                PlatformPose(position=position.copy(), quat_xyzw=xyzw(quat_wxyz))
                for position, quat_wxyz in self._platforms
            ),
        )
