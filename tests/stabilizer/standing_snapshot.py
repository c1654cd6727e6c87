"""Sensors and reference of a robot at rest in its nominal stance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.messages import SCHEMA_VERSION, Reference
from surefoot.stabilizer.control.reference import standing
from surefoot.stabilizer.model import GRAVITY, RobotModel
from tests.stabilizer.kinematic_robot import KinematicRobot


def standing_snapshot(model: RobotModel) -> Snapshot:
    """Return the sensors; each foot carries half the weight under its middle."""
    q = model.nominal_configuration()
    reading = KinematicRobot(model, lambda _: q).snapshot(0.0)
    half = 0.5 * model.mass * GRAVITY
    left, right = (_upwards(half - plate.mass * GRAVITY) for plate in model.plates)
    return replace(reading, ft_left=left, ft_right=right)


def airborne_snapshot(model: RobotModel) -> Snapshot:
    """Return the same posture with both feet hanging free."""
    left, right = (_upwards(-plate.mass * GRAVITY) for plate in model.plates)
    return replace(standing_snapshot(model), ft_left=left, ft_right=right)


def standing_reference(
    model: RobotModel, *, com_acceleration: float = 0.0
) -> Reference:
    """Return the nominal stance as a planner's reference."""
    return Reference(
        schema=SCHEMA_VERSION,
        tick=0,
        stamp_ns=0,
        com=standing(model).com.tolist(),
        com_velocity=[0.0, 0.0, 0.0],
        com_acceleration=[0.0, 0.0, 0.0],
        base_quat_xyzw=[0.0, 0.0, 0.0, 1.0],
        posture=model.robot.nominal.tolist(),
        feet=[],
    )


def _upwards(force: float) -> np.ndarray:
    return np.array([0.0, 0.0, force, 0.0, 0.0, 0.0])
