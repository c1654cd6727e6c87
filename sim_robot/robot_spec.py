"""Builds the robot as a MuJoCo model, with its stance before it settles."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

import mujoco
import numpy as np

from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.urdf_check import without_shapes
from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.schemas.messages import ForceTorque, ImuState
from surefoot.schemas.robot_file import Foot
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.scenario_robot import Start
from surefoot.schemas.sensors import of_kind
from surefoot.schemas.validation import nearest
from surefoot.sim_robot.catalogue import ScenarioError

SOLE_HALF_THICKNESS_M = 0.015
EVEN_M = 1e-3
"""Soles with a smaller difference in height stand on one level [m]."""
LEVEL_RAD = math.radians(2.0)
"""Largest tilt of a sole in a posture that stands [rad]."""


def per_joint(
    value: float | Mapping[str, float], robot: Robot, *, what: str, default: float = 0.0
) -> Array:
    """Spread a value over the joints, (n_a,) in bus order.

    Args:
        value: one value for all joints, or values by joint name.
        robot: has the names of the joints.
        what: path of the key, for errors.
        default: value of joints that are not named.

    Raises:
        ScenarioError: a name is no joint of the robot.
    """
    if not isinstance(value, Mapping):
        return np.full(robot.n_a, float(value))
    spread = np.full(robot.n_a, default)
    for name, number in value.items():
        if name not in robot.joint_names:
            raise ScenarioError(
                f"{what}: {robot.file.name} has no joint {name!r}"
                f"{nearest(name, robot.joint_names)}; there are "
                f"{', '.join(robot.joint_names)}",
                field=what,
            )
        spread[robot.joint_names.index(name)] = number
    return spread


ATTITUDE = ("quat_xyzw", mujoco.mjtSensor.mjSENS_FRAMEQUAT, 4)
MOTION = (
    ("angular_velocity", mujoco.mjtSensor.mjSENS_GYRO, 3),
    ("linear_acceleration", mujoco.mjtSensor.mjSENS_FRAMELINVEL, 3),
)
WRENCH = (
    ("force", mujoco.mjtSensor.mjSENS_FORCE, 3),
    ("moment", mujoco.mjtSensor.mjSENS_TORQUE, 3),
)
"""Each attribute of a message, with its MuJoCo sensor and number of values.

Attitudes are w x y z. For the acceleration MuJoCo reads the velocity in world axes, and
the accelerometer computes it from that. Wrenches have MuJoCo's sign: they act from the
robot on the part below.
"""
UNITS, ANKLES = of_kind(ImuState), of_kind(ForceTorque)
_READS = (
    *((unit, ATTITUDE) for unit in UNITS),
    *((unit, read) for unit in UNITS for read in MOTION),
    *((ankle, read) for ankle in ANKLES for read in WRENCH),
)
"""All readings in the order of MuJoCo's sensor array: first attitudes, then noisy
readings together, with the wrenches together at their end."""
_ENDS = tuple(accumulate(size for _, (_, _, size) in _READS))
SENSOR_PLACES = {
    (entry.name, attribute): slice(end - size, end)
    for (entry, (attribute, _, size)), end in zip(_READS, _ENDS, strict=True)
}
"""Slice of MuJoCo's sensor array for each attribute of a sensor's message."""
SENSOR_NOISY = slice(4 * len(UNITS), _ENDS[-1])
SENSOR_WRENCHES = slice(_ENDS[-1] - 6 * len(ANKLES), _ENDS[-1])
SENSOR_SOLES = slice(_ENDS[-1], _ENDS[-1] + 12)
"""Contact wrenches after all that: left then right, [force; moment]."""


def read_urdf(path: Path, *, visuals: bool) -> mujoco.MjSpec:
    """Read a URDF; fixed links stay separate bodies, and nothing collides.

    Args:
        path: path of the URDF.
        visuals: keep its <visual> elements, for pictures; otherwise drop all its
            geometry.

    Returns:
        The model, not compiled.
    """
    if visuals:
        root = ElementTree.parse(path).getroot()
        for link in root.iter("link"):
            for shape in link.findall("collision"):
                link.remove(shape)
    else:
        root = ElementTree.fromstring(without_shapes(path))
    # MuJoCo drops visuals while reading, unless the file itself says otherwise.
    extension = root.find("mujoco")
    if extension is None:
        extension = ElementTree.SubElement(root, "mujoco")
    compiler = extension.find("compiler")
    if compiler is None:
        compiler = ElementTree.SubElement(extension, "compiler")
    compiler.set("discardvisual", "false" if visuals else "true")
    compiler.set("fusestatic", "false")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    # Otherwise it would now drop every geom that only explicit pairs let collide.
    spec.compiler.discardvisual = False
    spec.modelfiledir = str(path.parent)
    return spec


@contextmanager
def refusing(robot: Robot) -> Iterator[None]:
    """Turn MuJoCo's errors about a robot's files into one that names the file.

    Raises:
        RobotFileError: contains the first line of MuJoCo's message.
    """
    try:
        yield
    except ScenarioError:
        raise
    except (ValueError, RuntimeError, KeyError, TypeError, AttributeError) as error:
        words = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise RobotFileError(
            f"{robot.urdf_path}: MuJoCo refuses it: {words}; mend the file, or leave "
            "out what it names"
        ) from error


def robot_spec(robot: Robot, scenario: Scenario, *, visuals: bool) -> mujoco.MjSpec:
    """Make the robot alone: free base, servos, soles and sensors.

    Returns:
        The model, not compiled; actuators are in bus order.
    """
    spec = read_urdf(robot.urdf_path, visuals=visuals)
    spec.body(robot.file.base_link).add_freejoint(name="base")
    error = scenario.model_error
    _add_drives(spec, robot, kp_scale=error.servo_kp_scale)
    _add_friction(spec, robot, error.joint_friction_nm)
    _shift_com(spec, robot, error.com_offset_m)
    feet = (robot.left, robot.right)
    for foot in feet:
        _add_sole_box(spec, foot)
    for entry in (*UNITS, *ANKLES):
        _add_site(spec, entry.name, link=entry.link(robot.file))
    for entry, read in _READS:
        _add_sensor(spec, entry.name, read)
    for foot in feet:
        _add_site(spec, foot.sole_frame, link=foot.sole_frame)
        for read in WRENCH:
            _add_sensor(spec, foot.sole_frame, read)
    return spec


def _add_drives(spec: mujoco.MjSpec, robot: Robot, *, kp_scale: float) -> None:
    """Add servos: torque = kp (set-point - q) - kd dq within limits, bus order."""
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


def _add_friction(
    spec: mujoco.MjSpec, robot: Robot, friction: float | dict[str, float]
) -> None:
    """Add dry friction to the friction of the URDF."""
    added = per_joint(friction, robot, what="model_error.joint_friction_nm")
    for name, value in zip(robot.joint_names, added, strict=True):
        if value:
            spec.joint(name).frictionloss += value


def _shift_com(spec: mujoco.MjSpec, robot: Robot, offset: Sequence[float]) -> None:
    """Shift the trunk's mass so that the robot's centre of mass shifts.

    Args:
        spec: the robot's model.
        robot: gives the upright axes of the nominal posture.
        offset: (3,) shift of the robot's centre of mass, in these axes [m].

    Raises:
        ScenarioError: the trunk has no mass.
    """
    if not any(offset):
        return
    base = spec.body(robot.file.base_link)
    trunk, turn = _heaviest_fixed(base, np.eye(3))
    if trunk.mass == 0.0:
        raise ScenarioError(
            f"com_offset_m: the base link {robot.file.base_link} and what is fixed "
            "to it have no mass to shift; use a [[payload]]",
            field="com_offset_m",
        )
    whole = sum(body.mass for body in spec.bodies)
    shift = np.array(offset) * (whole / trunk.mass)
    trunk.ipos = trunk.ipos + turn.T @ robot.R_upright_base.T @ shift


def _heaviest_fixed(body: mujoco.MjsBody, turned: Mat) -> tuple[mujoco.MjsBody, Mat]:
    """Return the heaviest of a body and all that is fixed to it, with its rotation.

    Args:
        body: where to begin.
        turned: (3, 3) its rotation.
    """
    found = [(body, turned)]
    for child in body.bodies:
        if not child.joints:
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, child.quat)
            found.append(_heaviest_fixed(child, turned @ turn.reshape(3, 3)))
    return max(found, key=lambda pair: float(pair[0].mass))


def _add_sole_box(spec: mujoco.MjSpec, foot: Foot) -> None:
    """Add the box that touches the ground, in the sole's own massless body.

    A force sensor between that body and the foot then reads only the contact wrench, at
    the sole.
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


def _add_site(spec: mujoco.MjSpec, name: str, *, link: str) -> None:
    spec.body(link).add_site(name=name, pos=[0.0, 0.0, 0.0])


def _add_sensor(
    spec: mujoco.MjSpec, site: str, read: tuple[str, mujoco.mjtSensor, int]
) -> None:
    attribute, kind, _ = read
    spec.add_sensor(
        name=f"{site} {attribute}",
        type=kind,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=site,
    )


@dataclass(frozen=True)
class Stance:
    """A posture of the robot over level ground.

    Attributes:
        posture: (n_a,) joint positions [rad].
        base_quat_wxyz: (4,) world from base link.
        soles: left and right sole from the base, each (3,), world axes [m].
        place: (2,) x and y of the base [m, world].
        yaw: heading of the robot [rad].
    """

    posture: Array
    base_quat_wxyz: Array
    soles: tuple[Vec3, Vec3]
    place: Array
    yaw: float

    @property
    def base_height(self) -> float:
        """Height of the base origin above the ground [m]."""
        left, right = (float(sole[2]) for sole in self.soles)
        is_even = abs(left - right) < EVEN_M
        return -0.5 * (left + right) if is_even else -min(left, right)

    @property
    def soles_in_world(self) -> tuple[Vec3, Vec3]:
        """Positions of the soles, each (3,) [m]; z is relative to the base."""
        shift = np.array([*self.place, 0.0])
        return self.soles[0] + shift, self.soles[1] + shift


def stand(spec: mujoco.MjSpec, robot: Robot, start: Start) -> tuple[Stance, Stance]:
    """Place the robot as the scenario requests, in nominal and in starting posture.

    Returns:
        The nominal and the starting stance, both turned and moved.

    Raises:
        ScenarioError: no such joint, an angle beyond its range, or a sole not level.
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
