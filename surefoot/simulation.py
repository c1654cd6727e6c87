"""A run without the bus: plant, gate and controller in one loop."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from surefoot.robot_io.realtime import quiet_interpreter
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.snapshot import Delivery
from surefoot.run_folder import QP_FAILURE, TICKS, write_arrays
from surefoot.run_plan import RunPlan
from surefoot.run_result import Sides
from surefoot.schemas.messages import SCHEMA_VERSION, JointCommand
from surefoot.schemas.result import (
    ControllerResult,
    Distribution,
    PlantResult,
)
from surefoot.sim_robot.catalogue import naming_scenario
from surefoot.sim_robot.simulated_robot import SimulatedRobot
from surefoot.stabilizer.factory import make_controller
from surefoot.stabilizer.qp import save_failure
from surefoot.stabilizer.safety.safety import Safety
from surefoot.stabilizer.telemetry import ControllerTelemetry

COMMANDER = "inline"
PROGRESS_EVERY_TICKS = 100


def run_inline(
    plan: RunPlan,
    folder: Path,
    *,
    record: bool,
    on_tick: Callable[[int], None],
    histogram: bool = False,
) -> Sides:
    """Run a plan in this process.

    Sensors, commands, gate and delays are those of lockstep on the bus, in the same
    order: the run is the same bit for bit.

    Args:
        plan: what to run.
        folder: gets the record.
        record: write every tick.
        on_tick: told the present tick now and then.
        histogram: whether the result holds one of the controller's times.
    """
    loop = _InlineLoop(plan, record=record)
    began_s = time.monotonic()
    with quiet_interpreter():
        while not loop.simulated.finished:
            loop.tick()
            if loop.simulated.tick % PROGRESS_EVERY_TICKS == 0:
                on_tick(loop.simulated.tick)
    elapsed_s = time.monotonic() - began_s
    if record:
        write_arrays(folder / TICKS, loop.simulated.recording())
    if loop.controller.failure is not None:
        save_failure(loop.controller.failure, folder / QP_FAILURE)
    reason = loop.safety.reason or "run over"
    controller = loop.telemetry.result(reason, histogram=histogram)
    return Sides(loop.plant_result(controller, elapsed_s=elapsed_s), controller)


class _InlineLoop:
    """Sense, control, guard, step."""

    def __init__(self, plan: RunPlan, *, record: bool) -> None:
        """Build both sides and enable the robot."""
        robot = plan.robot
        with naming_scenario(plan.scenario_path):
            self.simulated = SimulatedRobot(
                robot, plan.scenario, seed=plan.seed, record=record
            )
        self.telemetry = ControllerTelemetry(plan.controller, period_s=robot.period_s)
        self.controller = make_controller(plan.controller, robot, plan.settings)
        self._gate = CommandGate(robot, self.simulated.held_posture)
        self._commands: dict[int, JointCommand] = {}
        self.safety = Safety(self.controller, robot, plan.settings.safety)
        self._delivery = Delivery()
        for action in ("take", "enable"):
            self._gate.request(action, COMMANDER, now_s=0.0)
        self.safety.start(self.simulated.sense(), self._gate.posture.copy())

    def tick(self) -> None:
        """One tick of plant and controller."""
        simulated = self.simulated
        tick, now_s = simulated.tick, simulated.time_s
        self._gate.begin_tick(now_s=now_s, tick=tick)
        if not self.safety.is_done:
            self._commands[tick] = self._answer(tick)
        due = simulated.commands_needed(tick)
        if due in self._commands:
            self._gate.check(self._commands.pop(due), tick=tick, now_s=now_s)
            simulated.apply(self._gate.posture, tick=due)
        simulated.step()

    def plant_result(
        self, controller: ControllerResult, *, elapsed_s: float
    ) -> PlantResult:
        """The plant's figures; without a bus, a round trip is the controller's tick."""
        return self.simulated.result(
            real_time_factor=self.simulated.time_s / elapsed_s,
            round_trip_ms=controller.tick_ms,
            period_jitter_ms=Distribution(median=0.0, p99=0.0, max=0.0),
            deadline_misses=0,
            refused=dict(self._gate.refused),
            clipped=dict(self._gate.clipped),
        )

    def _answer(self, tick: int) -> JointCommand:
        began_ns = time.perf_counter_ns()
        simulated = self.simulated
        snapshot, ages = self._delivery.deliver(
            simulated.sense(), simulated.unread_sensors
        )
        output = self.safety.step(snapshot, ages)
        self.telemetry.add(
            output,
            duration_ns=time.perf_counter_ns() - began_ns,
            is_stale=any(ages),
        )
        self.telemetry.note(self.safety.state, self.safety.reason)
        return JointCommand(
            schema=SCHEMA_VERSION,
            tick=tick,
            stamp_ns=began_ns,
            q=output.q_command.tolist(),
            commander=COMMANDER,
            sequence=tick,
        )
