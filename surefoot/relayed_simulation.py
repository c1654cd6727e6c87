"""A run without the bus but with a relay's faults, in simulated time.

Every message is encoded, meets the same faults as in a relay, and is decoded and judged
as on the bus; only the time it takes is simulated. So the run is the same bit for bit,
however busy the machine is.
"""

from __future__ import annotations

import time
from typing import Any

import msgspec

from surefoot.outcome import Sides
from surefoot.robot_io.relay.delayed_sensors import INSTANT_S, DelayedSensors
from surefoot.robot_io.relay.forwarder import COMMAND, Schedule
from surefoot.robot_io.relay.lane import Lane, PlanClock
from surefoot.robot_io.robot_side.mode_machine import Refusal
from surefoot.robot_io.snapshot import sensor_messages
from surefoot.run_plan import RunPlan
from surefoot.schemas.codec import decode, encode
from surefoot.schemas.errors import MessageError, SchemaVersionError
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    JointCommand,
    Reference,
    RobotMode,
)
from surefoot.schemas.reasons import EndReason, ModeCause
from surefoot.schemas.result import RelayResult
from surefoot.schemas.topics import TICK_SENSORS
from surefoot.signals import TickSinks
from surefoot.simulation import COMMANDER, NO_TIME, Simulation
from surefoot.stabilizer.control.controller import ControllerOutput

NS_PER_S = 1e9
LOOK_EVERY_TICKS = 20
"""The stabilizer looks at the robot's status every 20 ticks, as it is told of it."""


class RelayedSimulation(Simulation):
    """Robot and stabilizer in turn, each tick, with their messages on the way.

    The order is that of the robot's real-time loop, in simulated time.

    Attributes:
        modes: modes the robot has been in, with their beginnings: (time [s], mode,
            cause).
    """

    def _build(self, plan: RunPlan, sinks: TickSinks | None) -> None:
        super()._build(plan, sinks)
        assert plan.relay is not None
        self.modes: list[tuple[float, RobotMode, ModeCause]] = []
        self._faults = plan.relay
        self._lanes = {
            name: Lane(self._faults, name, seed=plan.seed)
            for name in (*TICK_SENSORS, COMMAND)
        }
        self._clock = PlanClock()
        self._heard = DelayedSensors(joint_count=plan.robot.n_a)
        self._on_the_way: Schedule[bytes] = Schedule()
        self._sequence = 0
        self._end, self._end_detail = EndReason.NONE, ""
        self._is_answered = False
        self._misses = 0

    def step(
        self, controller: Any, reference: Reference | None = None
    ) -> ControllerOutput | None:
        """Advance one tick; see :meth:`Simulation.step`."""
        began_s = time.perf_counter()
        simulated, gate = self.simulated, self.gate
        tick, now_s = simulated.tick, simulated.time_s
        gate.begin_tick(now_s=now_s, tick=tick)
        self._take_commands(tick, now_s)
        self._note_mode(now_s)
        self._publish(tick, now_s)
        output = None
        if self._end is EndReason.NONE:
            output = self._attend(controller, now_s, reference)
        if self._end is EndReason.NONE and tick % LOOK_EVERY_TICKS == 0:
            self._end, self._end_detail = self._why_end()
        simulated.step()
        self._elapsed_s += time.perf_counter() - began_s
        return output

    def sides(self, *, histogram: bool = False) -> Sides:
        """What both sides and the relay measured so far."""
        relay = RelayResult(
            plan=self._faults.name,
            counts={name: dict(lane.counts) for name, lane in self._lanes.items()},
        )
        controller = self._controller_result(
            self._end, self._end_detail, histogram=histogram
        )
        plant = msgspec.structs.replace(
            self._plant_result(NO_TIME), deadline_misses=self._misses
        )
        return Sides(plant, controller, relay)

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

    def _attend(
        self, controller: Any, now_s: float, reference: Reference | None
    ) -> ControllerOutput | None:
        """The stabilizer's answer to what it hears, if there is anything."""
        reading = self._heard.next(now_s)
        if reading is None:
            return None
        safety = self._safety_around(controller, reading.snapshot)
        output = safety.step(reading.snapshot, reading.ages, reference)
        self._telemetry.add(
            output,
            tick=reading.snapshot.tick,
            duration_ns=0,
            is_stale=bool(reading.stale),
        )
        self._telemetry.note(
            safety.state, safety.end, safety.detail, lost=safety.losses
        )
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
            self._on_the_way.put(parcel.data, at_s=parcel.at_s)
        if safety.is_done:
            self._leave(now_s)
            self._end, self._end_detail = safety.end, safety.detail
        return output

    def _take_commands(self, tick: int, now_s: float) -> None:
        """The robot judges what has come, and follows the last that it accepts."""
        accepted = None
        while (data := self._on_the_way.take_due(now_s + INSTANT_S)) is not None:
            command = self._read(data)
            if command is None:
                continue
            result = self.gate.accept(command, tick=tick, now_s=now_s)
            if result.accepted:
                accepted = result
        if accepted is not None:
            self._is_answered = True
            acts_as = max(accepted.answers, tick - self.simulated.command_delay_ticks)
            self.simulated.apply(accepted.posture, tick=acts_as)
        elif self._is_answered and self.gate.mode is RobotMode.ACTIVE:
            self._misses += 1

    def _read(self, data: bytes) -> JointCommand | None:
        try:
            return decode(data, JointCommand, joint_count=self.robot.n_a)
        except SchemaVersionError as error:
            self.gate.refuse(Refusal.SCHEMA, str(error))
        except MessageError as error:
            self.gate.refuse(Refusal.MALFORMED, str(error))
        return None

    def _note_mode(self, now_s: float) -> None:
        modes = self.gate.modes
        if not self.modes or self.modes[-1][1] is not modes.mode:
            self.modes.append((now_s, modes.mode, modes.cause))

    def _why_end(self) -> tuple[EndReason, str]:
        """Why the stabilizer ends; ``none`` to go on."""
        modes = self.gate.modes
        if modes.mode is RobotMode.FAULT:
            return EndReason.ROBOT_FAULT, modes.detail
        if not modes.holds_lease(COMMANDER):
            return EndReason.LEASE_LOST, modes.detail
        return EndReason.NONE, ""
