"""Motion caused by a false force is taken back when the force lasts too long."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import Reference
from surefoot.schemas.reasons import SensorTrouble, StabilizerState
from surefoot.schemas.settings import ControllerSettings, SafetySettings
from surefoot.stabilizer.controller import ControllerOutput
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.qp import QpData
from surefoot.stabilizer.safety.health import FRESH
from surefoot.stabilizer.safety.safety import Safety
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from tests.stabilizer.closed_loop import NOISE
from tests.stabilizer.standing_snapshot import standing_snapshot
from tests.stabilizer.watched_run import watched_run

FEET = ("left_ankle_ft", "right_ankle_ft")
FALSE_N = 2500.0
SWAY_MM = 30.0
"""Largest sway that is allowed; without the correction it falls after 1.6 s."""
STEP_RAD = 0.001
OVERLOAD_TICKS = round(SafetySettings().overload_after_s / 0.001) + 1


@pytest.mark.closed_loop
@pytest.mark.parametrize(
    ("sensor", "policy"), [("left_ankle_ft", "degrade"), ("right_ankle_ft", "hold")]
)
def test_a_false_force_that_lasts_does_not_fell_the_standing_robot(
    walker: Robot, sensor: str, policy: Literal["degrade", "hold"]
) -> None:
    jump = {"sensor": sensor, "kind": "jump", "size": FALSE_N}
    run = watched_run(
        walker,
        safety_settings=SafetySettings(ft_lost=policy),
        duration_s=3.5,
        fault=[{**jump, "start_s": 1.2, "duration_s": 10.0}],
    )
    assert run.losses == {sensor: SensorTrouble.OVERLOADED}
    assert not run.fell
    assert run.com_error_max_mm is not None
    assert max(run.com_error_max_mm) < SWAY_MM


class Creeping:
    """A controller that moves on steadily, and notes what it is asked."""

    name = "creeping"
    failure: QpData | None = None

    def __init__(self, joint_count: int) -> None:
        self.q: Array = np.zeros(joint_count)
        self.asked: list[tuple[Array, int, tuple[bool, bool]]] = []

    def start(self, snapshot: Snapshot, q_command: Array) -> None:
        del snapshot
        self.q = q_command.copy()

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        del snapshot, reference
        self.q = self.q + STEP_RAD
        return ControllerOutput(self.q)

    def degrade(self, lost: tuple[bool, bool]) -> None:
        del lost

    def undo_overload(
        self, q_command: Array, *, ticks: int, sides: tuple[bool, bool]
    ) -> None:
        self.asked.append((q_command, ticks, sides))


def feed(safety: Safety, reading: Snapshot, *, ticks: int) -> ControllerOutput:
    """Feed a number of ticks of a reading, each slightly different."""
    rng = np.random.default_rng(5)
    for _ in range(ticks):
        noise = NOISE["force_noise_n"] * rng.standard_normal(6)
        left, right = reading.ft_left + noise, reading.ft_right - noise
        gyro = reading.angular_velocity + 1e-4 * rng.standard_normal(3)
        dq = reading.dq + 1e-4 * rng.standard_normal(len(reading.dq))
        noisy = replace(
            reading, ft_left=left, ft_right=right, angular_velocity=gyro, dq=dq
        )
        output = safety.step(noisy, FRESH)
    return output


def overloaded(reading: Snapshot) -> Snapshot:
    """Return the sensors with a false force on the right foot."""
    offset = np.array([0.0, 0.0, FALSE_N, 0.0, 0.0, 0.0])
    return replace(reading, ft_right=reading.ft_right + offset)


def watched(
    walker: Robot, policy: Literal["degrade", "hold"]
) -> tuple[Safety, Creeping, Snapshot]:
    controller = Creeping(walker.n_a)
    safety = Safety(controller, walker, SafetySettings(ft_lost=policy))
    reading = standing_snapshot(RobotModel(walker))
    safety.start(reading, walker.nominal)
    feed(safety, reading, ticks=20)
    return safety, controller, reading


def test_the_controller_is_told_the_command_before_and_how_long_it_was_misled(
    walker: Robot,
) -> None:
    safety, controller, reading = watched(walker, "degrade")
    before = controller.q.copy()
    feed(safety, overloaded(reading), ticks=OVERLOAD_TICKS + 5)
    assert safety.state is StabilizerState.DEGRADED
    [(q_command, ticks, sides)] = controller.asked
    np.testing.assert_array_equal(q_command, before)
    assert ticks == OVERLOAD_TICKS
    assert sides == (False, True)


def test_the_second_foot_to_lie_is_not_taken_back_to_the_first_ones_time(
    walker: Robot,
) -> None:
    safety, _, reading = watched(walker, "degrade")
    feed(safety, overloaded(reading), ticks=OVERLOAD_TICKS + 200)
    both = overloaded(reading)
    both = replace(both, ft_left=both.ft_left + (both.ft_right - reading.ft_right))
    before = feed(safety, overloaded(reading), ticks=1).q_command.copy()
    output = feed(safety, both, ticks=OVERLOAD_TICKS + 100)
    assert safety.state is StabilizerState.HELD
    np.testing.assert_allclose(output.q_command, before, atol=1e-9)


def test_an_impact_is_nothing_to_take_back(walker: Robot) -> None:
    safety, controller, reading = watched(walker, "degrade")
    feed(safety, overloaded(reading), ticks=OVERLOAD_TICKS - 5)
    feed(safety, reading, ticks=50)
    assert safety.state is StabilizerState.ACTIVE
    assert controller.asked == []


def test_a_held_robot_comes_to_rest_where_it_was_before(walker: Robot) -> None:
    safety, controller, reading = watched(walker, "hold")
    before = controller.q.copy()
    feed(safety, overloaded(reading), ticks=OVERLOAD_TICKS)
    output = feed(safety, overloaded(reading), ticks=100)
    assert safety.state is StabilizerState.HELD
    np.testing.assert_allclose(output.q_command, before, atol=1e-9)


def test_the_whole_body_controller_returns_as_fast_as_it_went(walker: Robot) -> None:
    controller = WholeBodyController(walker, ControllerSettings())
    reading = standing_snapshot(RobotModel(walker))
    controller.start(reading, walker.nominal)
    before = controller.step(reading).q_command.copy()
    controller.undo_overload(before + 0.01, ticks=10, sides=(True, False))
    first = controller.step(reading).q_command.copy()
    np.testing.assert_allclose(first - before, 0.001, atol=1e-4)
    for _ in range(20):
        last = controller.step(reading).q_command
    np.testing.assert_allclose(last - before, 0.01, atol=1e-3)
