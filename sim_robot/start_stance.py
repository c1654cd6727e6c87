"""How the robot is put on the ground before it settles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.schemas.scenario_robot import Start
from surefoot.sim_robot.errors import ScenarioError
from surefoot.sim_robot.robot_spec import per_joint

EVEN_M = 1e-3
"""Soles that differ less in height stand on one level."""
LEVEL_RAD = math.radians(2.0)
"""Soles of a posture that stands are level to within this."""


@dataclass(frozen=True)
class Stance:
    """A posture of the robot over level ground.

    Attributes:
        posture: (n_a,) joint positions [rad].
        base_quat_wxyz: (4,) world from base link.
        soles: (3,) each, left and right sole from the base, world axes [m].
        place: (2,) x and y of the base [m, world].
        yaw: where the robot looks [rad].
    """

    posture: Array
    base_quat_wxyz: Array
    soles: tuple[Vec3, Vec3]
    place: Array
    yaw: float

    @property
    def base_height(self) -> float:
        """Base origin above the ground [m]."""
        left, right = (float(sole[2]) for sole in self.soles)
        is_even = abs(left - right) < EVEN_M
        return -0.5 * (left + right) if is_even else -min(left, right)

    @property
    def soles_in_world(self) -> tuple[Vec3, Vec3]:
        """Where the soles are on the ground, each (3,) [m]; z from the base."""
        shift = np.array([*self.place, 0.0])
        return self.soles[0] + shift, self.soles[1] + shift


def stand(spec: mujoco.MjSpec, robot: Robot, start: Start) -> tuple[Stance, Stance]:
    """Put the robot where a scenario wants it, nominal and in its own posture.

    Args:
        spec: the robot alone; not changed.
        robot: nominal posture and feet.
        start: of the scenario.

    Returns:
        The nominal stance and the one it begins in, both turned and moved.

    Raises:
        ScenarioError: no such joint, beyond its range, or the soles are not level.
    """
    nominal = _stance(spec, robot, robot.nominal, start)
    if not start.posture:
        return nominal, nominal
    posture = robot.nominal.copy()
    named = per_joint(start.posture, robot, what="start.posture", default=math.nan)
    given = ~np.isnan(named)
    posture[given] = named[given]
    for name, angle, low, high in zip(
        robot.joint_names, posture, robot.lower, robot.upper, strict=True
    ):
        if not low <= angle <= high:
            raise ScenarioError(
                f"start.posture.{name}: got {angle:g} rad, expected {low:g} to "
                f"{high:g}, the joint's range",
                field=f"start.posture.{name}",
            )
    return nominal, _stance(spec, robot, posture, start)


def _stance(spec: mujoco.MjSpec, robot: Robot, posture: Array, start: Start) -> Stance:
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, angle in zip(robot.joint_names, posture, strict=True):
        data.qpos[model.joint(name).qposadr[0]] = angle
    yaw = math.radians(start.yaw_deg)
    attitude: Mat = robot.R_upright_base
    if yaw:
        from scipy.spatial.transform import Rotation

        attitude = Rotation.from_euler("z", yaw).as_matrix() @ attitude
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, attitude.flatten())
    data.qpos[3:7] = quat
    mujoco.mj_kinematics(model, data)
    soles = []
    for foot in (robot.left, robot.right):
        sole = data.body(foot.sole_frame)
        soles.append(sole.xpos.copy())
        tilt = math.acos(min(1.0, float(sole.xmat[8])))
        if tilt > LEVEL_RAD and start.posture:
            raise ScenarioError(
                f"start.posture: the {foot.side} sole is {math.degrees(tilt):.1f} deg "
                "off level, expected a posture that stands: turn the ankle by as much "
                "as hip and knee turned",
                field="start.posture",
            )
    place = np.array(start.position_m, dtype=np.float64)
    return Stance(posture, quat, (soles[0], soles[1]), place, yaw)
