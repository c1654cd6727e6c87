"""What standing in the nominal posture asks of a robot: torques, sag, room to tip."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.stabilizer.model import GRAVITY, N_BASE_V, RobotModel
from surefoot.stabilizer.stance.nominal import MARGIN_RAD
from surefoot.stabilizer.stance.reach import ReachSearch
from surefoot.stabilizer.stance.solver import StanceSolver

DIRECTIONS = 8
"""Of pushes, counted from ahead to the left."""
_ALONG = 1e-9


@dataclass(frozen=True)
class Standing:
    """A robot at rest in its nominal posture, z up and x ahead.

    Attributes:
        mass: [kg].
        com: (3,) from the middle between the soles [m].
        soles: (2, 3) from there [m].
        sole_tilt: (2,) against the level [rad].
        sole_yaw: (2,) against ahead [rad].
        sensor_up: (2,) cosine of the angle between each sensor's z axis and up.
        plates: (2,) mass below each force-torque sensor [kg].
        torques: (n_a,) that hold it, bus order [N m].
        sag: (n_a,) by which its servos give way under them, bus order [rad].
        com_sag: (3,) of the CoM against the feet [m].
    """

    mass: float
    com: Vec3
    soles: Mat
    sole_tilt: Array
    sole_yaw: Array
    sensor_up: Array
    plates: Array
    torques: Array
    sag: Array
    com_sag: Vec3


def stand(model: RobotModel) -> Standing:
    """Work it out; half the weight, and what balance asks for, on each foot."""
    pin_model = model.pin_model
    q = model.nominal_configuration()
    data = pin_model.createData()
    pin.computeAllTerms(pin_model, data, q, np.zeros(model.n_v))
    pin.updateFramePlacements(pin_model, data)
    poses = [data.oMf[i] for i in model.sole_ids]
    J_soles = np.vstack(
        [
            pin.getFrameJacobian(pin_model, data, i, pin.LOCAL_WORLD_ALIGNED)
            for i in model.sole_ids
        ]
    )
    # Of all wrenches that carry the base, the smallest: an even load.
    weight = data.nle
    wrenches = np.linalg.pinv(J_soles[:, :N_BASE_V].T) @ weight[:N_BASE_V]
    torques = (weight - J_soles.T @ wrenches)[N_BASE_V:]
    torques_bus = torques[model.to_bus]
    sag_bus = torques_bus / model.robot.kp
    # Joints give way against their torque, and the base moves so that the soles stay.
    given = -sag_bus[model.to_model]
    J_base = np.linalg.pinv(J_soles[:, :N_BASE_V])
    v = np.concatenate((-J_base @ (J_soles[:, N_BASE_V:] @ given), given))
    sensors = [
        data.oMf[pin_model.getFrameId(foot.ft_link, pin.FrameType.BODY)].rotation[2, 2]
        for foot in model.robot.file.foot
    ]
    soles = np.array([pose.translation for pose in poses])
    return Standing(
        mass=model.mass,
        com=data.com[0].copy(),
        soles=soles,
        sole_tilt=np.array([math.acos(min(1.0, p.rotation[2, 2])) for p in poses]),
        sole_yaw=np.array(
            [math.atan2(p.rotation[1, 0], p.rotation[0, 0]) for p in poses]
        ),
        sensor_up=np.array(sensors),
        plates=np.array([plate.mass for plate in model.plates]),
        torques=torques_bus,
        sag=sag_bus,
        com_sag=data.Jcom @ v,
    )


def capture_limits(model: RobotModel) -> Array:
    """Return the impulses M sqrt(g / h) d that a standing robot can just catch.

    Each carries the capture point over the distance d to the edge of the soles' hull.

    Args:
        model: of the robot, in its nominal posture.

    Returns:
        (8,) from ahead to the left, every 45 degrees [N s].
    """
    from scipy.spatial import ConvexHull

    pin_model = model.pin_model
    data = pin_model.createData()
    q = model.nominal_configuration()
    pin.framesForwardKinematics(pin_model, data, q)
    com = pin.centerOfMass(pin_model, data, q)
    poses = [data.oMf[i] for i in model.sole_ids]
    corners = np.array(
        [
            pose.act(np.array([along * length, across * width, 0.0]))
            for pose, (length, width) in zip(poses, model.half_sizes, strict=True)
            for along in (-1.0, 1.0)
            for across in (-1.0, 1.0)
        ]
    )
    edges = ConvexHull(corners[:, :2]).equations
    room = -(edges[:, :2] @ com[:2] + edges[:, 2])
    height = float(com[2] - corners[:, 2].mean())
    impulses = np.empty(DIRECTIONS)
    for i in range(DIRECTIONS):
        angle = math.tau * i / DIRECTIONS
        towards = edges[:, :2] @ (math.cos(angle), math.sin(angle))
        ahead = towards > _ALONG
        metres = max(0.0, float(np.min(room[ahead] / towards[ahead])))
        impulses[i] = model.mass * math.sqrt(GRAVITY / height) * metres
    return impulses


def reach_search(model: RobotModel) -> ReachSearch:
    """Ready to try ground under a robot, within what its joints may use."""
    margin = np.minimum(MARGIN_RAD, 0.25 * (model.upper - model.lower))
    solver = StanceSolver(
        model.pin_model,
        model.sole_ids,
        R_world_base=np.eye(3),
        lower=model.lower + margin,
        upper=model.upper - margin,
        is_leg=model.is_leg,
    )
    return ReachSearch(solver, np.clip(model.nominal, solver.lower, solver.upper))
