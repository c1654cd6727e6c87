"""Every start of a stabilizer makes a new controller, over loopback TCP."""

from __future__ import annotations

import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from surefoot.robot_io.realtime import Pace
from surefoot.robot_io.robot import load_robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import Reference, RobotMode, RobotStatus
from surefoot.schemas.reasons import EndReason, ModeCause
from surefoot.schemas.result import ControllerResult
from surefoot.schemas.settings import ControllerSettings
from surefoot.signals import read_signals
from surefoot.stabilizer.controller import (
    Controller,
    ControllerOutput,
    HoldController,
)
from surefoot.stabilizer.node import run_stabilizer
from tests.nodes.processes import (
    Silence,
    balancing,
    looking,
    recorded_robot,
    robot,
    running,
)
from tests.nodes.test_nodes import LONG, is_running, observer
from tests.nodes.test_reconnect import (
    end_it,
    is_commanded_again,
)
from tests.patient_robot import HOLD_AFTER_S
from tests.support import PATIENCE_S, wait_until

WALKER = load_robot("walker")
NEW_GAIN = 35.0
STOPPED = (EndReason.STOPPED, "SIGTERM")
FAR_RAD = 0.3
"""Farther than a first command may be from the held posture."""
SILENT_TICK = 100
KEEPS_LEASE = partial(robot, lease_s=PATIENCE_S)
"""A robot whose commander may be silent for long without losing the lease."""
ANSWERED_TICKS = round(1.2 * HOLD_AFTER_S / WALKER.period_s)
HELD_FROM_S, RAMP_S, HELD_TO_S = 1.0, 4.0, 5.0
RECOVERED_S = 2.4
NEAR_M = 0.005
"""If one controller were started again, the CoM would be 36 mm off."""
RAMP = {
    "axis": "roll",
    "kind": "ramp",
    "amplitude_deg": 6.0,
    "rate_deg_s": 10.0,
    "start_s": RAMP_S,
}
ROLLING = {"duration_s": 600.0, "platform": [{"foot": "both", "motion": [RAMP]}]}


class Starts(NamedTuple):
    """What the controllers of a run noted.

    Attributes:
        result: result of the stabilizer.
        starts: starts of each controller, in the order in which they were made.
        gains: ``tsid.com_kp`` that each was made with.
    """

    result: ControllerResult
    starts: list[int]
    gains: list[float]


class Counting(HoldController):
    """Counts its starts; one of all may fall silent and command a far posture.

    That one need not be the first, since a robot on a busy machine may hold earlier.
    """

    def __init__(self, starts: list[int], silence: Silence | None) -> None:
        super().__init__(WALKER.n_a)
        self._starts, self._number, self._silence = starts, len(starts), silence
        self._ticks = 0
        self._is_ahead = False
        starts.append(0)

    def start(self, snapshot: Snapshot, q_command: np.ndarray) -> None:
        self._starts[self._number] += 1
        super().start(snapshot, q_command)

    def retune(self, settings: ControllerSettings) -> None:
        """Accept changed settings."""

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        self._ticks += 1
        output = super().step(snapshot, reference)
        if self._ticks == SILENT_TICK and self._silence is not None:
            self._is_ahead = self._silence.keep(snapshot.tick)
        if self._is_ahead:
            output.q_command[0] = FAR_RAD
        return output


def counted(endpoints: Endpoints, pace: Pace, silence: Silence | None = None) -> Starts:
    starts: list[int] = []
    gains: list[float] = []

    def make(settings: ControllerSettings) -> Controller:
        gains.append(settings.tsid.com_kp[0])
        return Counting(starts, silence)

    result = run_stabilizer(
        make,
        WALKER,
        endpoints=endpoints,
        pace=pace,
        identity="ann",
        connect_timeout_s=PATIENCE_S,
        reconnect=silence is None,
    )
    return Starts(result, starts, gains)


def end_once_held(silence: Silence, when: Callable[..., RobotStatus]) -> None:
    """End a silence when the robot holds because of it."""
    tick = silence.begun()
    when(lambda s: s.tick > tick and s.mode is RobotMode.HOLD, what="HOLD")
    silence.end()


def check(noted: Starts, *, starts: int) -> None:
    """Check that no controller started twice, and how many started."""
    assert set(noted.starts) <= {0, 1}
    assert sum(noted.starts) == starts


def test_a_resume_starts_another_controller_with_the_gains_of_now(
    endpoints: Endpoints,
) -> None:
    with (
        running(robot, endpoints, LONG, Pace.LOCKSTEP),  # no tick of the ramp is lost
        running(counted, endpoints, Pace.LOCKSTEP) as controller,
        observer(endpoints) as when,
        looking(endpoints) as eve,
    ):
        begun = when(is_running, what="the run")
        eve.requests.change_settings({"tsid.com_kp": [NEW_GAIN]})
        when(lambda s: s.tick > begun.tick + 700, what="the end of the ramp")
        eve.requests.control("hold")
        when(lambda s: s.mode is RobotMode.HOLD, what="the hold")
        eve.requests.control("resume")
        again = when(lambda s: s.mode is RobotMode.ACTIVE, what="the resume")
        when(
            lambda s: s.tick > again.tick + 50 and s.command_age_s >= 0.0,
            what="commands",
        )
        noted = end_it(controller)
    check(noted, starts=2)
    assert noted.gains == [30.0, NEW_GAIN]


def test_a_restart_after_a_silence_starts_another_controller(
    endpoints: Endpoints,
) -> None:
    """Though it is not told to reconnect: it has not lost the robot."""
    silence = Silence()
    with (
        running(KEEPS_LEASE, endpoints, LONG, Pace.REALTIME) as plant,
        running(counted, endpoints, Pace.REALTIME, silence) as controller,
        observer(endpoints) as when,
    ):
        end_once_held(silence, when)
        refused = when(lambda s: s.refused.get("first_command"), what="the refusal")
        active = when(
            lambda s: s.tick > refused.tick and s.mode is RobotMode.ACTIVE,
            what="command of the robot",
        )
        # It would hold by then if the other controller had not answered.
        when(
            lambda s: s.tick > active.tick + ANSWERED_TICKS and s.mode is active.mode,
            what="answers of the other controller",
        )
        noted = end_it(controller)
        plant.signal(signal.SIGTERM)
        assert not plant.result().fell
    assert (noted.result.end, noted.result.end_detail) == STOPPED
    assert noted.result.restarts >= 1
    check(noted, starts=1 + noted.result.restarts)


@pytest.mark.parametrize(
    ("sent", "pace"),
    [(signal.SIGKILL, Pace.LOCKSTEP), (signal.SIGTERM, Pace.REALTIME)],
)
def test_a_robot_that_is_back_meets_another_controller(
    endpoints: Endpoints, sent: int, pace: Pace
) -> None:
    with running(counted, endpoints, pace) as controller:
        with running(robot, endpoints, LONG, pace) as first:
            with observer(endpoints) as when:
                when(is_running, what="the first robot's run")
            first.signal(sent)
            first.process.join(PATIENCE_S)
        with (
            running(robot, endpoints, LONG, pace) as second,
            observer(endpoints) as when,
        ):
            when(is_commanded_again, what="command of the second robot")
            noted = end_it(controller)
            held = when(lambda s: s.mode is RobotMode.HOLD, what="HOLD")
            assert held.cause is ModeCause.RELEASED
            assert held.commander == ""
            second.signal(signal.SIGTERM)
            # At most the last command, which hold or release have overtaken.
            assert set(second.result().refused) <= {"mode", "lease"}
    assert (noted.result.end, noted.result.end_detail) == STOPPED
    assert noted.result.restarts == 1
    check(noted, starts=2)


def test_held_while_the_ground_rolls_it_stands_upright_after_the_resume(
    endpoints: Endpoints, tmp_path: Path
) -> None:
    """The calibration of the first start, on level ground, must not count any more."""
    with (
        running(recorded_robot, endpoints, ROLLING, tmp_path / "ticks.mcap") as plant,
        running(balancing, endpoints),
        looking(endpoints) as eve,
    ):

        def at(time_s: float) -> None:
            def is_there() -> bool:
                status = eve.latest_messages().status
                return status is not None and status.tick * WALKER.period_s >= time_s

            wait_until(is_there, what=f"{time_s} s of the run")

        at(HELD_FROM_S)
        held_s = eve.requests.control("hold").tick * WALKER.period_s
        at(HELD_TO_S)
        resumed_s = eve.requests.control("resume").tick * WALKER.period_s
        recovered_s = resumed_s + RECOVERED_S
        at(recovered_s)
        plant.signal(signal.SIGTERM)
        run = plant.result()
    assert held_s < RAMP_S
    assert not run.fell
    signals = read_signals(tmp_path / "ticks.mcap")
    soles = signals["true_sole_left"] + signals["true_sole_right"]
    over_feet = signals["true_com"] - 0.5 * soles
    row = round(recovered_s / WALKER.period_s)
    error = over_feet[row, :2] - over_feet[0, :2]
    assert np.abs(error).max() < NEAR_M
