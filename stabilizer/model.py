"""The robot's rigid-body model in Pinocchio, built from the robot's files."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.urdf_check import without_shapes
from surefoot.schemas.arrays import Array, Mat, Vec3

GRAVITY = 9.81
"""Magnitude of gravity, as in the simulator [m/s^2]."""
N_BASE_Q = 7
N_BASE_V = 6
BASE_JOINT = 1
LOCKED_RAD = 1e-5
"""A joint with a smaller range is locked."""
NARROW_RAD = 0.05
"""A joint with a smaller range cannot be counted on: it is at its end at once."""
MARGIN_SHARE = 0.25
"""Largest part of a joint's range that a margin may take at either end."""


@dataclass(frozen=True)
class Plate:
    """The part of the foot below a force-torque sensor.

    Attributes:
        mass: [kg].
        com: (3,) centre of mass in the sensor frame [m].
    """

    mass: float
    com: Vec3


class RobotModel:
    """Static model: everything that does not change from tick to tick.

    Configurations follow Pinocchio: q = (base position, quat_xyzw, q_J) and v = (base
    twist in base, v_J). Inside, joints are in Pinocchio's order; outside, in that of
    the bus. ``to_model`` and ``to_bus`` convert.

    Attributes:
        pin_model: Pinocchio's model, with the servos' rotor inertia.
        n_a: number of joints.
        n_v: 6 + n_a.
        mass: total mass [kg].
        weight: its weight [N].
        to_model: (n_a,) ``q_model = q_bus[to_model]``.
        to_bus: (n_a,) ``q_bus = q_model[to_bus]``.
        sole_ids: frame ids of left and right sole.
        T_sensor_sole: placement of each sole in its sensor frame.
        plates: the plate below each sensor.
        half_sizes: half length and half width of left and right sole [m].
        leg_joints: for left and right leg, (n_a,) whether a joint lies between base and
            sole.
        is_leg: (n_a,) whether a joint belongs to either leg.
        is_locked: (n_a,) whether a joint cannot move.
        is_narrow: (n_a,) whether a joint is locked or can hardly move.
        T_base_imu: placement of the IMU in the base.

    The base is the base link's body and origin with the axes of the upright frame: in
    the nominal posture z is up and x ahead, however the URDF turns the link.
    """

    def __init__(self, robot: Robot) -> None:
        """Read the URDF.

        Raises:
            RobotFileError: Pinocchio refuses the URDF, or finds other joints than the
                robot file lists.
        """
        self.robot = robot
        try:
            self.pin_model = pin.buildModelFromXML(
                without_shapes(robot.urdf_path), pin.JointModelFreeFlyer()
            )
        except (ValueError, RuntimeError) as error:
            words = (str(error).strip() or type(error).__name__).splitlines()[0]
            raise RobotFileError(
                f"{robot.urdf_path}: Pinocchio refuses it: {words}"
            ) from error
        model = self.pin_model
        self.n_a = robot.n_a
        self.n_v = N_BASE_V + self.n_a
        if model.nv != self.n_v or model.nq != N_BASE_Q + self.n_a:
            raise RobotFileError(
                f"{robot.urdf_path}: Pinocchio sees {model.nv - N_BASE_V} joint "
                f"velocities, the robot file lists {self.n_a} joints; "
                "only revolute and prismatic joints are supported"
            )
        bus_index = {name: i for i, name in enumerate(robot.joint_names)}
        self.to_model = np.array([bus_index[name] for name in list(model.names)[2:]])
        self.to_bus = np.argsort(self.to_model)
        _turn_base(model, robot.R_upright_base)
        model.armature = np.concatenate(
            (np.zeros(N_BASE_V), robot.armature[self.to_model])
        )
        model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
        self.mass = float(pin.computeTotalMass(model))
        self.weight = self.mass * GRAVITY
        self.sole_ids = [_link(model, foot.sole_frame) for foot in robot.file.foot]
        self._read_fixed_frames(robot)
        self.lower = robot.soft_lower[self.to_model]
        self.upper = robot.soft_upper[self.to_model]
        self.is_locked = self.upper - self.lower < LOCKED_RAD
        self.is_narrow = self.upper - self.lower < NARROW_RAD
        self.torque_limit = robot.torque_limit[self.to_model]
        self.velocity_limit = robot.velocity_limit[self.to_model]
        self.nominal = robot.nominal[self.to_model]
        self.com_travel = robot.file.com_travel_m
        self.half_sizes = [
            (foot.half_length_m, foot.half_width_m) for foot in robot.file.foot
        ]
        self.leg_joints = [self._joints_to(sole_id) for sole_id in self.sole_ids]
        self.is_leg = self.leg_joints[0] | self.leg_joints[1]

    def _read_fixed_frames(self, robot: Robot) -> None:
        model = self.pin_model
        self.T_sensor_sole: list[pin.SE3] = []
        self.plates: list[Plate] = []
        for foot, sole_id in zip(robot.file.foot, self.sole_ids, strict=True):
            sensor = model.frames[_link(model, foot.ft_link)]
            sole = model.frames[sole_id]
            self.T_sensor_sole.append(sensor.placement.actInv(sole.placement))
            self.plates.append(_plate_below(model, _link(model, foot.ft_link)))
        imu = model.frames[_link(model, robot.file.imu.frame)]
        self.T_base_imu: pin.SE3 = imu.placement.copy()

    def _joints_to(self, sole_id: int) -> NDArray[np.bool_]:
        """Return which joints lie between the base and a sole, (n_a,)."""
        is_between = np.zeros(self.n_a, dtype=bool)
        joint = self.pin_model.frames[sole_id].parentJoint
        while joint > 1:
            is_between[self.pin_model.idx_vs[joint] - N_BASE_V] = True
            joint = self.pin_model.parents[joint]
        return is_between

    def range_within(self, margin: float) -> Mat:
        """Return the joint ranges minus a margin, which is smaller for narrow joints.

        Args:
            margin: distance to keep from either end [rad].

        Returns:
            (2, n_a) lower and upper ends, model order [rad]. A locked joint gets a
            range hardly wider than its own, since a QP needs room between two limits.
        """
        fitting = np.minimum(margin, MARGIN_SHARE * (self.upper - self.lower))
        fitting[self.is_locked] = -LOCKED_RAD
        return np.vstack((self.lower + fitting, self.upper - fitting))

    def frame_id(self, name: str) -> int:
        """Return the id of a link's or joint's frame.

        Raises:
            ValueError: there is no such frame.
        """
        names = [frame.name for frame in self.pin_model.frames]
        if name not in names:
            near = ", ".join(difflib.get_close_matches(name, names)) or "none like it"
            raise ValueError(
                f"{self.robot.urdf_path}: got frame {name!r}, expected the name of a "
                f"link or joint; there is {near}"
            )
        frame_id: int = self.pin_model.getFrameId(name)
        return frame_id

    def nominal_configuration(self) -> Array:
        """Return the nominal configuration, (7 + n_a,): base upright, soles at z = 0.

        The stance frame is the world: origin midway between the soles.
        """
        q = np.concatenate((np.zeros(3), [0.0, 0.0, 0.0, 1.0], self.nominal))
        data = self.pin_model.createData()
        pin.framesForwardKinematics(self.pin_model, data, q)
        middle = sum(data.oMf[i].translation for i in self.sole_ids) / 2.0
        q[:3] = -middle
        return q


def _link(model: pin.Model, name: str) -> int:
    """Return the frame of a link; a joint of the same name may be elsewhere."""
    frame_id: int = model.getFrameId(name, pin.FrameType.BODY)
    return frame_id


def _turn_base(model: pin.Model, R_upright_base: Mat) -> None:
    """Give the floating joint the axes of the upright frame.

    Args:
        model: changed in place.
        R_upright_base: (3, 3) rotation of the base link, whose axes the joint has so
            far, in the upright frame.
    """
    if np.array_equal(R_upright_base, np.eye(3)):
        return
    turn = pin.SE3(R_upright_base, np.zeros(3))
    model.inertias[BASE_JOINT] = model.inertias[BASE_JOINT].se3Action(turn)
    for joint in range(BASE_JOINT + 1, model.njoints):
        if model.parents[joint] == BASE_JOINT:
            model.jointPlacements[joint] = turn * model.jointPlacements[joint]
    for index in range(model.nframes):
        frame = model.frames[index]  # a slice would be copies
        if frame.parentJoint == BASE_JOINT and frame.type != pin.FrameType.JOINT:
            frame.placement = turn * frame.placement


def _plate_below(model: pin.Model, sensor_id: int) -> Plate:
    """Return mass and centre of mass of all links fixed below the sensor.

    Pinocchio keeps a fixed link's inertia in the frame of its fixed joint, and the
    inertia carried by a movable joint in that joint.
    """
    sensor = model.frames[sensor_id]
    mount_id = sensor.parentFrame
    if model.frames[mount_id].type == pin.FrameType.JOINT:
        carried = model.inertias[sensor.parentJoint]
        return Plate(carried.mass, com=sensor.placement.actInv(carried.lever))
    mass, moment = 0.0, np.zeros(3)
    for frame_id, frame in enumerate(model.frames):
        if frame.inertia.mass == 0.0 or not _is_below(model, frame_id, mount_id):
            continue
        T_sensor_link = sensor.placement.actInv(frame.placement)
        mass += frame.inertia.mass
        moment += frame.inertia.mass * T_sensor_link.act(frame.inertia.lever)
    com = moment / mass if mass > 0.0 else moment
    return Plate(mass=mass, com=com)


def inertia_below(model: pin.Model, sensor_id: int) -> pin.Inertia:
    """Return the inertia of all links fixed below a sensor, in its joint's frame."""
    mount_id = model.frames[sensor_id].parentFrame
    if model.frames[mount_id].type == pin.FrameType.JOINT:
        return model.inertias[model.frames[sensor_id].parentJoint].copy()
    total = pin.Inertia.Zero()
    for frame_id, frame in enumerate(model.frames):
        if frame.inertia.mass > 0.0 and _is_below(model, frame_id, mount_id):
            total += frame.inertia.se3Action(frame.placement)
    return total


def _is_below(model: pin.Model, frame_id: int, ancestor_id: int) -> bool:
    while frame_id not in (0, ancestor_id):
        frame_id = model.frames[frame_id].parentFrame
    return frame_id == ancestor_id


def yaw_from(R: Mat, yaw: float) -> float:
    """Return the angle from a heading to a frame's x axis, projected to the level.

    Args:
        R: (3, 3) world from frame.
        yaw: the heading [rad].

    Returns:
        Angle between -pi and pi, counter-clockwise from above [rad].
    """
    return math.remainder(math.atan2(R.item(1, 0), R.item(0, 0)) - yaw, math.tau)


def turn_level(x: float, y: float, angle: float) -> tuple[float, float]:
    """Return a level vector, turned counter-clockwise from above by an angle [rad]."""
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * x - sin * y, sin * x + cos * y


def skew(v: Vec3) -> Mat:
    """Return the (3, 3) matrix with ``skew(a) @ b == cross(a, b)``."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
