"""The content of a scene at one moment, live or from a record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from surefoot.robot_io.client_side.observer import LatestMessages
from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Mat, Vec3, Vec6
from surefoot.schemas.messages import GroundBlock
from surefoot.schemas.robot_file import Foot
from surefoot.schemas.walk_plan import WalkStatus
from surefoot.view.robot_shape import RobotShape

F_Z, M_X, M_Y = 2, 3, 4
LEAST_FORCE_N = 20.0
"""Normal force below which a foot's centre of pressure is noise [N]."""


USUAL_GROUND = GroundBlock(
    position=[0.0, 0.0, 0.0],
    quat_xyzw=[0.0, 0.0, 0.0, 1.0],
    size=[0.8, 0.9, 0.06],
    platform=-1,
)
"""Ground to draw without a simulator's truth."""
AIRBORNE = ("swing", "relanding")
"""States of a foot in the air."""


@dataclass(frozen=True)
class WalkSight:
    """A walk at one moment, in the odometry frame.

    Attributes:
        footholds: (2, 4) x, y, z [m] and yaw [rad] of left and right foot, where each
            was last set down.
        on_ground: whether left and right foot are on the ground.
        planned: (k, 4) next footholds; that of a foot in the air comes first.
        dcm: (2,) estimated divergent component of motion [m].
        dcm_reference: (2,) its reference [m].
        zmp_reference: (2,) reference of the zero-moment point [m].
    """

    footholds: Mat
    on_ground: tuple[bool, bool]
    planned: Mat
    dcm: Array
    dcm_reference: Array
    zmp_reference: Array


@dataclass(frozen=True)
class SceneState:
    """Poses and forces at one moment, in the world.

    Attributes:
        base: (4, 4) world from base link.
        q: (n_a,) measured joint positions, bus order [rad].
        q_command: (n_a,) commanded joint positions [rad].
        platforms: (4, 4) world from the top centre of each platform.
        ground: blocks of the ground; empty while unknown.
        F_meas: (12,) measured wrenches at the soles, in sole frames [N, N m]; None if
            unknown.
        F_id: (12,) desired wrenches, likewise; None if unknown.
        in_contact: whether left and right foot stand.
        com: (3,) centre of mass [m]; None if unknown.
        com_reference: (3,) its reference [m]; None if unknown.
        walk: the walk; None without one.
    """

    base: Mat
    q: Array
    q_command: Array
    platforms: list[Mat]
    ground: list[GroundBlock]
    F_meas: Array | None
    F_id: Array | None
    in_contact: tuple[bool, bool]
    com: Vec3 | None
    com_reference: Vec3 | None
    walk: WalkSight | None = None


def pose(position: list[float] | Vec3, quat_xyzw: list[float] | Array) -> Mat:
    """Return a (4, 4) pose from a position (3,) [m] and a quaternion (4,)."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(np.asarray(quat_xyzw)).as_matrix()
    T[:3, 3] = position
    return T


def state_of(
    sight: LatestMessages, robot: Robot, shape: RobotShape
) -> SceneState | None:
    """Return the scene that the newest messages of the bus describe.

    The base's pose is the simulator's truth. Without a truth, the attitude is the
    IMU's, and the middle of the soles lies at the origin.

    Returns:
        None until the first joint positions have come.
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
    feet = np.array([(base @ sole)[:3, 3] for sole in soles])
    walk = None
    if sight.walk_status is not None and sight.walk_status.moved:
        walk = walk_sight(sight.walk_status)
    com = reference = F_meas = F_id = None
    contact = (True, True)
    if stabilizer is not None:
        com = stance_in_world(np.array(stabilizer.com), feet, walk)
        reference = stance_in_world(np.array(stabilizer.com_reference), feet, walk)
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
        ground=[USUAL_GROUND] if truth is None else truth.ground,
        F_meas=F_meas,
        F_id=F_id,
        in_contact=contact,
        com=com,
        com_reference=reference,
        walk=walk,
    )


def walk_sight(status: WalkStatus) -> WalkSight:
    """Return a stabilizer's report on its walk, as a scene shows it."""
    on_ground = [foot not in AIRBORNE for foot in (status.foot_left, status.foot_right)]
    goals = (status.goal_left, status.goal_right)
    swings = [goal for goal, down in zip(goals, on_ground, strict=True) if not down]
    return WalkSight(
        footholds=np.array([status.foothold_left, status.foothold_right]),
        on_ground=(on_ground[0], on_ground[1]),
        planned=np.array([*swings, *status.ahead]).reshape(-1, 4),
        dcm=np.array(status.dcm),
        dcm_reference=np.array(status.dcm_reference),
        zmp_reference=np.array(status.zmp_reference),
    )


def stance_in_world(place: Vec3, feet: Mat, walk: WalkSight | None) -> Vec3:
    """Transform a place from the controller's stance frame to the world.

    The stance frame lies midway between the soles. In a walk it stays where the walk
    began: then it is the odometry frame. Its height is the world's.

    Args:
        place: (3,) in the stance frame [m].
        feet: (2, 3) left and right sole in the world [m].
        walk: tells the feet in the odometry frame; None without a walk.
    """
    middle = feet[:, :2].mean(axis=0)
    there = place[:2]
    if walk is not None:
        known = walk.footholds[:, :2]
        (x, y), (x_known, y_known) = feet[0, :2] - feet[1, :2], known[0] - known[1]
        turn = np.arctan2(y, x) - np.arctan2(y_known, x_known)
        away = there - known.mean(axis=0)
        there = Rotation.from_euler("z", turn).as_matrix()[:2, :2] @ away
    return np.array([*(middle + there), place[2]])


def odometry_in_world(walk: WalkSight, soles: tuple[Mat, Mat], ground: Mat) -> Mat:
    """Return (4, 4) world from odometry frame, as a standing foot shows it.

    The frame's plane is the moving ground's under that foot.

    Args:
        walk: tells the feet in the odometry frame.
        soles: (4, 4) world from sole, left and right.
        ground: (3, 3) attitude of the ground in the world.
    """
    side = 0 if walk.on_ground[0] else 1
    x, y, z, yaw = walk.footholds[side]
    sole = ground.T @ soles[side][:3, :3]
    turn = np.arctan2(sole[1, 0], sole[0, 0]) - yaw
    T = np.eye(4)
    T[:3, :3] = ground @ Rotation.from_euler("z", turn).as_matrix()
    T[:3, 3] = soles[side][:3, 3] - T[:3, :3] @ (x, y, z)
    return T


def nominal_state(robot: Robot, shape: RobotShape) -> SceneState:
    """Return the nominal posture on level ground, to show before any message."""
    links = shape.poses(robot.nominal)
    soles = [links[foot.sole_frame] for foot in robot.file.foot]
    return SceneState(
        base=_standing_base(LatestMessages(), robot, links, soles),
        q=robot.nominal,
        q_command=robot.nominal,
        platforms=[],
        ground=[USUAL_GROUND],
        F_meas=None,
        F_id=None,
        in_contact=(True, True),
        com=None,
        com_reference=None,
    )


def _standing_base(
    sight: LatestMessages, robot: Robot, links: dict[str, Mat], soles: list[Mat]
) -> Mat:
    base = np.eye(4)
    base[:3, :3] = robot.R_upright_base
    if sight.imu is not None:
        unit = links[robot.file.imu.frame][:3, :3]
        attitude = Rotation.from_quat(sight.imu.quat_xyzw).as_matrix() @ unit.T
        yaw = np.arctan2(attitude[1, 0], attitude[0, 0])
        base[:3, :3] = Rotation.from_euler("z", -yaw).as_matrix() @ attitude
    base[:3, 3] = -base[:3, :3] @ (0.5 * (soles[0] + soles[1]))[:3, 3]
    return base


def pressure_point(F: Vec6) -> Vec3:
    """Return the centre of pressure of a foot.

    Args:
        F: (6,) wrench of the ground at the sole, in the sole frame [N, N m].

    Returns:
        (3,) in the sole frame [m]; its origin below ``LEAST_FORCE_N``.
    """
    if F[F_Z] < LEAST_FORCE_N:
        return np.zeros(3)
    return np.array([-F[M_Y] / F[F_Z], F[M_X] / F[F_Z], 0.0])


def zero_moment_point(wrenches: Array, soles: tuple[Mat, Mat]) -> Vec3 | None:
    """Return the zero-moment point of both feet.

    Args:
        wrenches: (12,) of the ground at left and right sole, in sole frames [N, N m].
        soles: (4, 4) world from sole, left and right.

    Returns:
        (3,) in the world [m]; None below ``LEAST_FORCE_N`` on both feet together.
    """
    total, weighted = 0.0, np.zeros(3)
    for F, sole in zip((wrenches[:6], wrenches[6:]), soles, strict=True):
        force = max(float(F[F_Z]), 0.0)
        total += force
        weighted += force * (sole[:3, :3] @ pressure_point(F) + sole[:3, 3])
    return None if total < LEAST_FORCE_N else weighted / total


def sole_corners(foot: Foot, sole: Mat) -> Mat:
    """Return the (4, 3) corners of a sole in the world [m].

    Args:
        foot: half length and half width of its sole.
        sole: (4, 4) world from sole.
    """
    signs = np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]])
    corners = signs * np.array([foot.half_length_m, foot.half_width_m, 0.0])
    moved: Mat = corners @ sole[:3, :3].T + sole[:3, 3]
    return moved


def support_polygon(corners: Mat) -> Mat:
    """Return the convex hull of corners of soles, seen from above.

    Args:
        corners: (m, 3) corners of all standing soles [m], m at least 3.

    Returns:
        (k, 3) corners of the hull, anticlockwise [m].
    """
    from scipy.spatial import ConvexHull

    hull: Mat = corners[ConvexHull(corners[:, :2]).vertices]
    return hull
