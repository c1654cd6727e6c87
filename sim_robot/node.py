"""The simulated robot as a process on the bus."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import msgspec

from surefoot.robot_io.bus.stop_request import StopRequest
from surefoot.robot_io.realtime import Pace, quiet_interpreter
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.server import RobotServer
from surefoot.robot_io.ticks.recorder import TickSink
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.reasons import ModeCause
from surefoot.schemas.result import PlantResult
from surefoot.schemas.scenario import Scenario
from surefoot.sim_robot.robot_loop import RobotLoop
from surefoot.sim_robot.simulated_robot import SimulatedRobot


@dataclass(frozen=True)
class RobotRun:
    """What a run of the simulated robot left behind.

    Attributes:
        result: figures of the run, over the ticks there were.
    """

    result: PlantResult


def run_robot(
    robot: Robot,
    scenario: Scenario,
    *,
    seed: int,
    endpoints: Endpoints,
    pace: Pace,
    ticks: TickSink | None = None,
    histogram: bool = False,
    wait_s: float | None = None,
    stop: StopRequest | None = None,
    on_tick: Callable[[int], None] | None = None,
) -> RobotRun:
    """Run a scenario on the bus for the commander that takes the lease.

    The robot stands at tick 0, in HOLD, until a commander has enabled it: scenarios
    begin with the commander, however long it takes to come up. Sensors are published
    from then on; status is from the start. The run ends with the scenario, at the
    tick of the fall, or on SIGINT or SIGTERM, with a last status in mode OFF.

    Args:
        robot: what its files say.
        scenario: the run.
        seed: of the sensor noise.
        endpoints: where to listen.
        pace: lockstep or real time.
        ticks: gets the signals of every tick; None keeps none.
        histogram: whether the result holds those of the times.
        wait_s: how long to wait for a commander; None for ever [s].
        stop: ends the run from outside, besides signals.
        on_tick: called with the tick now and then, for a progress bar.

    Returns:
        The run; also when it was stopped or nobody came.

    Raises:
        EndpointError: cannot listen there.
        ScenarioError: the scenario fits neither the robot nor its ticks.
    """
    stop = stop or StopRequest()
    simulated = SimulatedRobot(robot, scenario, seed=seed, ticks=ticks)
    gate = CommandGate(robot, simulated.held_posture)
    with (
        stop.on_signals(),
        RobotServer(
            robot, gate, endpoints=endpoints, stop=stop, pace=pace, push=simulated.push
        ) as server,
    ):
        loop = RobotLoop(
            simulated,
            gate,
            server,
            pace=pace,
            period_s=robot.period_s,
            on_tick=on_tick,
        )
        is_commanded = server.wait_until_active(now_s=0.0, timeout_s=wait_s)
        begin_s = time.monotonic()
        if is_commanded:
            with quiet_interpreter():
                loop.run(stop)
        elapsed_s = time.monotonic() - begin_s
        cut_off: tuple[ModeCause, str] | None = None
        if not simulated.finished:
            cut_off = ModeCause.NO_COMMANDER, "nobody took command in time"
            if stop.is_set:
                cut_off = ModeCause.STOPPED, stop.cause
        report, commander = gate.report(), gate.modes.lease.holder
        gate.modes.finish(*(cut_off or simulated.own_end))
        server.publish_status(now_s=simulated.time_s, at_once=True)
        server.see_off(commander)
        result = simulated.result(
            real_time_factor=simulated.time_s / elapsed_s if elapsed_s else 0.0,
            round_trip_ms=loop.round_trip.distribution(),
            period_jitter_ms=loop.lateness.distribution(),
            deadline_misses=server.deadline_misses,
            refused=dict(gate.refused),
            clipped=dict(gate.clipped),
            gate=report,
            cut_off=cut_off,
        )
        return RobotRun(
            result=msgspec.structs.replace(
                result,
                end_to_end_ms=loop.latency.log.distribution(),
                histograms=loop.histograms() if histogram else {},
            ),
        )
