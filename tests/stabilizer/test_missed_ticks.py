"""A controller that a busy machine makes miss ticks loses no time by it."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import pytest

from surefoot.controllers import make_controller
from surefoot.robot_io.client_side.client import SENSOR_MESSAGES_KEPT
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import MOST_PASSED, Snapshot
from surefoot.run_plan import make_plan
from surefoot.schemas.messages import Reference
from surefoot.schemas.reasons import Outcome
from surefoot.schemas.result import RunResult
from surefoot.simulation import Simulation
from surefoot.stabilizer.controller import ControllerOutput, HoldController

pytestmark = pytest.mark.closed_loop


class BusyMachine(Simulation):
    """A run in which some ticks get no answer; their readings come with the next one.

    Attributes:
        missed: probability of a tick to begin a train of missed ones.
        train: shortest and longest train [ticks].
    """

    missed, train = 0.1, (1, 2)

    def step(
        self, controller: Any, reference: Reference | None = None
    ) -> ControllerOutput | None:
        """Advance one tick."""
        if self.tick == 0:
            self._draw, self._left = random.Random(1), 0
            self._overtaken: list[Snapshot] = []
        elif self._left == 0 and self._draw.random() < self.missed:
            self._left = self._draw.randint(*self.train)
        if self._left:
            self._left -= 1
            self._overtaken.append(self.snapshot)
            self.gate.begin_tick(now_s=self.time_s, tick=self.tick)
            self._follow_waiting(self.tick, self.time_s)
            self.simulated.step()
            return None
        for snapshot in self._overtaken:
            assert self.safety is not None
            self.safety.pass_over(snapshot)
        self._overtaken.clear()
        return super().step(controller, reference)


def run(scenario: str, *, duration_s: float, **more: Any) -> RunResult:
    plan = make_plan(scenario, duration_s=duration_s, **more)
    busy = BusyMachine.of_plan(plan)
    busy.run(make_controller(plan.controller, plan.robot, settings=plan.settings))
    return busy.result()


@pytest.mark.usual("whole-body-10")
@pytest.mark.parametrize(("controller", "most_mm"), [("whole-body", 10), ("zmp", 28)])
def test_the_ground_is_followed_all_the_time(controller: str, most_mm: float) -> None:
    result = run("moving-platform-fast", duration_s=4.0, controller=controller)
    assert result.outcome is Outcome.STOOD
    # 27 and 36 mm if missed ticks are lost.
    assert max(result.com_error_rms_mm) < most_mm


def test_a_walk_ends_in_time_at_its_height() -> None:
    result = run("walk-flat-quick", duration_s=6.0)
    assert result.outcome is Outcome.WALKED, result.outcome_detail
    assert result.com_error_rms_mm[2] < 3.0  # 18 if missed ticks are lost


class Counting(HoldController):
    """Counts the ticks that are passed over."""

    def __init__(self, joint_count: int) -> None:
        """Begin with none."""
        super().__init__(joint_count)
        self.passed = 0

    def pass_over(self, snapshot: Snapshot) -> None:
        """Count a tick."""
        del snapshot
        self.passed += 1


@pytest.mark.parametrize(("missed", "lost"), [(0.1, False), (0.5, True)])
def test_a_machine_without_any_time_left_is_not_given_more_to_do(
    walker: Robot, missed: float, lost: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(BusyMachine, "missed", missed)
    busy, counting = BusyMachine(walker, "standing"), Counting(walker.n_a)
    while busy.time_s < 1.0:
        busy.step(counting)
    before = counting.passed
    while busy.time_s < 2.0:
        busy.step(counting)
    assert (counting.passed == before) is lost


def test_an_inbox_keeps_all_that_is_taken_in() -> None:
    assert MOST_PASSED < SENSOR_MESSAGES_KEPT


class Foreign:
    """Somebody else's controller: it knows nothing of missed ticks."""

    def __init__(self, robot: Robot) -> None:
        """Hold a posture."""
        self._inner = HoldController(robot.n_a)

    def start(self, snapshot: Snapshot, q_command: np.ndarray) -> None:
        """Begin."""
        self._inner.start(snapshot, q_command)

    def step(self, snapshot: Snapshot) -> np.ndarray:
        """Answer with the posture."""
        return self._inner.step(snapshot).q_command


def test_a_controller_that_does_not_take_them_in_goes_on_without(walker: Robot) -> None:
    busy = BusyMachine(walker, "standing")
    foreign = Foreign(walker)
    while busy.time_s < 0.1:
        busy.step(foreign)
    assert not busy.fell
    assert busy.safety is not None
    assert not busy.safety.losses
