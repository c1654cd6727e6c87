"""Turned frames and another joint order give the same commands."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pinocchio as pin
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import Reference
from surefoot.schemas.settings import ControllerSettings, SafetySettings, build_settings
from surefoot.stabilizer.control.reference import standing
from surefoot.stabilizer.factory import make_controller
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.safety.health import FRESH, SensorHealth
from tests.awkward_robot import Awkward
from tests.stabilizer.closed_loop import Run, run_closed_loop
from tests.stabilizer.standing_snapshot import standing_reference, standing_snapshot

CONTROLLERS = ["whole-body", "zmp"]
SETTINGS = build_settings(
    {}, overrides=["estimator.calibration_s=0.02", "dik.ramp_in_s=0.02"]
)
TICKS, CALIBRATION_TICKS = 150, 20
SAME_FRAME = 1e-12
SAME_COMMAND_RAD = 1e-7
"""Turning the readings into other frames and back costs some 1e-16 of 100 N.

A QP whose condition number is 1e8 makes 1e-6 of it. An admittance of some 1e-3 m/s per
newton makes 1e-10 of it in a tenth of a second.
"""
SAME_VELOCITY_RAD_S = 1e-5
"""The same QP's 1e-6, and its effect on the posture it starts from."""
PUSH = {
    "body": "torso",
    "force_n": [30.0, 60.0, 0.0],
    "start_s": 0.5,
    "duration_s": 0.1,
}
STANDS_ALIKE_M = 5e-4
"""Single samples and contact iterations differ, so the plants are not identical."""


def readings(model: RobotModel, walker: Robot, *, seed: int) -> list[Snapshot]:
    """Return the Walker's readings: at rest during calibration, then all noisy."""
    rng = np.random.default_rng(seed)
    still = standing_snapshot(model)
    noisy = [
        replace(
            still,
            q=still.q + 1e-3 * rng.normal(size=walker.n_a),
            dq=1e-2 * rng.normal(size=walker.n_a),
            effort=rng.normal(size=walker.n_a),
            angular_velocity=0.01 * rng.normal(size=3),
            linear_acceleration=still.linear_acceleration + 0.1 * rng.normal(size=3),
            ft_left=still.ft_left + 5.0 * rng.normal(size=6),
            ft_right=still.ft_right + 5.0 * rng.normal(size=6),
        )
        for _ in range(TICKS - CALIBRATION_TICKS)
    ]
    return [still] * CALIBRATION_TICKS + noisy


def wish(model: RobotModel) -> Reference:
    """Return a planner's reference that is a little off the stance everywhere."""
    rng = np.random.default_rng(43)
    stance = standing(model)
    half = 0.5 * 0.05
    return msgspec.structs.replace(
        standing_reference(model),
        com=(stance.com + np.array([0.01, -0.01, -0.02])).tolist(),
        com_velocity=[0.02, 0.01, -0.01],
        com_acceleration=[0.1, -0.1, 0.05],
        base_quat_xyzw=[float(np.sin(half)), 0.0, 0.0, float(np.cos(half))],
        posture=(model.robot.nominal + 0.05 * rng.normal(size=model.n_a)).tolist(),
    )


def answers(
    robot: Robot, name: str, *, snapshots: list[Snapshot], reference: Reference
) -> tuple[Array, Array]:
    """Return (ticks, n_a) commands and joint velocities; zero where there are none.

    The controller is new; the readings do not depend on its commands.
    """
    controller = make_controller(name, robot, SETTINGS)
    controller.start(snapshots[0], robot.nominal)
    commands, velocities = [], []
    for snapshot in snapshots:
        output = controller.step(snapshot, reference)
        assert output.qp_status == "ok"
        commands.append(output.q_command.copy())
        told = np.zeros(robot.n_a) if output.v_joint is None else output.v_joint
        velocities.append(told.copy())
    return np.array(commands), np.array(velocities)


def test_model_is_the_same_body(awkward: Awkward, model: RobotModel) -> None:
    its = RobotModel(awkward.robot)
    drawing = awkward.drawing
    assert its.mass == pytest.approx(model.mass)
    upright = pin.SE3(np.eye(3), drawing.base.translation)
    T_base_imu = upright.inverse() * model.T_base_imu * drawing.imu
    assert T_base_imu.isApprox(its.T_base_imu, SAME_FRAME)
    for side in (0, 1):
        moved = drawing.feet[side]
        T_sensor_sole = moved.inverse() * model.T_sensor_sole[side]
        assert T_sensor_sole.isApprox(its.T_sensor_sole[side], SAME_FRAME)
        com = moved.actInv(model.plates[side].com)
        np.testing.assert_allclose(its.plates[side].com, com, atol=SAME_FRAME)
    for name in ("lower", "upper", "torque_limit", "velocity_limit", "nominal"):
        np.testing.assert_array_equal(getattr(its, name), getattr(model, name))
    ours, theirs = standing(model), standing(its)
    np.testing.assert_allclose(theirs.com, ours.com, atol=SAME_FRAME)
    np.testing.assert_allclose(theirs.p_sole, ours.p_sole, atol=SAME_FRAME)


def test_a_planner_speaks_the_order_of_the_bus(
    awkward: Awkward, model: RobotModel
) -> None:
    its = RobotModel(awkward.robot)
    reference = wish(model)
    ours, theirs = standing(model), standing(its)
    ours.follow(reference, model)
    theirs.follow(to(awkward, reference), its)
    np.testing.assert_array_equal(theirs.posture, ours.posture)
    named = dict(
        zip(awkward.robot.joint_names, to(awkward, reference).posture, strict=True)
    )
    for name, value in zip(list(its.pin_model.names)[2:], theirs.posture, strict=True):
        assert value == named[name]


@pytest.mark.parametrize("name", CONTROLLERS)
def test_same_readings_and_wishes_give_the_same_commands(
    turned: Awkward, model: RobotModel, name: str
) -> None:
    walker = turned.walker
    plain = readings(model, walker, seed=44)
    reference = wish(model)
    expected, velocities = answers(walker, name, snapshots=plain, reference=reference)
    assert np.abs(expected[-1] - walker.nominal).max() > 1e-3
    actual, its_velocities = answers(
        turned.robot,
        name,
        snapshots=[turned.snapshot(each) for each in plain],
        reference=to(turned, reference),
    )
    np.testing.assert_allclose(
        turned.back(actual), expected, rtol=0.0, atol=SAME_COMMAND_RAD
    )
    np.testing.assert_allclose(
        turned.back(its_velocities), velocities, rtol=0.0, atol=SAME_VELOCITY_RAD_S
    )


def to(robot: Awkward, reference: Reference) -> Reference:
    """Return the same reference in the other robot's joint order."""
    posture = robot.joints(np.array(reference.posture))
    return msgspec.structs.replace(reference, posture=posture.tolist())


@pytest.mark.parametrize("joint", [0, 7, 20, 27])
def test_health_holds_each_joint_to_its_own_range(
    awkward: Awkward, model: RobotModel, joint: int
) -> None:
    """Just beyond its range is impossible, just within it is not."""
    robot, settings = awkward.robot, SafetySettings()
    still = replace(standing_snapshot(model), q=robot.nominal)
    for beyond in (0.01, -0.01):
        q = robot.nominal.copy()
        q[joint] = robot.upper[joint] + settings.joint_margin_rad + beyond
        health = SensorHealth(robot, msgspec.structs.replace(settings, bridge_s=1e-4))
        for tick in range(5):
            moved = replace(still, q=q, dq=still.dq + 1e-6 * tick)
            health.check(moved, FRESH, moves=lambda: False)
        assert bool(health.lost[0]) == (beyond > 0.0)


def test_health_believes_turned_sensors_as_it_does_the_walkers(
    turned: Awkward, model: RobotModel
) -> None:
    """Noise, then one joint's encoder jumps: the same sensor, the same tick."""
    plain = readings(model, turned.walker, seed=45)
    for tick in range(60, TICKS):
        plain[tick] = replace(plain[tick], q=plain[tick].q.copy())
        plain[tick].q[5] += 0.001 * (tick - 60) ** 2
    verdicts = []
    for robot, snapshots in (
        (turned.walker, plain),
        (turned.robot, [turned.snapshot(each) for each in plain]),
    ):
        health = SensorHealth(robot, SafetySettings())
        rows = []
        for snapshot in snapshots:
            health.check(snapshot, FRESH, moves=lambda: True)
            rows.append(tuple(health.lost))
        verdicts.append(rows)
    assert verdicts[0][59] == (None, None, None, None)
    assert verdicts[0][-1][0] is not None
    assert verdicts[1] == verdicts[0]


@pytest.fixture(scope="module", params=CONTROLLERS)
def pushed(request: pytest.FixtureRequest, awkward: Awkward) -> tuple[Run, Run]:
    """Run the Walker and the awkward robot, pushed from the side, without noise."""
    walker, robot = (
        run_closed_loop(
            each,
            controller=make_controller(request.param, each, ControllerSettings()),
            duration_s=1.5,
            sensors={},
            push=[PUSH],
        )
        for each in (awkward.walker, awkward.robot)
    )
    return walker, robot


@pytest.mark.usual("whole-body")
@pytest.mark.closed_loop
def test_it_stands_as_the_walker_does(pushed: tuple[Run, Run]) -> None:
    walker, robot = pushed
    assert robot.statuses == walker.statuses == {"ok"}
    assert not robot.fell
    swayed = [run.com_true - run.soles_true.mean(axis=1) for run in pushed]
    assert np.ptp(swayed[0], axis=0).max() > 10.0 * STANDS_ALIKE_M
    np.testing.assert_allclose(swayed[1], swayed[0], rtol=0.0, atol=STANDS_ALIKE_M)
