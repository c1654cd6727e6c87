"""A new stabilizer takes over a robot that holds its posture."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import Reference
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.controller import ControllerOutput
from surefoot.stabilizer.qp import QpData
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from tests.stabilizer.closed_loop import run_closed_loop, swing

pytestmark = pytest.mark.closed_loop

LEFT_ALONE_S = 0.45
"""Time that a new process takes to command [s]; see the kill study."""
DURATION_S = 7.0
BALANCED_S = 1.45
"""Time after a takeover in which the robot finds its balance [s]."""
NEAR_M = 0.01
MOTION = [
    swing("roll", 8.6, 0.175, start_s=1.0),
    swing("pitch", 8.6, 0.127, start_s=1.0),
]
"""As on the slow platform; the robot leans by up to 12 deg at the takeover."""


class Relieved:
    """A controller that balances, is gone for a while, and is replaced."""

    name = "relieved"

    def __init__(self, robot: Robot, *, gone_at_s: float) -> None:
        self._robot = robot
        self._gone_at_s, self._time_s = gone_at_s, 0.0
        self._now = WholeBodyController(robot, ControllerSettings())
        self._is_gone = False
        self.failure: QpData | None = None

    def start(self, snapshot: Snapshot, q_command: Array) -> None:
        self._now.start(snapshot, q_command)

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        self._time_s += self._robot.period_s
        is_gone = 0.0 <= self._time_s - self._gone_at_s < LEFT_ALONE_S
        if self._is_gone and not is_gone:
            self._now = WholeBodyController(self._robot, ControllerSettings())
            self._now.start(snapshot, self._last.q_command)
        self._is_gone = is_gone
        if not is_gone:
            self._last = self._now.step(snapshot, reference)
        return self._last


@pytest.mark.usual("3.6")
@pytest.mark.parametrize("gone_at_s", [1.9, 3.6, 4.4])
def test_it_finds_its_balance_on_moving_ground(walker: Robot, gone_at_s: float) -> None:
    """On ground that turns on, or is about to turn back."""
    run = run_closed_loop(
        walker,
        controller=Relieved(walker, gone_at_s=gone_at_s),
        duration_s=DURATION_S,
        platform=[{"foot": "both", "motion": MOTION}],
    )
    assert not run.fell
    error = run.com_true - run.soles_true.mean(axis=1)
    late = run.time_s > gone_at_s + LEFT_ALONE_S + BALANCED_S
    assert np.abs(error[late, :2] - error[0, :2]).max() < NEAR_M
