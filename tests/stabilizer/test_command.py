"""From wanted velocities to the joint command."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import Reference
from surefoot.schemas.settings import build_settings
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from tests.stabilizer.standing_snapshot import standing_reference

PERIOD_S = 0.001
SETTINGS = build_settings(
    {}, overrides=["estimator.calibration_s=0.05", "dik.ramp_in_s=0.05"]
)
"""Short calibration and fade-in."""
CALIBRATION_TICKS = round(SETTINGS.estimator.calibration_s / PERIOD_S)
FADED_IN_TICKS = CALIBRATION_TICKS + round(SETTINGS.dik.ramp_in_s / PERIOD_S)
LONG = 800
STEP_RAD = 0.05
ROUNDING = 1e-9


@pytest.fixture
def controller(walker: Robot, snapshot: Snapshot) -> WholeBodyController:
    controller = WholeBodyController(walker, SETTINGS)
    controller.start(snapshot, walker.nominal)
    return controller


def answers(
    controller: WholeBodyController,
    snapshot: Snapshot,
    *,
    ticks: int,
    reference: Reference | None = None,
) -> Array:
    """Return (ticks, n_a) commands for constant readings."""
    outputs = []
    for _ in range(ticks):
        output = controller.step(snapshot, reference)
        assert output.qp_status == "ok"
        outputs.append(output.q_command.copy())
    return np.array(outputs)


def with_posture(reference: Reference, posture: Array) -> Reference:
    return msgspec.structs.replace(reference, posture=posture.tolist())


def with_com(reference: Reference, com: list[float]) -> Reference:
    return msgspec.structs.replace(reference, com=com)


def pushed(snapshot: Snapshot) -> Snapshot:
    """Return sensors in which the left foot is pushed with twice its force."""
    return replace(snapshot, ft_left=2.0 * snapshot.ft_left)


def test_first_commands_are_the_posture_it_took_over(
    walker: Robot, snapshot: Snapshot
) -> None:
    """Whatever the servos hold, even where the joints are not."""
    held = walker.nominal + 0.01
    controller = WholeBodyController(walker, SETTINGS)
    controller.start(snapshot, held)
    commands = answers(controller, pushed(snapshot), ticks=CALIBRATION_TICKS - 1)
    np.testing.assert_allclose(commands, np.broadcast_to(held, commands.shape))


def test_commands_fade_in(controller: WholeBodyController, snapshot: Snapshot) -> None:
    """With a force error too small to be a sensor's offset."""
    answers(controller, snapshot, ticks=CALIBRATION_TICKS)
    ramp = round(SETTINGS.dik.ramp_in_s / PERIOD_S)
    left, right = 1.05 * snapshot.ft_left, 0.95 * snapshot.ft_right
    uneven = replace(snapshot, ft_left=left, ft_right=right)
    commands = answers(controller, uneven, ticks=ramp)
    steps = np.abs(np.diff(commands, axis=0)).max(axis=1)
    assert steps[0] < 0.05 * steps.max()
    assert steps[: ramp // 10].max() < 0.2 * steps.max()


def test_command_stays_near_a_robot_that_does_not_follow(
    controller: WholeBodyController, snapshot: Snapshot
) -> None:
    """A force error that nothing takes away is not integrated for ever."""
    commands = answers(controller, pushed(snapshot), ticks=LONG)
    away = np.abs(commands - snapshot.q)
    assert away.max() <= SETTINGS.dik.windup_limit_rad + ROUNDING
    assert away.max() == pytest.approx(SETTINGS.dik.windup_limit_rad)


def test_command_stays_within_the_joints_ranges(
    walker: Robot, controller: WholeBodyController, snapshot: Snapshot
) -> None:
    posture = walker.upper + 1.0
    commands = answers(
        controller,
        snapshot,
        ticks=LONG,
        reference=with_posture(standing_reference(controller.model), posture),
    )
    assert (commands <= walker.soft_upper + ROUNDING).all()
    assert (commands >= walker.soft_lower - ROUNDING).all()


@pytest.mark.parametrize("name", ["left_elbow", "right_wrist_roll", "head_yaw"])
def test_posture_reference_moves_the_joint_it_names(
    walker: Robot, controller: WholeBodyController, snapshot: Snapshot, name: str
) -> None:
    """Through both joint orders and back."""
    index = walker.joint_names.index(name)
    posture = walker.nominal.copy()
    posture[index] += STEP_RAD
    reference = standing_reference(controller.model)
    answers(controller, snapshot, ticks=FADED_IN_TICKS, reference=reference)
    as_before = np.diff(answers(controller, snapshot, ticks=2), axis=0)[0]
    reference = with_posture(reference, posture)
    asked = answers(controller, snapshot, ticks=2, reference=reference)
    change = np.diff(asked, axis=0)[0] - as_before
    assert np.argmax(np.abs(change)) == index
    wanted = SETTINGS.dik.posture_gain * STEP_RAD * PERIOD_S
    assert 0.0 < change[index] <= wanted * (1.0 + ROUNDING)


def test_com_reference_is_taken_over_and_pulls(
    controller: WholeBodyController, snapshot: Snapshot
) -> None:
    answers(controller, snapshot, ticks=FADED_IN_TICKS)
    reference = standing_reference(controller.model)
    before = controller.step(snapshot, reference)
    com, F_before = before.com_reference.copy(), before.F_id.copy()
    forward = [com[0] + 0.02, com[1], com[2]]
    after = controller.step(snapshot, with_com(reference, forward))
    np.testing.assert_allclose(after.com_reference, forward)
    # To get there, the ground first has to push forward.
    assert after.F_id[[0, 6]].sum() > F_before[[0, 6]].sum()


@pytest.mark.parametrize("far", [-1.0, 1.0])
def test_height_reference_stays_within_reach_of_the_legs(
    controller: WholeBodyController, snapshot: Snapshot, far: float
) -> None:
    answers(controller, snapshot, ticks=FADED_IN_TICKS)
    reference = standing_reference(controller.model)
    nominal = reference.com[2]
    wanted = [reference.com[0], reference.com[1], nominal + far]
    output = controller.step(snapshot, with_com(reference, wanted))
    lowest, highest = controller.model.com_travel
    reach = highest if far > 0.0 else lowest
    assert output.com_reference[2] == pytest.approx(nominal + reach, abs=1e-3)
