"""A stabilizer that waits for a robot that went away, over loopback TCP."""

from __future__ import annotations

import signal
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from surefoot.robot_io.realtime import Pace
from surefoot.robot_io.robot import load_robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import Reference, RobotMode, RobotStatus
from surefoot.schemas.reasons import EndReason, ModeCause, StabilizerState
from surefoot.schemas.settings import ControllerSettings, SafetySettings
from surefoot.stabilizer.control.controller import ControllerOutput, HoldController
from surefoot.stabilizer.node import run_stabilizer
from tests.nodes.processes import ProcessError, Running, Silence, robot, running
from tests.nodes.test_nodes import LONG, is_running, observer
from tests.nodes.test_requests import looking
from tests.robot_io.served_robot import serving
from tests.robot_io.strange_robots import MIRRORED
from tests.support import PATIENCE_S, wait_until

WALKER = load_robot("walker")
FAR_RAD = 0.3
"""Beyond what a first command may be away from the held posture."""
SILENT_TICK = 100
LONG_LEAVE_S = 120.0
KEEPS_LEASE = partial(robot, lease_s=PATIENCE_S)
"""A robot whose commander may be silent for long and still is its commander."""


class HiccupController(HoldController):
    """One of them falls silent for a while, then asks for a posture far away.

    It is not always the first: a robot on a busy machine may have held before.
    """

    def __init__(self, joint_count: int, silence: Silence) -> None:
        super().__init__(joint_count)
        self._silence = silence
        self._ticks = 0
        self._is_ahead = False

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        self._ticks += 1
        if self._ticks == SILENT_TICK:
            self._is_ahead = self._silence.keep(snapshot.tick)
        output = super().step(snapshot, reference)
        if self._is_ahead:
            output.q_command[0] = FAR_RAD
        return output


def faithful(endpoints: Endpoints, pace: Pace) -> Any:
    return run_stabilizer(
        lambda settings: HoldController(WALKER.n_a),
        WALKER,
        endpoints=endpoints,
        pace=pace,
        identity="ann",
        connect_timeout_s=PATIENCE_S,
        reconnect=True,
    )


def hiccuping(endpoints: Endpoints, silence: Silence) -> Any:
    return run_stabilizer(
        lambda settings: HiccupController(WALKER.n_a, silence),
        WALKER,
        endpoints=endpoints,
        pace=Pace.REALTIME,
        identity="ann",
        connect_timeout_s=PATIENCE_S,
    )


def slow_to_leave(endpoints: Endpoints) -> Any:
    return run_stabilizer(
        lambda settings: HoldController(WALKER.n_a),
        WALKER,
        endpoints=endpoints,
        pace=Pace.LOCKSTEP,
        identity="ann",
        connect_timeout_s=PATIENCE_S,
        settings=ControllerSettings(safety=SafetySettings(leave_s=LONG_LEAVE_S)),
    )


def is_commanded_again(status: RobotStatus) -> bool:
    return is_running(status) and status.commander == "ann-2"


def end_once_held(silence: Silence, when: Callable[..., RobotStatus]) -> None:
    """End a silence when the robot holds for it."""
    tick = silence.begun()
    when(lambda s: s.tick > tick and s.mode is RobotMode.HOLD, what="HOLD")
    silence.end()


def end_it(controller: Running) -> Any:
    controller.signal(signal.SIGTERM)
    return controller.result()


@pytest.mark.parametrize(
    ("sent", "pace"),
    [(signal.SIGKILL, Pace.LOCKSTEP), (signal.SIGTERM, Pace.REALTIME)],
)
def test_it_takes_over_again_when_the_robot_is_back(
    endpoints: Endpoints, sent: int, pace: Pace
) -> None:
    with running(faithful, endpoints, pace) as controller:
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
            result = end_it(controller)
            held = when(lambda s: s.mode is RobotMode.HOLD, what="HOLD")
            assert held.cause is ModeCause.RELEASED
            assert held.commander == ""
            second.signal(signal.SIGTERM)
            # At most the last command, which hold or release have overtaken.
            assert set(second.result().refused) <= {"mode", "lease"}
    assert (result.end, result.end_detail) == (EndReason.STOPPED, "SIGTERM")
    assert result.restarts == 1


def test_it_refuses_another_robot_in_the_place_of_its_own(
    endpoints: Endpoints,
) -> None:
    with running(faithful, endpoints, Pace.LOCKSTEP) as controller:
        with running(robot, endpoints, LONG, Pace.LOCKSTEP) as first:
            with observer(endpoints) as when:
                when(is_running, what="the first robot's run")
            first.kill()
        with serving(MIRRORED, endpoints) as strange:
            words = r"RobotMismatchError.*differs in: joints, feet"
            with pytest.raises(ProcessError, match=words):
                controller.result()
            assert strange.do(lambda server, gate: gate.modes.lease.holder) == ""


def test_it_does_not_come_back_to_a_robot_that_was_stopped_by_hand(
    endpoints: Endpoints,
) -> None:
    with (
        running(robot, endpoints, LONG, Pace.REALTIME),
        running(faithful, endpoints, Pace.REALTIME) as controller,
        observer(endpoints) as when,
        looking(endpoints) as eve,
    ):
        when(is_running, what="the run")
        eve.requests.stop_robot()
        result = controller.result()
    assert result.end is EndReason.ROBOT_FAULT
    assert result.restarts == 0


def test_it_takes_over_again_after_a_silence_of_its_own(endpoints: Endpoints) -> None:
    with (
        running(robot, endpoints, LONG, Pace.REALTIME),
        running(faithful, endpoints, Pace.REALTIME) as controller,
        observer(endpoints) as when,
    ):
        when(is_running, what="the run")
        controller.signal(signal.SIGSTOP)
        left = when(lambda s: s.commander == "", what="the lease to be free")
        assert left.mode is RobotMode.HOLD
        controller.signal(signal.SIGCONT)
        when(is_commanded_again, what="command of the robot again")
        assert end_it(controller).restarts >= 1


def test_it_ends_while_it_waits_for_the_robot(endpoints: Endpoints) -> None:
    with running(faithful, endpoints, Pace.LOCKSTEP) as controller:
        with (
            running(robot, endpoints, LONG, Pace.LOCKSTEP) as plant,
            observer(endpoints) as when,
        ):
            when(is_running, what="the run")
            plant.kill()
        assert end_it(controller).end in (EndReason.STOPPED, EndReason.ROBOT_GONE)


def test_a_robot_that_holds_for_late_commands_is_taken_up_from_its_posture(
    endpoints: Endpoints,
) -> None:
    silence = Silence()
    with (
        running(KEEPS_LEASE, endpoints, LONG, Pace.REALTIME) as plant,
        running(hiccuping, endpoints, silence) as controller,
        observer(endpoints) as when,
    ):
        end_once_held(silence, when)
        refused = when(lambda s: s.refused.get("first_command"), what="the refusal")
        when(
            lambda s: s.tick > refused.tick and s.mode is RobotMode.ACTIVE,
            what="command of the robot",
        )
        result = end_it(controller)
        plant.signal(signal.SIGTERM)
        run = plant.result()
    assert (result.end, result.end_detail) == (EndReason.STOPPED, "SIGTERM")
    assert result.restarts >= 1
    assert not run.fell


def test_a_second_signal_ends_it_at_once(endpoints: Endpoints) -> None:
    with (
        running(robot, endpoints, LONG, Pace.LOCKSTEP),
        running(slow_to_leave, endpoints) as controller,
        observer(endpoints) as when,
        looking(endpoints) as eve,
    ):
        when(is_running, what="the run")
        controller.signal(signal.SIGINT)

        def is_leaving() -> bool:
            told = eve.latest_messages().stabilizer
            return told is not None and told.state is StabilizerState.SOFT_STOP

        wait_until(is_leaving, what="the stabilizer to leave")
        status = when(lambda s: True, what="a status")
        controller.signal(signal.SIGINT)
        assert controller.result().end is EndReason.STOPPED
        held = when(lambda s: s.mode is RobotMode.HOLD, what="HOLD")
        assert held.cause is ModeCause.COMMANDER_GONE
        assert held.tick - status.tick < LONG_LEAVE_S / WALKER.period_s
