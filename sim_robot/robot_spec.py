"""The robot alone, as an editable MuJoCo model."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco

from surefoot.robot_io.robot import Robot
from surefoot.schemas.robot_file import Foot
from surefoot.schemas.scenario import Scenario

SOLE_HALF_THICKNESS_M = 0.015
IMU_SITE = "imu"
SENSOR_QUAT_WXYZ = slice(0, 4)
SENSOR_IMU_VELOCITY = slice(7, 10)
SENSOR_FT = slice(10, 22)
SENSOR_SOLES = slice(22, 34)
SENSOR_NOISY = slice(4, 22)
"""Layout of the sensor array; FT and SOLES hold left then right [force; moment].

NOISY is the gyroscope (4 to 7) and all from there to the last force sensor. The
velocity of the IMU is in world axes; wrenches have MuJoCo's sign, that of the
robot on what is below.
"""


def read_urdf(path: Path, *, visuals: bool) -> mujoco.MjSpec:
    """Read a URDF; fixed links stay bodies of their own, nothing collides.

    Args:
        path: of the URDF.
        visuals: keep its <visual> elements, for pictures; else nothing is left of
            its geometry.

    Returns:
        The model, not compiled.
    """
    root = ElementTree.parse(path).getroot()
    # MuJoCo drops visuals while it reads, unless the file itself says otherwise.
    extension = root.find("mujoco")
    if extension is None:
        extension = ElementTree.SubElement(root, "mujoco")
    compiler = extension.find("compiler")
    if compiler is None:
        compiler = ElementTree.SubElement(extension, "compiler")
    compiler.set("discardvisual", "false" if visuals else "true")
    compiler.set("fusestatic", "false")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    # From here on it would drop every geom that only explicit pairs let collide.
    spec.compiler.discardvisual = False
    spec.modelfiledir = str(path.parent)
    for geom in list(spec.geoms):
        if geom.contype or geom.conaffinity:
            spec.delete(geom)
    return spec


def robot_spec(robot: Robot, scenario: Scenario, *, visuals: bool) -> mujoco.MjSpec:
    """The robot alone: free base, drives, soles and sensors.

    Args:
        robot: what its files say.
        scenario: its model error scales the servos.
        visuals: keep the URDF's visuals, for pictures.

    Returns:
        The model, not compiled; actuators are in bus order.
    """
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
