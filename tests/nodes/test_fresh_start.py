"""Every start of a stabilizer has a controller of its own, over loopback TCP."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import NamedTuple

import numpy as np

from surefoot.robot_io.realtime import Pace
from surefoot.robot_io.robot import load_robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.robot_io.ticks.write import TickFile
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import Reference, RobotMode
from surefoot.schemas.result import ControllerResult, PlantResult
from surefoot.schemas.scenario import scenario_from_table
from surefoot.schemas.settings import ControllerSettings
from surefoot.signals import read_signals
from surefoot.sim_robot.robot_loop import run_robot
from surefoot.stabilizer.control.controller import (
    Controller,
    ControllerOutput,
    HoldController,
)
from surefoot.stabilizer.node import run_stabilizer
from tests.nodes.processes import SEED, Silence, balancing, robot, running
from tests.nodes.test_nodes import LONG, is_running, observer
from tests.nodes.test_reconnect import (
    FAR_RAD,
    KEEPS_LEASE,
    SILENT_TICK,
    end_once_held,
    is_commanded_again,
)
from tests.nodes.test_requests import looking
from tests.patient_robot import HOLD_AFTER_S
from tests.support import PATIENCE_S, wait_until

WALKER = load_robot("walker")
NEW_GAIN = 35.0
ANSWERED_TICKS = round(1.2 * HOLD_AFTER_S / WALKER.period_s)
HELD_FROM_S, RAMP_S, HELD_TO_S = 1.0, 4.0, 5.0
RECOVERED_S = 2.4
NEAR_M = 0.005
"""The same object started again leaves 36 mm here."""
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
        result: of the stabilizer.
        starts: how often each controller was started, in the order they were made.
        gains: ``tsid.com_kp`` that each was made with.
    """

    result: ControllerResult
    starts: list[int]
    gains: list[float]


class Counting(HoldController):
    """Counts its starts; one of all may fall silent, and ask for a posture far away."""

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
        """So that gains may be changed."""

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
        reconnect=True,
    )
    return Starts(result, starts, gains)


def check(noted: Starts, *, starts: int) -> None:
    """Nobody was started twice; one that was not started is the next in line."""
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
        controller.signal(signal.SIGTERM)
        noted = controller.result()
    check(noted, starts=2)
    assert noted.gains == [30.0, NEW_GAIN]


def test_a_restart_after_a_silence_starts_another_controller(
    endpoints: Endpoints,
) -> None:
    silence = Silence()
    with (
        running(KEEPS_LEASE, endpoints, LONG, Pace.REALTIME),
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
        controller.signal(signal.SIGTERM)
        noted = controller.result()
    assert noted.result.restarts >= 1
    check(noted, starts=1 + noted.result.restarts)


def test_a_robot_that_is_back_meets_another_controller(endpoints: Endpoints) -> None:
    with running(counted, endpoints, Pace.LOCKSTEP) as controller:
        with running(robot, endpoints, LONG, Pace.LOCKSTEP) as first:
            with observer(endpoints) as when:
                when(is_running, what="the first robot's run")
            first.kill()
        with (
            running(robot, endpoints, LONG, Pace.LOCKSTEP),
            observer(endpoints) as when,
        ):
            when(is_commanded_again, what="command of the second robot")
            controller.signal(signal.SIGTERM)
            noted = controller.result()
    assert noted.result.restarts == 1
    check(noted, starts=2)


def recorded(endpoints: Endpoints, record: Path) -> PlantResult:
    scenario = scenario_from_table({"name": "rolling", **ROLLING}, source="test")
    with TickFile(record, may_wait=True) as ticks:
        return run_robot(
            WALKER,
            scenario,
            seed=SEED,
            endpoints=endpoints,
            pace=Pace.LOCKSTEP,
            ticks=ticks,
            wait_s=PATIENCE_S,
        )


def test_held_while_the_ground_rolls_it_stands_upright_after_the_resume(
    endpoints: Endpoints, tmp_path: Path
) -> None:
    """The calibration of the first start, on level ground, must not count any more."""
    with (
        running(recorded, endpoints, tmp_path / "ticks.mcap") as plant,
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
