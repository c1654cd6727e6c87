"""Robot and stabilizer as two processes over loopback TCP."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.bus.channel import Latest
from surefoot.robot_io.bus.session import Role
from surefoot.robot_io.realtime import Pace
from surefoot.robot_io.robot import load_robot
from surefoot.robot_io.ticks.recorder import BLOCK_TICKS, Block, BlockFormat
from surefoot.runs import simulate
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import (
    RobotMode,
    RobotStatus,
)
from surefoot.schemas.reasons import EndReason, ModeCause
from surefoot.schemas.result import ControllerResult
from surefoot.schemas.scenario import scenario_from_table
from surefoot.schemas.topics import topic
from surefoot.stabilizer import loop
from surefoot.stabilizer.controller import HoldController
from surefoot.stabilizer.node import run_stabilizer
from tests.nodes.processes import (
    NOISE,
    SEED,
    ProcessError,
    balancing,
    robot,
    running,
    stabilizer,
)
from tests.support import PATIENCE_S, wait_until

SHORT = {"duration_s": 0.5, "sensors": NOISE}
LONG = {"duration_s": 600.0}
BALANCING_TICK = 1500
SINE = {
    "axis": "roll",
    "kind": "sine",
    "amplitude_deg": 4.0,
    "frequency_hz": 0.5,
    "start_s": 1.0,
}


@contextmanager
def observer(endpoints: Endpoints) -> Iterator[Callable[..., RobotStatus]]:
    """Wait for a status that fulfils a condition."""
    with Bus(endpoints, Role.CLIENT, namespace="walker", timeout_s=PATIENCE_S) as bus:
        latest = Latest(bus.channel(topic("status").key, depth=1), RobotStatus)

        def when(condition: Callable[[RobotStatus], bool], *, what: str) -> RobotStatus:
            def look() -> RobotStatus | None:
                status = latest.poll()
                return status if status and condition(status) else None

            status = wait_until(look, what=what)
            assert status is not None
            return status

        yield when


def is_running(status: RobotStatus) -> bool:
    return status.mode is RobotMode.ACTIVE and status.tick > 20


def in_one_process(table: dict, controller: str = "hold") -> str:
    """Return the hash of the same run without a bus."""
    walker = load_robot("walker")
    scenario = scenario_from_table({"name": "test", **table}, source="test")
    run = simulate(walker, scenario, controller=controller, seed=SEED, record=False)
    return run.result.log_sha256


def held_up_before_the_last_tick(endpoints: Endpoints) -> ControllerResult:
    """A stabilizer that is late at the last tick and finds the robot off."""
    walker = load_robot("walker")
    # It looks as often as a block is full, which is when the sink holds it up.
    loop.STATUS_RATE_HZ = 1.0 / (BLOCK_TICKS * walker.period_s)

    class Busy:
        """A sink that writes its block only when the robot is off."""

        def open(self, form: BlockFormat) -> Block:
            return Block(form.width)

        def put(self, block: Block) -> Block:
            when(lambda s: s.mode is RobotMode.OFF, what="the end")
            return Block(block.rows.shape[1])

    with observer(endpoints) as when:
        return run_stabilizer(
            lambda settings: HoldController(walker.n_a),
            walker,
            endpoints=endpoints,
            pace=Pace.LOCKSTEP,
            connect_timeout_s=PATIENCE_S,
            ticks=Busy(),
        )


def test_the_last_ticks_are_answered_though_the_robot_waits_for_no_answer(
    endpoints: Endpoints,
) -> None:
    table = {
        "duration_s": (BLOCK_TICKS + 1) * 1e-3,
        "delay": {"command_ms": 1.0},
    }
    with (
        running(robot, endpoints, table, Pace.LOCKSTEP) as plant,
        running(held_up_before_the_last_tick, endpoints) as controller,
    ):
        run, answered = plant.result(), controller.result()
    assert run.ticks == answered.ticks == BLOCK_TICKS + 1
    assert answered.end is EndReason.RUN_OVER


def test_an_interrupted_run_is_the_beginning_of_the_whole_one(
    endpoints: Endpoints,
) -> None:
    moving = {"foot": "both", "motion": [SINE]}
    table = {**LONG, "sensors": NOISE, "platform": [moving]}
    with (
        running(robot, endpoints, table, Pace.LOCKSTEP) as plant,
        running(balancing, endpoints) as controller,
        observer(endpoints) as when,
    ):
        when(lambda status: status.tick > BALANCING_TICK, what="balancing")
        plant.signal(signal.SIGTERM)
        run, answered = plant.result(), controller.result()
    assert run.ticks == answered.ticks > BALANCING_TICK
    as_long = {"duration_s": run.ticks * 1e-3}
    assert run.log_sha256 == in_one_process(table | as_long, "whole-body")


def test_real_time_goes_by_the_clock_and_measures_itself(endpoints: Endpoints) -> None:
    with (
        running(robot, endpoints, SHORT, Pace.REALTIME) as plant,
        running(stabilizer, endpoints, Pace.REALTIME) as controller,
    ):
        run, answered = plant.result(), controller.result()
    assert run.ticks == 500
    assert not run.fell
    assert 0.0 < run.real_time_factor < 1.05
    assert run.round_trip_ms.median > 0.0
    assert run.period_jitter_ms.max > 0.0
    assert 0 < answered.ticks <= 500


def test_the_stabilizer_says_that_a_killed_robot_is_gone(endpoints: Endpoints) -> None:
    with (
        running(robot, endpoints, LONG, Pace.LOCKSTEP) as plant,
        observer(endpoints) as when,
        running(stabilizer, endpoints, Pace.LOCKSTEP) as controller,
    ):
        when(is_running, what="the run")
        plant.kill()
        assert controller.result().end is EndReason.ROBOT_GONE
        assert controller.exit_code() == 0


def test_a_stopped_robot_says_so_to_its_stabilizer(endpoints: Endpoints) -> None:
    with running(robot, endpoints, LONG, Pace.REALTIME) as plant:
        with (
            running(stabilizer, endpoints, Pace.REALTIME) as controller,
            observer(endpoints) as when,
        ):
            when(is_running, what="the run")
            plant.signal(signal.SIGTERM)
            told = controller.result()
            assert told.end is EndReason.ROBOT_ENDED
            assert told.end_detail == "stopped: SIGTERM"
        assert plant.result().end is ModeCause.STOPPED


def test_a_hung_stabilizer_is_given_up_and_finds_out(endpoints: Endpoints) -> None:
    with (
        running(robot, endpoints, LONG, Pace.REALTIME),
        running(stabilizer, endpoints, Pace.REALTIME) as controller,
        observer(endpoints) as when,
    ):
        when(is_running, what="the run")
        controller.signal(signal.SIGSTOP)
        when(lambda s: s.mode is not RobotMode.ACTIVE, what="HOLD or FAULT")
        when(lambda s: s.commander == "", what="the lease to be free")
        controller.signal(signal.SIGCONT)
        assert controller.result().end in (
            EndReason.LEASE_LOST,
            EndReason.ROBOT_FAULT,
            EndReason.ROBOT_GONE,
        )


def test_a_stabilizer_at_another_pace_is_told_which_one(endpoints: Endpoints) -> None:
    with (
        running(robot, endpoints, LONG, Pace.REALTIME),
        running(stabilizer, endpoints, Pace.LOCKSTEP) as controller,
        pytest.raises(
            ProcessError, match=r"this command in lockstep; give it --realtime"
        ),
    ):
        controller.result()
