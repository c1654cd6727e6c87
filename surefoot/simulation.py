"""A run without the bus: plant, gate and controller in one process, tick by tick.

Sensors, commands, gate and delays are those of lockstep on the bus, in the same order.
The run is the same bit for bit. Notebooks, tests and ``surefoot.runs`` use it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from surefoot.errors import UsageError
from surefoot.outcome import Sides, join_result
from surefoot.robot_io.realtime import StopRequest, quiet_interpreter
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.snapshot import Delivery, Snapshot
from surefoot.robot_io.ticks.recorder import MemoryTicks
from surefoot.run_folder import QP_FAILURE
from surefoot.run_plan import RunPlan, Settings, make_plan
from surefoot.schemas.messages import SCHEMA_VERSION, JointCommand, Reference
from surefoot.schemas.reasons import EndReason, ModeCause
from surefoot.schemas.result import (
    NO_TIME,
    ControllerResult,
    Distribution,
    PlantResult,
    RunResult,
)
from surefoot.schemas.scenario import Scenario
from surefoot.signals import Signals, TickSinks, memory_sinks
from surefoot.sim_robot.catalogue import naming_scenario
from surefoot.sim_robot.simulated_robot import SimulatedRobot
from surefoot.sim_robot.state_view import PlantTruth
from surefoot.stabilizer.controller import ControllerOutput
from surefoot.stabilizer.foreign import adapt
from surefoot.stabilizer.loop import told_end
from surefoot.stabilizer.qp import save_failure
from surefoot.stabilizer.safety.safety import Safety
from surefoot.stabilizer.telemetry import ControllerTelemetry, recorder_to

COMMANDER = "inline"


class Simulation:
    """A robot in a scenario that any controller advances tick by tick.

    ::

        sim = Simulation("walker", "standing", seed=0)
        controller = make_controller("whole-body", sim.robot)
        while not sim.finished:
            sim.step(controller)
        print(sim.result().outcome)

    Attributes:
        plan: robot, scenario, settings and seed, resolved.
        goes_on: whether a controller that raises is given up in order, as on the bus;
            otherwise its exception ends the simulation.
        simulated: the robot with its plant; for reading.
        gate: the command gate between controller and servos; for reading.
    """

    def __init__(
        self,
        robot: str | Path | Robot = "walker",
        scenario: str | Path | Scenario = "standing",
        *,
        servo_profile: str | None = None,
        settings: Settings = None,
        seed: int = 0,
        record: bool = False,
    ) -> None:
        """Build the plant; it stands at rest at tick 0.

        Args:
            robot: shipped name, path of a robot file, or a loaded robot.
            scenario: shipped name, path of a TOML, or a scenario built in Python.
            servo_profile: a profile of the robot file to use instead of its own.
            settings: settings of the safety layer around the controller; the
                controller has its own. See :data:`surefoot.run_plan.Settings`.
            seed: of the sensor noise.
            record: keep every tick's signals.

        Raises:
            ScenarioError: no such scenario, or it does not fit the robot.
            RobotFileError: no such robot, or its files contradict each other.
            FileFormatError: a file or the settings are malformed.
        """
        plan = make_plan(
            scenario,
            robot=robot,
            servo_profile=servo_profile,
            settings=settings,
            seed=seed,
        )
        self._build(plan, memory_sinks() if record else None)

    @classmethod
    def of_plan(cls, plan: RunPlan, *, sinks: TickSinks | None = None) -> Self:
        """Build from a plan.

        Args:
            plan: what to run.
            sinks: for the signals of every tick; None keeps none.
        """
        made = cls.__new__(cls)
        made._build(plan, sinks)
        return made

    def _build(self, plan: RunPlan, sinks: TickSinks | None) -> None:
        self.plan = plan
        self.goes_on = False
        self._sinks = sinks
        robot = plan.robot
        with naming_scenario(plan.scenario_path or Path(plan.scenario_name)):
            self.simulated = SimulatedRobot(
                robot,
                plan.scenario,
                seed=plan.seed,
                ticks=None if sinks is None else sinks.robot,
            )
        self.gate = CommandGate(robot, self.simulated.held_posture)
        for action in ("take", "enable"):
            self.gate.request(action, COMMANDER, now_s=0.0)
        self._given: object = None
        self._walk = plan.walk
        self._safety: Safety | None = None
        self._telemetry = ControllerTelemetry(
            plan.controller,
            period_s=robot.period_s,
            calibration_s=plan.settings.estimator.calibration_s,
            recorder=recorder_to(
                None if sinks is None else sinks.controller,
                robot,
                walks=plan.walk is not None,
            ),
        )
        self._delivery = Delivery()
        self._commands: dict[int, JointCommand] = {}
        self._last_tick: int | None = None
        self._elapsed_s = 0.0

    @property
    def robot(self) -> Robot:
        """The robot, as its files describe it."""
        return self.plan.robot

    @property
    def tick(self) -> int:
        """The present tick."""
        return self.simulated.tick

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self.simulated.time_s

    @property
    def finished(self) -> bool:
        """Whether the scenario is over, or the robot fell."""
        return self.simulated.finished

    @property
    def fell(self) -> bool:
        """Whether the robot has fallen."""
        return self.simulated.fell

    @property
    def snapshot(self) -> Snapshot:
        """Sensors of the present tick."""
        return self.simulated.sense()

    @property
    def truth(self) -> PlantTruth:
        """True state at the present tick; for plots and tests, never for control."""
        return self.simulated.truth()

    @property
    def signals(self) -> Signals:
        """Signals of all ticks so far; needs ``record=True``.

        Raises:
            UsageError: the simulation keeps no signals in memory.
        """
        tables = [sink for sink in self._sinks or () if isinstance(sink, MemoryTicks)]
        if not tables:
            raise UsageError(
                "this simulation keeps no signals; make it with record=True"
            )
        return Signals(tables)

    @property
    def safety(self) -> Safety | None:
        """The safety layer around the present controller; None before the first."""
        return self._safety

    def step(
        self, controller: Any, reference: Reference | None = None
    ) -> ControllerOutput | None:
        """Advance one tick.

        Args:
            controller: any object with ``start(snapshot, q_command)`` and
                ``step(snapshot, reference)``. It is started at its first tick. Another
                controller takes over from the posture that the robot holds then.
            reference: a planner's reference.

        Returns:
            The controller's answer; None once the safety layer has ended it.

        Raises:
            ControllerError: the controller breaks the controller protocol.
        """
        began_s = time.perf_counter()
        simulated = self.simulated
        tick, now_s = simulated.tick, simulated.time_s
        safety = self._safety_around(controller)
        self.gate.begin_tick(now_s=now_s, tick=tick)
        output = None
        if not safety.is_done:
            output = self._answer(safety, tick, reference)
            self._last_tick = tick if safety.is_done else None
        self._follow_waiting(tick, now_s)
        simulated.step()
        self._elapsed_s += time.perf_counter() - began_s
        return output

    def _follow_waiting(self, tick: int, now_s: float) -> None:
        """Follow the command that is due by now, if there is one."""
        due = self.simulated.commands_needed(tick)
        if due in self._commands:
            command = self._commands.pop(due)
            result = self.gate.accept(command, tick=tick, now_s=now_s)
            self.simulated.apply(result.posture, tick=due)
            if due == self._last_tick:
                self._leave(now_s)

    def run(
        self,
        controller: Any,
        *,
        on_tick: Callable[[int], None] | None = None,
        stop: StopRequest | None = None,
    ) -> None:
        """Advance to the end of the scenario, or to the fall.

        Args:
            controller: as for :meth:`step`.
            on_tick: called with each tick.
            stop: can end the run after each tick.
        """
        stop = stop or StopRequest()
        with quiet_interpreter():
            while not self.finished and not stop.is_set:
                self.step(controller)
                if on_tick is not None:
                    on_tick(self.tick)

    def result(self, *, histogram: bool = False) -> RunResult:
        """Return the result of the run so far.

        Args:
            histogram: whether to add histograms of the controller's times.
        """
        return join_result(self.plan, self.sides(histogram=histogram))

    def sides(self, *, histogram: bool = False) -> Sides:
        """Return the figures of plant and controller so far."""
        controller = self._controller_result(histogram=histogram)
        return Sides(self._plant_result(controller.tick_ms), controller)

    def write(self, folder: Path) -> None:
        """Write the first QP that failed, if there is one.

        Args:
            folder: gets the file.
        """
        controller = self._safety.controller if self._safety is not None else None
        if controller is not None and controller.failure is not None:
            save_failure(controller.failure, folder / QP_FAILURE)

    def _safety_around(
        self, controller: Any, snapshot: Snapshot | None = None
    ) -> Safety:
        """The safety layer; it is restarted for another controller."""
        if controller is self._given and self._safety is not None:
            return self._safety
        ours = adapt(controller, self.robot)
        self._given = controller
        self._safety = Safety(ours, self.robot, self.plan.settings.safety)
        first = self.simulated.sense() if snapshot is None else snapshot
        self._safety.start(first, self.gate.posture.copy())
        walk, self._walk = self._walk, None
        if walk is not None:
            self._safety.follow_plan(walk)
        return self._safety

    def _answer(
        self, safety: Safety, tick: int, reference: Reference | None
    ) -> ControllerOutput:
        began_ns = time.perf_counter_ns()
        snapshot, ages = self._delivery.deliver(
            self.simulated.sense(), self.simulated.unread_sensors
        )
        output = safety.step(snapshot, ages, reference)
        self._note(
            output,
            tick,
            is_stale=any(ages),
            duration_ns=time.perf_counter_ns() - began_ns,
        )
        self._commands[tick] = command_of(
            output, tick, stamp_ns=began_ns, sequence=tick
        )
        return output

    def _note(
        self, output: ControllerOutput, tick: int, *, is_stale: bool, duration_ns: int
    ) -> None:
        """Count an answer, and note the state of the safety layer."""
        safety = self._safety
        assert safety is not None
        if safety.error is not None and not self.goes_on:
            raise safety.error
        self._telemetry.add(
            output, tick=tick, duration_ns=duration_ns, is_stale=is_stale
        )
        self._telemetry.note(
            safety.state, safety.end, safety.detail, lost=safety.losses
        )

    def _leave(self, now_s: float) -> None:
        """At rest: ask the robot to hold, and give the lease back, as on the bus."""
        for action in ("hold", "release"):
            self.gate.request(action, COMMANDER, now_s=now_s)

    def _controller_result(
        self,
        end: EndReason = EndReason.NONE,
        detail: str = "",
        *,
        histogram: bool,
    ) -> ControllerResult:
        """The controller's figures.

        Args:
            end: reason of its end, if the safety layer does not know it.
            detail: the same in words.
            histogram: whether to add a histogram of its times.
        """
        if end is EndReason.NONE and self._safety is not None:
            end, detail = self._safety.end, self._safety.detail
        if end is EndReason.NONE:
            end, detail = told_end(*(self._cut_off or self.simulated.own_end))
        return self._telemetry.result(end, detail, histogram=histogram)

    @property
    def _cut_off(self) -> tuple[ModeCause, str] | None:
        """Cause if the scenario was not run to its end; None if it was."""
        if self.finished:
            return None
        return ModeCause.STOPPED, "not run to the end of the scenario"

    def _plant_result(self, tick_ms: Distribution) -> PlantResult:
        """The plant's figures; without a bus, a round trip is the controller's tick."""
        return self.simulated.result(
            real_time_factor=self.time_s / self._elapsed_s if self._elapsed_s else 0.0,
            round_trip_ms=tick_ms,
            period_jitter_ms=NO_TIME,
            deadline_misses=0,
            refused=dict(self.gate.refused),
            clipped=dict(self.gate.clipped),
            gate=self.gate.report(),
            cut_off=self._cut_off,
        )


def command_of(
    output: ControllerOutput, tick: int, *, stamp_ns: int, sequence: int
) -> JointCommand:
    """Return the message with which an answer goes to the robot."""
    return JointCommand(
        schema=SCHEMA_VERSION,
        tick=tick,
        stamp_ns=stamp_ns,
        q=output.q_command.tolist(),
        commander=COMMANDER,
        sequence=sequence,
    )
