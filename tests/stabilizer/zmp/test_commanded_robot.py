"""Inverse kinematics of the commanded robot."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from surefoot.schemas.arrays import Array
from surefoot.schemas.law_settings import DikSettings, ZmpSettings
from surefoot.stabilizer.model import N_BASE_V, RobotModel
from surefoot.stabilizer.zmp.commanded_robot import CommandedRobot, ComTarget
from tests.stabilizer.rig import BOTH

PERIOD_S = 0.001
LIMITS = DikSettings()
KKT = 1e-6
STILL = np.zeros(3)


@pytest.fixture
def robot(model: RobotModel) -> CommandedRobot:
    return CommandedRobot(model, ZmpSettings(), LIMITS, period_s=PERIOD_S)


def follow(
    robot: CommandedRobot,
    model: RobotModel,
    *,
    ticks: int,
    twist: Array | None = None,
    com_offset: Array = STILL,
    q_measured: Array | None = None,
) -> None:
    """Let the robot move; measured joints equal the commanded ones."""
    com = robot.kinematics.p_com + com_offset
    for _ in range(ticks):
        solution = robot.solve(
            twist=np.zeros(12) if twist is None else twist,
            in_contact=BOTH,
            com=ComTarget(com, STILL, STILL),
            R_base=np.eye(3),
            posture=model.nominal,
        )
        assert solution.ok
        assert solution.residuals().worst < KKT
        joints = robot.q[N_BASE_V + 1 :] if q_measured is None else q_measured
        robot.integrate(solution.x, joints.copy(), ticks=1.0)


def test_nothing_asked_nothing_moves(robot: CommandedRobot, model: RobotModel) -> None:
    before = robot.q.copy()
    follow(robot, model, ticks=20)
    np.testing.assert_allclose(robot.q, before, atol=1e-9)


def test_soles_take_up_the_twist_within_a_few_milliseconds(
    robot: CommandedRobot, model: RobotModel
) -> None:
    """Lag 1 / B = 3.3 ms: after 20 ms more than 95 %."""
    twist = np.zeros(12)
    twist[[4, 9]] = -0.1, 0.05
    follow(robot, model, ticks=20, twist=twist)
    v = robot.kinematics.v_sole
    assert 0.095 < -v[4] < 0.1005
    assert 0.0475 < v[9] < 0.0503


def test_centre_of_mass_goes_where_it_should_and_the_soles_stay(
    robot: CommandedRobot, model: RobotModel
) -> None:
    soles = [p.copy() for p in robot.kinematics.p_sole]
    com = robot.kinematics.p_com.copy()
    offset = np.array([0.02, -0.01, -0.02])
    follow(robot, model, ticks=800, com_offset=offset)
    np.testing.assert_allclose(robot.kinematics.p_com, com + offset, atol=1e-3)
    np.testing.assert_allclose(robot.kinematics.p_sole, soles, atol=1e-3)


def test_commands_stay_near_the_robot_and_gather_no_speed(
    robot: CommandedRobot, model: RobotModel
) -> None:
    """A robot that cannot move: the command waits at the anti-windup's reach."""
    stuck = model.nominal.copy()
    follow(
        robot,
        model,
        ticks=1_500,
        com_offset=np.array([0.0, 0.0, -0.3]),
        q_measured=stuck,
    )
    away = robot.q[7:] - stuck
    assert np.abs(away).max() <= LIMITS.windup_limit_rad + 1e-12
    assert np.abs(away).max() == pytest.approx(LIMITS.windup_limit_rad)
    limit = np.isclose(np.abs(away), LIMITS.windup_limit_rad, atol=1e-12)
    assert (np.abs(robot.v[N_BASE_V:][limit]) <= LIMITS.velocity_limit_rad_s).all()


def test_joint_speeds_stay_within_their_limits(
    robot: CommandedRobot, model: RobotModel
) -> None:
    twist = np.zeros(12)
    twist[2], twist[8] = 3.0, -3.0
    fastest = np.minimum(model.velocity_limit, LIMITS.velocity_limit_rad_s)
    for _ in range(60):
        follow(robot, model, ticks=1, twist=twist)
        assert (np.abs(robot.v[N_BASE_V:]) <= fastest * (1.0 + 1e-6)).all()
        assert (robot.q[7:] >= model.lower).all()
        assert (robot.q[7:] <= model.upper).all()


def test_base_turns_to_its_wanted_orientation(
    robot: CommandedRobot, model: RobotModel
) -> None:
    desired = pin.rpy.rpyToMatrix(0.03, -0.04, 0.0)
    com = robot.kinematics.p_com.copy()
    for _ in range(3_000):
        solution = robot.solve(
            twist=np.zeros(12),
            in_contact=BOTH,
            com=ComTarget(com, STILL, STILL),
            R_base=desired,
            posture=model.nominal,
        )
        robot.integrate(solution.x, robot.q[7:].copy(), ticks=1.0)
    R = pin.Quaternion(robot.q[3:7]).toRotationMatrix()
    assert np.linalg.norm(pin.log3(R.T @ desired)) < 0.01
