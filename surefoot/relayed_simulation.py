"""A run without the bus but with a relay's faults, in simulated time.

Every message is encoded, meets the same faults as in a relay, and is decoded and judged
as on the bus; only the time it takes is simulated. So the run is the same bit for bit,
however busy the machine is.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from surefoot.robot_io.realtime import quiet_interpreter
from surefoot.robot_io.relay.delayed_sensors import INSTANT_S, DelayedSensors
from surefoot.robot_io.relay.dispatcher import Schedule
from surefoot.robot_io.relay.forwarder import COMMAND
from surefoot.robot_io.relay.lane import Lane, PlanClock
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.mode_machine import Refusal
from surefoot.robot_io.snapshot import sensor_messages
from surefoot.run_folder import TICKS, write_arrays
from surefoot.run_plan import RunPlan
from surefoot.run_result import Sides
from surefoot.schemas.codec import decode, encode
from surefoot.schemas.errors import MessageError, SchemaVersionError
from surefoot.schemas.messages import SCHEMA_VERSION, JointCommand, RobotMode
from surefoot.schemas.relay_plan import RelayPlan
from surefoot.schemas.result import Distribution, RelayResult
from surefoot.schemas.topics import TICK_SENSORS
from surefoot.sim_robot.simulated_robot import SimulatedRobot
from surefoot.stabilizer.factory import make_controller
from surefoot.stabilizer.safety.safety import Safety
from surefoot.stabilizer.telemetry import ControllerTelemetry

COMMANDER = "inline"
NS_PER_S = 1e9
LOOK_EVERY_TICKS = 20
"""The stabilizer looks at the robot's status so often, as it is told of it."""
PROGRESS_EVERY_TICKS = 100
_NO_TIME = Distribution(median=0.0, p99=0.0, max=0.0)


def run_inline_relayed(
    plan: RunPlan,
    faults: RelayPlan,
    folder: Path,
    *,
    record: bool,
    on_tick: Callable[[int], None],
) -> Sides:
    """Run a plan in this process, as in real time with a relay in between.

    Args:
        plan: what to run.
        faults: of the relay.
        folder: gets the record.
        record: write every tick.
        on_tick: told the present tick now and then.
    """
    loop = RelayedLoop(plan, faults, record=record)
    began_s = time.monotonic()
    with quiet_interpreter():
        while not loop.simulated.finished:
            loop.tick()
            if loop.simulated.tick % PROGRESS_EVERY_TICKS == 0:
                on_tick(loop.simulated.tick)
    if record:
        write_arrays(folder / TICKS, loop.simulated.recording())
    return loop.sides(elapsed_s=time.monotonic() - began_s)


class RelayedLoop:
    """Robot and stabilizer in turn, each tick, with their messages on the way.

    Attributes:
        simulated: the robot.
        modes: modes the robot has been in, with their beginnings: (time [s], mode,
            reason).
    """

    def __init__(self, plan: RunPlan, faults: RelayPlan, *, record: bool) -> None:
        """Build both sides and enable the robot."""
        robot = plan.robot
        self.simulated = SimulatedRobot(
            robot, plan.scenario, seed=plan.seed, record=record
        )
        self.modes: list[tuple[float, RobotMode, str]] = []
        self._robot, self._faults = robot, faults
        self._gate = CommandGate(robot, self.simulated.held_posture)
        for action in ("take", "enable"):
            self._gate.request(action, COMMANDER, now_s=0.0)
        self._telemetry = ControllerTelemetry(plan.controller, period_s=robot.period_s)
        controller = make_controller(plan.controller, robot, plan.settings)
        self._safety = Safety(controller, robot, plan.settings.safety)
        self._lanes = {
            name: Lane(faults, name, seed=plan.seed)
            for name in (*TICK_SENSORS, COMMAND)
        }
        self._clock = PlanClock()
        self._heard = DelayedSensors(joint_count=robot.n_a)
        self._commands: Schedule[bytes] = Schedule()
        self._sequence = 0
        self._end = ""
        self._is_started = False
        self._is_answered = False
        self._misses = 0

    def tick(self) -> None:
        """One tick of both, in the order of the robot's real-time loop."""
        simulated, gate = self.simulated, self._gate
        tick, now_s = simulated.tick, simulated.time_s
        gate.begin_tick(now_s=now_s, tick=tick)
        self._take_commands(tick, now_s)
        self._note_mode(now_s)
        self._publish(tick, now_s)
        if not self._end:
            self._attend(now_s)
        if not self._end and tick % LOOK_EVERY_TICKS == 0:
            self._end = self._why_end()
        simulated.step()

    def sides(self, *, elapsed_s: float) -> Sides:
        """What both sides measured."""
        plant = self.simulated.result(
            real_time_factor=self.simulated.time_s / elapsed_s,
            round_trip_ms=_NO_TIME,
            period_jitter_ms=_NO_TIME,
            deadline_misses=self._misses,
            refused=dict(self._gate.refused),
            clipped=dict(self._gate.clipped),
        )
        reason = self._end or self._safety.reason or "run over"
        relay = RelayResult(
            plan=self._faults.name,
            counts={name: dict(lane.counts) for name, lane in self._lanes.items()},
        )
        return Sides(plant, self._telemetry.result(reason), relay)

    def _publish(self, tick: int, now_s: float) -> None:
        simulated = self.simulated
        stamp_ns = round(now_s * NS_PER_S)
        messages = sensor_messages(simulated.sense(), stamp_ns=stamp_ns)
        elapsed_s = self._clock.elapsed_s(now_s)
        for name, message in zip(TICK_SENSORS, messages, strict=True):
            if name in simulated.missing_sensors:
                continue
            for parcel in self._lanes[name].pass_on(
                encode(message), now_s=now_s, elapsed_s=elapsed_s
            ):
                self._heard.sensors[name].send(parcel)

    def _attend(self, now_s: float) -> None:
        """The stabilizer's answer to what it hears, if there is anything."""
        reading = self._heard.next(now_s)
        if reading is None:
            return
        if not self._is_started:
            self._safety.start(reading.snapshot, self._gate.posture.copy())
            self._is_started = True
        output = self._safety.step(reading.snapshot, reading.ages)
        self._telemetry.add(output, duration_ns=0, is_stale=bool(reading.stale))
        self._telemetry.note(self._safety.state, self._safety.reason)
        command = JointCommand(
            schema=SCHEMA_VERSION,
            tick=reading.snapshot.tick,
            stamp_ns=round(now_s * NS_PER_S),
            q=output.q_command.tolist(),
            commander=COMMANDER,
            sequence=self._sequence,
        )
        self._sequence += 1
        self._clock.begin(now_s)
        for parcel in self._lanes[COMMAND].pass_on(
            encode(command), now_s=now_s, elapsed_s=self._clock.elapsed_s(now_s)
        ):
            self._commands.put(parcel.data, at_s=parcel.at_s)
        if self._safety.is_done:
            for action in ("hold", "release"):
                self._gate.request(action, COMMANDER, now_s=now_s)
            self._end = self._safety.reason

    def _take_commands(self, tick: int, now_s: float) -> None:
        """The robot judges what has come, and follows the last that it accepts."""
        accepted = None
        while (data := self._commands.take_due(now_s + INSTANT_S)) is not None:
            command = self._read(data)
            if command is None:
                continue
            if self._gate.check(command, tick=tick, now_s=now_s).accepted:
                accepted = command
        if accepted is not None:
            self._is_answered = True
            acts_as = max(accepted.tick, tick - self.simulated.command_delay_ticks)
            self.simulated.apply(self._gate.posture, tick=acts_as)
        elif self._is_answered and self._gate.mode is RobotMode.ACTIVE:
            self._misses += 1

    def _read(self, data: bytes) -> JointCommand | None:
        try:
            return decode(data, JointCommand, joint_count=self._robot.n_a)
        except SchemaVersionError as error:
            self._gate.refuse(Refusal.SCHEMA, str(error))
        except MessageError as error:
            self._gate.refuse(Refusal.MALFORMED, str(error))
        return None

    def _note_mode(self, now_s: float) -> None:
        modes = self._gate.modes
        if not self.modes or self.modes[-1][1] is not modes.mode:
            self.modes.append((now_s, modes.mode, modes.reason))

    def _why_end(self) -> str:
        """Why the stabilizer ends; empty to go on."""
        modes = self._gate.modes
        if modes.mode is RobotMode.FAULT:
            return f"the robot is in fault: {modes.fault}"
        if not modes.holds_lease(COMMANDER):
            return f"lost command of the robot: {modes.reason}"
        return ""
