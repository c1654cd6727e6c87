"""A run with a relay's faults in simulated time, without the bus.

Every message is encoded, meets the same faults as in a relay, and is decoded and judged
as on the bus. Only its travel time is simulated: the run is the same bit for bit on a
busy machine. ``surefoot.runs`` uses it for plans with a relay.
"""

from __future__ import annotations

import time
from typing import Any, Generic

import msgspec

from surefoot.outcome import Sides
from surefoot.robot_io.bus.channel import NEVER, M
from surefoot.robot_io.client_side.assembler import SnapshotReading
from surefoot.robot_io.client_side.client import PATIENCE_S
from surefoot.robot_io.relay.forwarder import Schedule
from surefoot.robot_io.relay.lane import Lane, Parcel, PlanClock
from surefoot.robot_io.robot_side.server import read_command
from surefoot.robot_io.snapshot import SnapshotLayout, ages_of, sensor_messages
from surefoot.run_plan import RunPlan
from surefoot.schemas.arrays import NS_PER_S
from surefoot.schemas.codec import decode, encode
from surefoot.schemas.errors import MessageError
from surefoot.schemas.messages import Reference, RobotMode
from surefoot.schemas.reasons import EndReason, ModeCause
from surefoot.schemas.result import NO_TIME, RelayResult
from surefoot.schemas.sensors import SENSORS
from surefoot.schemas.topics import COMMAND, TICK_SENSORS
from surefoot.signals import TickSinks
from surefoot.simulation import COMMANDER, Simulation, command_of
from surefoot.stabilizer.controller import ControllerOutput

LOOK_EVERY_TICKS = 20
"""The stabilizer looks at the robot's status, and gets it, every 20 ticks."""
INSTANT_S = 1e-9
"""Tolerance for rounding: a message due at this instant has arrived [s]."""


class RelayedSimulation(Simulation):
    """Robot and stabilizer, advanced in turn at each tick, with delayed messages.

    The order is that of the robot's real-time loop, in simulated time.

    Attributes:
        modes: modes of the robot so far, each with its beginning: (time [s], mode,
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
        """Return the figures of both sides and the relay so far."""
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
        """The stabilizer's answer to the arrived messages, if there are any."""
        reading = self._heard.next(now_s)
        if reading is None:
            return None
        safety = self._safety_around(controller, reading.snapshot)
        for snapshot in reading.overtaken:
            safety.pass_over(snapshot)
        output = safety.step(reading.snapshot, reading.ages, reference)
        tick = reading.snapshot.tick
        self._note(output, tick, is_stale=bool(reading.stale), duration_ns=0)
        command = command_of(
            output,
            tick,
            stamp_ns=round(now_s * NS_PER_S),
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
        """Let the robot judge the arrived commands and follow the last accepted one."""
        accepted = None
        while (data := self._on_the_way.take_due(now_s + INSTANT_S)) is not None:
            command = read_command(data, self.gate)
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

    def _note_mode(self, now_s: float) -> None:
        modes = self.gate.modes
        if not self.modes or self.modes[-1][1] is not modes.mode:
            self.modes.append((now_s, modes.mode, modes.cause))

    def _why_end(self) -> tuple[EndReason, str]:
        """Reason for the stabilizer to end; ``none`` to go on."""
        modes = self.gate.modes
        if modes.mode is RobotMode.FAULT:
            return EndReason.ROBOT_FAULT, modes.detail
        if not modes.holds_lease(COMMANDER):
            return EndReason.LEASE_LOST, modes.detail
        return EndReason.NONE, ""


class HeardSensor(Generic[M]):
    """Messages of one sensor: those under way and those that have arrived.

    Attributes:
        latest: newest message taken; None before the first.
        passed: messages taken for the last snapshot.
        newest: tick of the newest message that has arrived.
        is_lost: the sensor stayed away; it is not waited for until it is back.
    """

    def __init__(self, kind: type[M], *, joint_count: int) -> None:
        """Begin without messages."""
        self.latest: M | None = None
        self.passed: list[M] = []
        self.is_lost = False
        self._kind = kind
        self._joint_count = joint_count
        self._coming: Schedule[bytes] = Schedule()
        self._waiting: list[M] = []
        self.newest = NEVER

    @property
    def tick(self) -> int:
        """Tick of the newest message taken."""
        return NEVER if self.latest is None else self.latest.tick

    def send(self, parcel: Parcel) -> None:
        """Send a message; it arrives at the parcel's time."""
        self._coming.put(parcel.data, at_s=parcel.at_s)

    def hear(self, now_s: float) -> None:
        """Read the arrived messages; drop unreadable, old and repeated ones."""
        while (data := self._coming.take_due(now_s + INSTANT_S)) is not None:
            try:
                message = decode(data, self._kind, joint_count=self._joint_count)
            except MessageError:
                continue
            if message.tick > self.newest:
                self.newest = message.tick
                self._waiting.append(message)

    def take_up_to(self, tick: int) -> None:
        """Take the messages up to a tick; the last of them counts."""
        self.passed = [message for message in self._waiting if message.tick <= tick]
        del self._waiting[: len(self.passed)]
        if self.passed:
            self.latest = self.passed[-1]


class DelayedSensors:
    """All sensors of a robot, joined into snapshots; the newest tick wins.

    They are joined as in the client's assembler, without a bus. The message of the
    sensor that is sent last announces a tick. A late sensor is waited for; one that
    stays away is given up.
    """

    def __init__(self, *, joint_count: int) -> None:
        """Begin without messages."""
        self.sensors: dict[str, HeardSensor[Any]] = {
            entry.name: HeardSensor(entry.message, joint_count=joint_count)
            for entry in SENSORS
        }
        self._layout = SnapshotLayout(joint_count)
        self._answered = NEVER
        self._since_s = 0.0
        self._is_waiting = False

    def next(self, now_s: float) -> SnapshotReading | None:
        """Return the snapshot to answer now; None if there is none."""
        for sensor in self.sensors.values():
            sensor.hear(now_s)
        newest = max(sensor.newest for sensor in self.sensors.values())
        if newest <= self._answered:
            return None
        if not self._is_waiting:
            self._is_waiting, self._since_s = True, now_s
        is_over = now_s - self._since_s >= PATIENCE_S - INSTANT_S
        *_, last = (s for s in self.sensors.values() if not s.is_lost or is_over)
        tick = newest if is_over else last.newest
        if tick <= self._answered:
            return None
        late = [s for s in self.sensors.values() if s.newest < tick]
        if any(not s.is_lost for s in late) and not is_over:
            return None
        for sensor in self.sensors.values():
            sensor.is_lost = sensor in late
            sensor.take_up_to(tick)
        answered, self._answered, self._is_waiting = self._answered, tick, False
        messages = [s.latest for s in self.sensors.values() if s.latest is not None]
        if len(messages) < len(self.sensors):
            return None
        stale = tuple(name for name, s in self.sensors.items() if s.tick != tick)
        snapshot = self._layout.join(tick, messages)
        overtaken = self._layout.join_passed(
            [s.passed for s in self.sensors.values()], after=answered, before=tick
        )
        return SnapshotReading(snapshot, stale, ages_of(messages, tick), 0, overtaken)
