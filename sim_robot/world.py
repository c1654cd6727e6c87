"""The MuJoCo world: a robot from its files, on the ground of a scenario."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from robot_io.robot import Robot
from schemas.arrays import Vec3
from schemas.robot_file import Foot
from schemas.scenario import Scenario
from sim_robot.constants import GRAVITY_M_S2, SIM_STEP_S
from sim_robot.platforms import PlatformPlan, plan_platforms
from sim_robot.scenery import add_scenery
from sim_robot.urdf_spec import read_urdf

CONTACT_TIME_CONSTANT_S = 0.004
CONTACT_IMPEDANCE = (0.95, 0.99, 0.001, 0.5, 2.0)
"""Critically damped; the standing robot sinks in by some 35 um."""
TANGENTIAL_STIFFNESS_RATIO = 10.0
"""How much stiffer friction is than the normal contact: soles do not creep."""
SOLVER_TOLERANCE = 1e-10
SOLE_HALF_THICKNESS_M = 0.015
PLATFORM_INERTIA = 1e6
"""Rotor inertia of platform joints [kg or kg m^2]: the robot does not move them."""

IMU_SITE = "imu"
SENSOR_QUAT_WXYZ = slice(0, 4)
SENSOR_GYRO = slice(4, 7)
SENSOR_IMU_VELOCITY = slice(7, 10)
SENSOR_FT = slice(10, 22)
SENSOR_SOLES = slice(22, 34)
"""Layout of the sensor array; FT and SOLES hold left then right [force; moment].

The velocity of the IMU is in world axes; wrenches have MuJoCo's sign, that of the
robot on what is below.
"""


@dataclass(frozen=True)
class World:
    """A compiled world and where things are in its arrays.

    Attributes:
        model: MuJoCo model; actuators are in bus order, the robot's degrees of
            freedom come first, the platforms' after them.
        platforms: the ground, in the order of ``ground_bodies``.
        base_height: base origin above the ground with flat soles in the nominal
            posture [m].
        base_body: id of the base link.
        imu_site: id of the inertial unit's frame.
        joint_qpos: (n_a,) addresses in qpos, bus order.
        joint_dof: (n_a,) addresses in qvel, bus order.
        sole_bodies: ids of the left and the right sole.
        ground_bodies: ids of the platforms.
        upper_bodies: ids of the robot's bodies above the ankles: they touch the
            ground only in a fall.
        weight: the robot's true weight [N].
    """

    model: mujoco.MjModel
    platforms: tuple[PlatformPlan, ...]
    base_height: float
    base_body: int
    imu_site: int
    joint_qpos: NDArray[np.intp]
    joint_dof: NDArray[np.intp]
    sole_bodies: tuple[int, int]
    ground_bodies: tuple[int, ...]
    upper_bodies: NDArray[np.intp]
    weight: float


def build_world(robot: Robot, scenario: Scenario, *, scenery: bool = False) -> World:
    """Builds the world of one run.

    Args:
        robot: what its files say.
        scenario: ground, friction and model error.
        scenery: keep the URDF's visuals, and add light, sky and a floor far below:
            for pictures.

    Returns:
        The world; the state is not set up in it.
    """
    spec = _robot_spec(robot, scenario, visuals=scenery)
    soles = _nominal_soles(spec, robot)
    base_height = -0.5 * float(soles[0][2] + soles[1][2])
    platforms = plan_platforms(scenario, sole_left=soles[0], sole_right=soles[1])
    for plan in platforms:
        _add_platform(spec, plan, robot=robot, friction=scenario.friction)
    _set_options(spec)
    if scenery:
        add_scenery(spec, platforms)
    model = spec.compile()
    _scale_masses(model, robot, scale=scenario.model_error.mass_scale)
    base_body = _body_id(model, robot.file.base_link)
    _forget_platform_inertia(model, robot)
    joints = [model.joint(name) for name in robot.joint_names]
    feet = (robot.left, robot.right)
    return World(
        model=model,
        platforms=platforms,
        base_height=base_height,
        base_body=base_body,
        imu_site=int(model.site(IMU_SITE).id),
        joint_qpos=np.array([j.qposadr[0] for j in joints], dtype=np.intp),
        joint_dof=np.array([j.dofadr[0] for j in joints], dtype=np.intp),
        sole_bodies=(
            _body_id(model, robot.left.sole_frame),
            _body_id(model, robot.right.sole_frame),
        ),
        ground_bodies=tuple(_body_id(model, plan.name) for plan in platforms),
        upper_bodies=_upper_bodies(model, base_body, feet=feet),
        weight=float(model.body_subtreemass[base_body]) * GRAVITY_M_S2,
    )


def _robot_spec(robot: Robot, scenario: Scenario, *, visuals: bool) -> mujoco.MjSpec:
    """The robot alone: free base, drives, soles and sensors."""
    spec = read_urdf(robot.urdf_path, visuals=visuals)
    spec.body(robot.file.base_link).add_freejoint(name="base")
    _add_drives(spec, robot, kp_scale=scenario.model_error.servo_kp_scale)
    _add_imu(spec, robot.file.imu.frame)
    feet = (robot.left, robot.right)
    for foot in feet:
        _add_sole_box(spec, foot)
    for foot in feet:
        _add_wrench_sensor(spec, foot.ft_link)
    for foot in feet:
        _add_wrench_sensor(spec, foot.sole_frame)
    return spec


def _add_drives(spec: mujoco.MjSpec, robot: Robot, *, kp_scale: float) -> None:
    """Servos: torque = kp (set-point - q) - kd dq within the limit, bus order."""
    for entry in robot.file.joint:
        joint = spec.joint(entry.name)
        joint.armature = entry.armature_kg_m2
        joint.damping[0] = entry.damping_nm_s_rad
        # The servo alone limits the torque; URDF effort would clamp a second time.
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        kp = entry.kp_nm_rad * kp_scale
        servo = spec.add_actuator(
            name=entry.name,
            target=entry.name,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            forcelimited=mujoco.mjtLimited.mjLIMITED_TRUE,
            forcerange=[-entry.torque_limit_nm, entry.torque_limit_nm],
        )
        servo.gainprm[0] = kp
        servo.biasprm[1] = -kp
        servo.biasprm[2] = -entry.kd_nm_s_rad


def _add_imu(spec: mujoco.MjSpec, frame: str) -> None:
    spec.body(frame).add_site(name=IMU_SITE, pos=[0.0, 0.0, 0.0])
    for name, kind in (
        ("imu_quat", mujoco.mjtSensor.mjSENS_FRAMEQUAT),
        ("imu_gyro", mujoco.mjtSensor.mjSENS_GYRO),
        ("imu_velocity", mujoco.mjtSensor.mjSENS_FRAMELINVEL),
    ):
        spec.add_sensor(
            name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=IMU_SITE
        )


def _add_sole_box(spec: mujoco.MjSpec, foot: Foot) -> None:
    """The box that touches the ground, in the sole's own massless body.

    A force sensor between that body and the foot then reads the contact wrench,
    at the sole, and nothing else.
    """
    spec.body(foot.sole_frame).add_geom(
        name=foot.sole_frame,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[foot.half_length_m, foot.half_width_m, SOLE_HALF_THICKNESS_M],
        pos=[0.0, 0.0, SOLE_HALF_THICKNESS_M],
        mass=0.0,
        contype=0,
        conaffinity=0,
        group=3,
    )


def _add_wrench_sensor(spec: mujoco.MjSpec, link: str) -> None:
    spec.body(link).add_site(name=link, pos=[0.0, 0.0, 0.0])
    for name, kind in (
        (f"{link}_force", mujoco.mjtSensor.mjSENS_FORCE),
        (f"{link}_moment", mujoco.mjtSensor.mjSENS_TORQUE),
    ):
        spec.add_sensor(
            name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=link
        )


def _nominal_soles(spec: mujoco.MjSpec, robot: Robot) -> tuple[Vec3, Vec3]:
    """Sole centres from the base in the nominal posture, each (3,) [m]."""
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, angle in zip(robot.joint_names, robot.nominal, strict=True):
        data.qpos[model.joint(name).qposadr[0]] = angle
    mujoco.mj_kinematics(model, data)
    return (
        data.body(robot.left.sole_frame).xpos.copy(),
        data.body(robot.right.sole_frame).xpos.copy(),
    )


def _add_platform(
    spec: mujoco.MjSpec, plan: PlatformPlan, *, robot: Robot, friction: float
) -> None:
    """A box that only the soles touch, with a joint for each axis that moves."""
    body = spec.worldbody.add_body(
        name=plan.name,
        pos=plan.top_centre,
        mass=1.0,
        ipos=[0.0, 0.0, 0.0],
        inertia=[1.0, 1.0, 1.0],
        explicitinertial=True,
        gravcomp=1.0,
    )
    body.add_geom(
        name=plan.name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=plan.half_size,
        pos=plan.box_centre,
        contype=0,
        conaffinity=0,
        rgba=[0.42, 0.45, 0.50, 1.0],
    )
    for axis in plan.motions:
        kind, direction = _JOINTS[axis]
        body.add_joint(
            name=f"{plan.name}_{axis}",
            type=kind,
            axis=direction,
            armature=PLATFORM_INERTIA,
        )
    for foot in (robot.left, robot.right):
        pair = spec.add_pair(geomname1=plan.name, geomname2=foot.sole_frame, condim=3)
        pair.friction[:] = [friction, friction, 0.0, 0.0, 0.0]
        pair.solref[:] = [CONTACT_TIME_CONSTANT_S, 1.0]
        pair.solimp[:] = CONTACT_IMPEDANCE


_SLIDE, _HINGE = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
_JOINTS = {
    "x": (_SLIDE, [1.0, 0.0, 0.0]),
    "y": (_SLIDE, [0.0, 1.0, 0.0]),
    "z": (_SLIDE, [0.0, 0.0, 1.0]),
    "yaw": (_HINGE, [0.0, 0.0, 1.0]),
    "pitch": (_HINGE, [0.0, 1.0, 0.0]),
    "roll": (_HINGE, [1.0, 0.0, 0.0]),
}


def _set_options(spec: mujoco.MjSpec) -> None:
    option = spec.option
    option.timestep = SIM_STEP_S
    option.gravity = [0.0, 0.0, -GRAVITY_M_S2]
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    # At the default 1e-8 the solver stops early and tangential forces are 1 % off.
    option.tolerance = SOLVER_TOLERANCE
    option.impratio = TANGENTIAL_STIFFNESS_RATIO
    # A state that blew up is a fall to report, not something to reset silently.
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET


def _scale_masses(model: mujoco.MjModel, robot: Robot, *, scale: float) -> None:
    """Makes every link of the robot heavier; rotor inertias stay."""
    if scale == 1.0:
        return
    links = model.body_rootid == _body_id(model, robot.file.base_link)
    model.body_mass[links] *= scale
    model.body_inertia[links] *= scale
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _forget_platform_inertia(model: mujoco.MjModel, robot: Robot) -> None:
    """Keeps the solver's tolerance, relative to mean inertia, that of the robot."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    model.stat.meaninertia = float(np.mean(np.diag(inertia)[: 6 + robot.n_a]))


def _upper_bodies(
    model: mujoco.MjModel, base_body: int, *, feet: tuple[Foot, Foot]
) -> NDArray[np.intp]:
    """The robot's bodies without sole, foot and the two ankle links above it."""
    low: set[int] = set()
    for foot in feet:
        body = _body_id(model, foot.sole_frame)
        moved = 0
        while moved < 2 and body != base_body:
            low.add(body)
            moved += int(model.body_jntnum[body])
            body = int(model.body_parentid[body])
    links = np.flatnonzero(model.body_rootid == base_body)
    return np.array([i for i in links if i not in low], dtype=np.intp)


def _body_id(model: mujoco.MjModel, name: str) -> int:
    return int(model.body(name).id)
