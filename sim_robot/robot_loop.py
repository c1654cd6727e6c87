"""The simulated robot's loop and process: sense, publish, take commands, step."""

from __future__ import annotations

import time
from collections.abc import Callable

import msgspec

from surefoot.robot_io.realtime import (
    CommandLatency,
    Pace,
    Pacer,
    StopRequest,
    TimingLog,
    quiet_interpreter,
)
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.mode_machine import CommandResult
from surefoot.robot_io.robot_side.server import NoAnswer, RobotServer
from surefoot.robot_io.ticks.recorder import TickSink
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import ModeCause
from surefoot.schemas.result import Histogram, PlantResult
from surefoot.schemas.scenario import Scenario
from surefoot.sim_robot.simulated_robot import SimulatedRobot
from surefoot.sim_robot.state_view import ground_blocks, truth_message

DEADLINE_S = 5.0
"""Longest wait for an answer in lockstep [s]."""
FIRST_DEADLINE_S = 15.0
"""The same for the first answer, while a controller may still build its model [s]."""
LAST_ANSWER_S = 0.2
"""The same after a request to end [s]. With that answer, the record is the beginning of
the whole run's record."""
TRUTH_EVERY_TICKS = 20


class RobotLoop:
    """Senses, publishes, takes commands and steps, tick after tick.

    In lockstep, tick k steps once the answer to tick k - d has come, with d the command
    delay. With d >= 1 the controller answers tick k while the plant steps tick k, and
    every run is still the same. In HOLD or FAULT nobody commands, so there is nobody to
    be in step with: the robot holds its posture, and its time follows the clock until
    it falls or someone takes over.

    Attributes:
        round_trip: durations from sensors sent to command received.
        latency: durations from sensors stamped to command applied.
        lateness: lateness of ticks that follow the clock.
    """

    def __init__(
        self,
        simulated: SimulatedRobot,
        gate: CommandGate,
        server: RobotServer,
        *,
        pace: Pace,
        period_s: float,
        on_tick: Callable[[int], None] | None = None,
    ) -> None:
        """Join plant, gate and bus."""
        self.round_trip = TimingLog()
        self.lateness = TimingLog()
        self._simulated, self._gate, self._server = simulated, gate, server
        self._ground = ground_blocks(simulated.plant.world)
        self._is_lockstep = pace is Pace.LOCKSTEP
        self._pacer = Pacer(period_s, lateness=self.lateness)
        self.latency = CommandLatency()
        self._on_tick = on_tick
        self._active_since: int | None = None
        self._is_answered = False

    def histograms(self) -> dict[str, Histogram]:
        """Return the histograms of all durations measured here, by name."""
        logs = {
            "sensors to servos": self.latency.log,
            "round trip": self.round_trip,
            "period jitter": self.lateness,
        }
        return {name: log.histogram() for name, log in logs.items() if len(log)}

    def run(self, stop: StopRequest) -> None:
        """Run until the scenario is over, the robot falls or a stop is requested."""
        self._pacer.restart()
        while not self._simulated.finished and not stop.is_set:
            self._tick(stop)

    def _tick(self, stop: StopRequest) -> None:
        simulated, server = self._simulated, self._server
        tick, now_s = simulated.tick, simulated.time_s
        self._gate.begin_tick(now_s=now_s, tick=tick)
        server.serve_requests(now_s=now_s)
        self._note_mode(tick)
        stamp_ns = time.monotonic_ns()
        snapshot = simulated.sense()
        server.publish_sensors(
            snapshot, stamp_ns=stamp_ns, missing=simulated.missing_sensors
        )
        self.latency.sensed(tick, stamp_ns=stamp_ns)
        if self._is_lockstep and self._gate.mode is RobotMode.ACTIVE:
            self._take_answer(tick, now_s, stop)
            self.latency.applied(tick)
            simulated.step()
        else:
            self._take_newest(tick, now_s)
            self.latency.applied(tick)
            simulated.step()
            self._pacer.wait()
        server.publish_status(now_s=now_s)
        if tick % TRUTH_EVERY_TICKS == 0:
            truth = truth_message(
                simulated.truth(), stamp_ns=stamp_ns, ground=self._ground
            )
            server.publish_truth(truth)
            if self._on_tick is not None:
                self._on_tick(tick)

    def _note_mode(self, tick: int) -> None:
        """Record the first ACTIVE tick, from which on answers are due."""
        if self._gate.mode is not RobotMode.ACTIVE:
            if self._is_lockstep and self._active_since is not None:
                self._pacer.restart()  # from now on time follows the clock
            self._active_since = None
        elif self._active_since is None:
            self._active_since = tick
            self._is_answered = False

    def _take_answer(self, tick: int, now_s: float, stop: StopRequest) -> None:
        """Wait for the answer that acts in this tick's step (lockstep)."""
        due = self._simulated.commands_needed(tick)
        if due is None or self._active_since is None or due < self._active_since:
            return
        answer = self._wait_answer(due, now_s, stop)
        if answer is not None:
            self._take_in(answer, acts_as=due)
        elif self._gate.mode is RobotMode.ACTIVE and not stop.is_set:
            self._server.deadline_misses += 1

    def _wait_answer(
        self, due: int, now_s: float, stop: StopRequest
    ) -> CommandResult | None:
        """Return the answer to a tick, or None; serve requests during the wait."""
        patience_s = DEADLINE_S if self._is_answered else FIRST_DEADLINE_S
        deadline = time.monotonic() + patience_s
        is_last = False
        while True:
            answer = self._server.answer(due, now_s=now_s, deadline=deadline)
            if isinstance(answer, CommandResult):
                return answer
            if answer is NoAnswer.OVERTAKEN:
                return None
            self._server.serve_requests(now_s=now_s)
            now = time.monotonic()
            if stop.is_set and not is_last:
                is_last, deadline = True, min(deadline, now + LAST_ANSWER_S)
            is_active = self._gate.mode is RobotMode.ACTIVE
            if not is_active or stop.is_urgent or now >= deadline:
                return None

    def _take_newest(self, tick: int, now_s: float) -> None:
        """Take the newest command, to act as soon as its delay is over (real time)."""
        result = self._server.take_newest(now_s=now_s)
        if result is not None:
            due = tick - self._simulated.command_delay_ticks
            self._take_in(result, acts_as=max(result.answers, due))
        elif self._is_answered and self._gate.mode is RobotMode.ACTIVE:
            self._server.deadline_misses += 1

    def _take_in(self, result: CommandResult, *, acts_as: int) -> None:
        """Pass an accepted or held posture on to the robot, and time it."""
        sent_ns = self.latency.stamp_ns(result.answers)
        self.round_trip.add(time.monotonic_ns() - sent_ns)
        self._is_answered = True
        if acts_as >= 0:
            self._simulated.apply(result.posture, tick=acts_as)
            acts_at = acts_as + self._simulated.command_delay_ticks
            self.latency.taken(result.answers, acts_at=acts_at)


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
    on_tick: Callable[[int], None] | None = None,
) -> PlantResult:
    """Run a scenario on the bus for the commander that takes the lease.

    The robot stands at tick 0, in HOLD, until a commander has enabled it. So scenarios
    begin with the commander, however long it takes to start. Sensors are published from
    then on, status from the start. The run ends with the scenario, at the tick of the
    fall, or on a signal, with a last status in mode OFF.

    Args:
        robot: the robot of the files.
        scenario: the scenario to run.
        seed: seed of the sensor noise.
        endpoints: where to listen.
        pace: lockstep or real time.
        ticks: receives the signals of every tick; None keeps none.
        histogram: whether the result contains the histograms of durations.
        wait_s: longest wait for a commander; None: no limit [s].
        on_tick: called with the tick now and then, for a progress bar.

    Returns:
        Figures over the ticks of the run, even if it was stopped or nobody came.

    Raises:
        EndpointError: Zenoh cannot listen there.
        ScenarioError: the scenario does not fit the robot or its ticks.
    """
    stop = StopRequest()
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
        is_commanded = server.wait_until_active(timeout_s=wait_s)
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
        server.see_off(commander, now_s=simulated.time_s)
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
        return msgspec.structs.replace(
            result,
            end_to_end_ms=loop.latency.log.distribution(),
            histograms=loop.histograms() if histogram else {},
        )
