"""What a scene shows at one moment, whether live or from a record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from cli.view.robot_shape import RobotShape
from robot_io.robot import Robot
from robot_io.sight import Sight
from schemas.arrays import Array, Mat, Vec3


@dataclass(frozen=True)
class SceneState:
    """Poses and forces of one moment, in the world.

    Attributes:
        base: (4, 4) world from base link.
        q: (n_a,) measured posture, bus order [rad].
        q_command: (n_a,) commanded posture [rad].
        platforms: (4, 4) world from platform, top centre.
        F_meas: (12,) measured wrenches at the soles, sole frames; None if unknown.
        F_id: (12,) wanted wrenches; None if unknown.
        in_contact: whether left and right foot stand.
        com: (3,) centre of mass [m]; None if unknown.
        com_reference: (3,) where it should be [m]; None if unknown.
    """

    base: Mat
    q: Array
    q_command: Array
    platforms: list[Mat]
    F_meas: Array | None
    F_id: Array | None
    in_contact: tuple[bool, bool]
    com: Vec3 | None
    com_reference: Vec3 | None


def pose(position: list[float] | Vec3, quat_xyzw: list[float] | Array) -> Mat:
    """(4, 4) from position [m] and quaternion."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(np.asarray(quat_xyzw)).as_matrix()
    T[:3, 3] = position
    return T


def state_of(sight: Sight, robot: Robot, shape: RobotShape) -> SceneState | None:
    """What was seen on the bus, as a scene.

    The base is where the simulator's truth says; without one, its attitude is the
    inertial unit's and its place such that the soles stand around the origin.

    Args:
        sight: newest messages.
        robot: names the frames.
        shape: where the soles are.

    Returns:
        None until the robot has said where its joints are.
    """
    if sight.joints is None:
        return None
    q = np.array(sight.joints.q)
    links = shape.poses(q)
    soles = [links[foot.sole_frame] for foot in robot.file.foot]
    truth, stabilizer = sight.truth, sight.stabilizer
    if truth is not None:
        base = pose(truth.base_position, truth.base_quat_xyzw)
    else:
        base = _standing_base(sight, robot, links, soles)
    middle = 0.5 * ((base @ soles[0])[:3, 3] + (base @ soles[1])[:3, 3])
    ground = middle * (1.0, 1.0, 0.0)
    com = reference = F_meas = F_id = None
    contact = (True, True)
    if stabilizer is not None:
        # The stance frame stands midway between the soles; its height is the world's.
        com = np.array(stabilizer.com) + ground
        reference = np.array(stabilizer.com_reference) + ground
        F_meas = np.array(stabilizer.F_meas_left + stabilizer.F_meas_right)
        F_id = np.array(stabilizer.F_id_left + stabilizer.F_id_right)
        contact = (stabilizer.in_contact[0], stabilizer.in_contact[1])
    if truth is not None:
        com = np.array(truth.com)
    return SceneState(
        base=base,
        q=q,
        q_command=q if sight.status is None else np.array(sight.status.q_command),
        platforms=[]
        if truth is None
        else [pose(p.position, p.quat_xyzw) for p in truth.platforms],
        F_meas=F_meas,
        F_id=F_id,
        in_contact=contact,
        com=com,
        com_reference=reference,
    )


def _standing_base(
    sight: Sight, robot: Robot, links: dict[str, Mat], soles: list[Mat]
) -> Mat:
    base = np.eye(4)
    if sight.imu is not None:
        unit = links[robot.file.imu.frame][:3, :3]
        attitude = Rotation.from_quat(sight.imu.quat_xyzw).as_matrix() @ unit.T
        yaw = np.arctan2(attitude[1, 0], attitude[0, 0])
        base[:3, :3] = Rotation.from_euler("z", -yaw).as_matrix() @ attitude
    base[:3, 3] = -base[:3, :3] @ (0.5 * (soles[0] + soles[1]))[:3, 3]
    return base
