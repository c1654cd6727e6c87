"""A stabilizer waits for a robot that went away, over loopback TCP."""

from __future__ import annotations

import signal
from typing import Any

import pytest

from surefoot.robot_io.realtime import Pace, StopRequest
from surefoot.robot_io.robot import load_robot
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.server import RobotServer
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode, RobotStatus
from surefoot.schemas.reasons import EndReason, ModeCause, StabilizerState
from surefoot.schemas.settings import ControllerSettings, SafetySettings
from surefoot.stabilizer.controller import HoldController
from surefoot.stabilizer.node import run_stabilizer
from tests.nodes.processes import ProcessError, Running, looking, robot, running
from tests.nodes.test_nodes import LONG, is_running, observer
from tests.robot_io.served_robot import serving
from tests.robot_io.strange_robots import MIRRORED
from tests.support import PATIENCE_S, wait_until

WALKER = load_robot("walker")
LONG_LEAVE_S = 120.0


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


def end_it(controller: Running) -> Any:
    controller.signal(signal.SIGTERM)
    return controller.result()


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


def test_a_robot_that_goes_before_it_answers_is_waited_for(
    endpoints: Endpoints,
) -> None:
    gate = CommandGate(WALKER, WALKER.nominal)
    with running(faithful, endpoints, Pace.REALTIME) as controller:
        with RobotServer(
            WALKER, gate, endpoints=endpoints, stop=StopRequest()
        ) as server:
            asked = server._services._asked  # nobody serves it
            wait_until(lambda: bool(asked), what="a request for the lease")
        with (
            running(robot, endpoints, LONG, Pace.REALTIME),
            observer(endpoints) as when,
        ):
            when(is_commanded_again, what="command of the next robot")
            assert end_it(controller).restarts == 0


def test_it_ends_while_it_waits_for_the_robot(endpoints: Endpoints) -> None:
    with running(faithful, endpoints, Pace.LOCKSTEP) as controller:
        with (
            running(robot, endpoints, LONG, Pace.LOCKSTEP) as plant,
            observer(endpoints) as when,
        ):
            when(is_running, what="the run")
            plant.kill()
        assert end_it(controller).end in (EndReason.STOPPED, EndReason.ROBOT_GONE)


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
