"""Safety layer between sensors and controller: trust of sensors, orderly end.

Data flows one way: snapshot -> health -> controller -> command. No clock and no I/O. In
a healthy run the controller's answers pass through unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Ages, Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import Reference
from surefoot.schemas.reasons import EndReason, SensorTrouble, StabilizerState, plain
from surefoot.schemas.sensors import SENSORS
from surefoot.schemas.settings import ControllerSettings, SafetySettings
from surefoot.schemas.walk_plan import WalkPlan
from surefoot.stabilizer.controller import (
    Controller,
    ControllerOutput,
    Degradable,
    Doubts,
    PassesOver,
    Tunable,
    UndoesOverload,
    Walks,
)
from surefoot.stabilizer.estimation.wrenches import ForceOffsets, VirtualWrenches
from surefoot.stabilizer.foreign import told_of
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.safety.consistency import SoleCheck, TurnCheck, up_in_unit
from surefoot.stabilizer.safety.health import (
    FRESH,
    LEFT_FT,
    REQUIRED,
    RIGHT_FT,
    SensorHealth,
)

MISSED_MEMORY_S = 0.5
"""Time over which missed ticks are counted [s]."""
MOST_MISSED = 0.25
"""Missed ticks for each answer up to which they are taken in. A machine that misses
more needs all of its time for answers."""


class Safety:
    """Watches one controller, for one start of it.

    Attributes:
        controller: answers while all is well.
        state: state of the stabilizer: active, degraded, soft_stop, fade_out or held.
        end: why it gives up or was asked to end; ``none`` while it goes on.
        detail: why it is not active, in words; empty when it is.
        losses: sensors with trouble since the start, by channel, and which first.
        error: exception of the controller that ended it; None without one.
    """

    def __init__(
        self, controller: Controller, robot: Robot, settings: SafetySettings
    ) -> None:
        """Watch a controller that has not been started."""
        self.controller = controller
        self.state = StabilizerState.ACTIVE
        self.end = EndReason.NONE
        self.detail = ""
        self.losses: dict[str, SensorTrouble] = {}
        self.error: Exception | None = None
        self._settings = settings
        self._virtual: VirtualWrenches | None = None
        self._offsets: ForceOffsets | None = None
        self._turns = TurnCheck(settings, period_s=robot.period_s)
        model = RobotModel(robot)
        soles: SoleCheck | None = None
        if robot.file.virtual_ft is None:
            self._offsets = ForceOffsets(model)
            soles = SoleCheck(
                model, margin=settings.sole_margin_m, offsets=self._offsets.offsets
            )
        else:
            self._virtual = VirtualWrenches(
                model, robot.file.virtual_ft, period_s=robot.period_s
            )
        self._health = SensorHealth(robot, settings, weight=model.weight, soles=soles)
        self._least_upright = math.cos(settings.tilt_limit_rad)
        self._unloaded_limit = round(settings.unloaded_after_s / robot.period_s)
        self._fade_ticks = max(1, round(settings.ramp_out_s / robot.period_s))
        self._leave_ticks = round(settings.leave_s / robot.period_s)
        self._bridge_ticks = round(settings.bridge_s / robot.period_s)
        self._unanswered = self._tick = 0
        self._missed, self._missed_blend = 0.0, robot.period_s / MISSED_MEMORY_S
        self._takes_in = controller if isinstance(controller, PassesOver) else None
        self._doubts = controller if isinstance(controller, Doubts) else None
        self._is_number = np.empty(robot.n_a, dtype=bool)
        self._fade = self._left = self._unloaded = 0
        self._asked: Array | None = None
        self._normals = robot.sole_normals
        self._up = (0.0, 0.0, 1.0)
        self._degraded = (False, False)
        self._output: ControllerOutput | None = None
        self._command: Array = np.zeros(robot.n_a)
        self._before: Array = np.zeros(robot.n_a)
        self._motion: Array = np.zeros(robot.n_a)
        self._before_overload: list[Array] = [self._command, self._command]
        self._return_to: Array | None = None

    @property
    def lost_sensors(self) -> dict[str, SensorTrouble]:
        """Sensors that are not trusted, by channel, and why."""
        return self._health.losses

    @property
    def is_done(self) -> bool:
        """Whether the command stands still for good."""
        return self.state is StabilizerState.HELD

    def start(self, snapshot: Snapshot, q_command: Array) -> None:
        """Begin on a robot that stands still; see :meth:`Controller.start`."""
        if self._virtual is not None:
            snapshot = self._virtual.infer(snapshot)
        self._up = up_in_unit(snapshot)
        self._tick = snapshot.tick
        self._command, self._before = q_command.copy(), q_command.copy()
        with self._guarded():
            self.controller.start(snapshot, q_command)

    def follow_plan(self, plan: WalkPlan) -> bool:
        """Give the controller steps; return whether it walks."""
        if not isinstance(self.controller, Walks):
            return False
        if self.error is None:
            with self._guarded():
                self.controller.follow_plan(plan)
        return True

    @property
    def is_tunable(self) -> bool:
        """Whether the controller takes new gains."""
        return isinstance(self.controller, Tunable)

    def retune(self, settings: ControllerSettings) -> None:
        """Give the controller new gains, if it takes any; see :class:`Tunable`."""
        if isinstance(self.controller, Tunable) and self.error is None:
            with self._guarded():
                self.controller.retune(settings)

    def step(
        self, snapshot: Snapshot, ages: Ages, reference: Reference | None = None
    ) -> ControllerOutput:
        """Answer one tick.

        Args:
            snapshot: reading of all sensors.
            ages: ticks since each sensor's message, in the order of the topic table.
            reference: a planner's newest reference, if any.
        """
        if self.is_done and self._output is not None:
            return self._output
        if self._gives_up():
            return self._fade_out()
        with self._guarded():
            return self._answer(snapshot, ages, reference)
        return self._fade_out()

    def _answer(
        self, snapshot: Snapshot, ages: Ages, reference: Reference | None
    ) -> ControllerOutput:
        believed = self._believed(snapshot, ages)
        if self._gives_up():
            return self._fade_out()
        output = self.controller.step(believed, reference)
        if self._doubts is not None:
            trouble, why = self._doubts.imu_trouble()
            if trouble is not None:
                self._distrust_imu(trouble, why)
            if self._gives_up():
                return self._fade_out()
        if not np.isfinite(output.q_command, out=self._is_number).all():
            return self._unheard(output)
        self._unanswered = 0
        if self.state is StabilizerState.SOFT_STOP:
            output = self._soft_stopped(output)
        self._before, self._command = self._command, self._before
        self._command[:] = output.q_command  # whose array the controller may reuse
        self._output = output
        return output

    def pass_over(self, snapshot: Snapshot) -> None:
        """Take in a tick that gets no answer; none from before the start.

        The robot keeps its command. Readings are judged; what follows from a lost
        sensor waits for the next answer. While more than :data:`MOST_MISSED` are
        missed, they are lost.

        Args:
            snapshot: reading of all sensors of that tick.
        """
        takes_in = self._takes_in
        if takes_in is None or snapshot.tick <= self._tick or self._gives_up():
            return
        if self._missed > MOST_MISSED:
            return
        if self._virtual is not None:
            snapshot = self._virtual.infer(snapshot)
        believed = self._health.check(snapshot, FRESH, moves=self._moves)
        if not any(self._health.lost[index] for index in REQUIRED):
            with self._guarded():
                takes_in.pass_over(believed)

    def _believed(self, snapshot: Snapshot, ages: Ages) -> Snapshot:
        """Return what is believed of a reading; give up if that is too little."""
        if self._virtual is not None:
            snapshot = self._virtual.infer(snapshot)
        believed = self._health.check(snapshot, ages, moves=self._moves)
        if self._offsets is not None:
            believed = self._offsets.correct(believed)
            if any(self._offsets.found):
                self._tell_offsets(self._offsets.found)
        for side, ticks in enumerate(self._health.overload_ticks):
            if ticks == 1:  # here an overload of the foot begins, if it is one
                self._before_overload[side] = self._command.copy()
        is_degraded = any(self._degraded) or self.state is StabilizerState.DEGRADED
        if not self._health.all_believed or is_degraded:
            self._react_to_losses()
        # This reading also stands for the ticks before it without an answer.
        ticks = snapshot.tick - self._tick
        self._tick = snapshot.tick
        self._missed += self._missed_blend * (max(0, ticks - 1) - self._missed)
        for _ in range(max(1, min(ticks, self._bridge_ticks))):
            self._turns.update(believed)
        if self._turns.are_apart:
            trouble = SensorTrouble.INCONSISTENT
            self._distrust_imu(trouble, self._turns.in_words())
        self._look_for_fall(believed)
        return believed

    def request_soft_stop(self, detail: str) -> None:
        """Let the robot come to rest in balance; then the command stands still.

        A lost sensor or a fall in the meantime ends it as usual.
        """
        if self._gives_up():
            return
        self.state = StabilizerState.SOFT_STOP
        self.end, self.detail = EndReason.STOPPED, detail
        self._asked = self._command.copy()

    def abort(self, end: EndReason, detail: str) -> None:
        """Let the command fade out; the first reason stays."""
        if not self._gives_up():
            self.state = StabilizerState.FADE_OUT
            self.end, self.detail = end, detail

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """Give up on an exception inside: whoever drives the robot still needs us."""
        try:
            yield
        except Exception as error:
            self.error = self.error or error
            name = self.controller.name
            self.abort(EndReason.CONTROLLER_FAILED, f"{name}: {told_of(error)}")

    def _distrust_imu(self, trouble: SensorTrouble, why: str) -> None:
        self._list("imu", trouble)
        if trouble is not SensorTrouble.OFFSET:
            self.abort(EndReason.SENSOR_LOST, f"imu {plain(trouble)}: {why}")

    def _unheard(self, output: ControllerOutput) -> ControllerOutput:
        """Deal with an answer that is not a posture.

        The robot refuses it, counts it and keeps the last good one. This is allowed for
        as long as a sensor may be away; later the robot would take the commander for
        silent.
        """
        self._before[:] = self._command
        self._unanswered += 1
        if self._unanswered <= self._bridge_ticks:
            return output
        wrong = int(np.count_nonzero(~self._is_number))
        self.abort(
            EndReason.CONTROLLER_FAILED,
            f"{self.controller.name} answered {wrong} of {self._is_number.size} joint "
            "positions that are no number",
        )
        return self._fade_out()

    def _gives_up(self) -> bool:
        return self.state in (StabilizerState.FADE_OUT, StabilizerState.HELD)

    def _moves(self) -> bool:
        """Whether the last command differs from the one before it."""
        return not np.array_equal(self._command, self._before)

    def _tell_offsets(self, found: list[bool]) -> None:
        for index, is_off in zip((LEFT_FT, RIGHT_FT), found, strict=True):
            if is_off:
                self._list(SENSORS[index].name, SensorTrouble.OFFSET)

    def _list(self, sensor: str, why: SensorTrouble) -> None:
        """List a sensor's first trouble; a loss is worse than an offset."""
        if self.losses.get(sensor, SensorTrouble.OFFSET) is SensorTrouble.OFFSET:
            self.losses[sensor] = why

    def _react_to_losses(self) -> None:
        """Go on without lost sensors, or give up."""
        health = self._health
        for sensor, why in health.losses.items():
            self._list(sensor, why)
        if any(health.lost[index] for index in REQUIRED):
            self.abort(EndReason.SENSOR_LOST, health.in_words())
            return
        feet = (bool(health.lost[LEFT_FT]), bool(health.lost[RIGHT_FT]))
        if feet != self._degraded and not self._do_without(feet):
            return
        if self.state is StabilizerState.SOFT_STOP:
            return
        self.detail = health.in_words()
        is_degraded = not health.all_believed
        self.state = StabilizerState.DEGRADED if is_degraded else StabilizerState.ACTIVE

    def _do_without(self, feet: tuple[bool, bool]) -> bool:
        """Tell the controller to leave out the lost ankle sensors.

        Returns:
            Whether it can; otherwise the motion fades out.
        """
        lost, settings = self._health.lost, self._settings
        policy = settings.both_ft_lost if all(feet) else settings.ft_lost
        controller = self.controller
        overloaded = (
            not self._degraded[0] and lost[LEFT_FT] is SensorTrouble.OVERLOADED,
            not self._degraded[1] and lost[RIGHT_FT] is SensorTrouble.OVERLOADED,
        )
        if any(feet) and (policy == "hold" or not isinstance(controller, Degradable)):
            self.abort(EndReason.SENSOR_LOST, self._health.in_words())
            if any(overloaded):
                self._return_to, _ = self._command_before_overload(overloaded)
            return False
        self._degraded = feet
        if isinstance(controller, Degradable):
            controller.degrade(feet)
            if any(overloaded) and isinstance(controller, UndoesOverload):
                before, ticks = self._command_before_overload(overloaded)
                controller.undo_overload(before, ticks=ticks, sides=overloaded)
        return True

    def _command_before_overload(
        self, overloaded: tuple[bool, bool]
    ) -> tuple[Array, int]:
        """Return the command before these feet's overload, and its age [ticks]."""
        ticks = self._health.overload_ticks
        side = max(
            (side for side in range(2) if overloaded[side]), key=ticks.__getitem__
        )
        return self._before_overload[side], ticks[side]

    def _look_for_fall(self, snapshot: Snapshot) -> None:
        x, y, z = up_in_unit(snapshot)
        up_x, up_y, up_z = self._up
        upright = x * up_x + y * up_y + z * up_z
        if upright < self._least_upright:
            angle = math.degrees(math.acos(max(upright, -1.0)))
            self.abort(EndReason.FELL, f"leans by {angle:.0f} deg")
        left, right = self._normals
        load = left @ snapshot.ft_left[:3] + right @ snapshot.ft_right[:3]
        if load > self._settings.unloaded_n or any(self._degraded):
            self._unloaded = 0
            return
        self._unloaded += 1
        if self._unloaded > self._unloaded_limit:
            seconds = self._settings.unloaded_after_s
            self.abort(EndReason.FELL, f"the feet carry nothing for {seconds:g} s")

    def _soft_stopped(self, output: ControllerOutput) -> ControllerOutput:
        """Return the controller's motion, scaled down from tick to tick."""
        self._left += 1
        share = max(0.0, 1.0 - self._left / max(1, self._leave_ticks))
        if share == 0.0:
            self.state = StabilizerState.HELD
        asked = output.q_command.copy()
        motion = asked - (asked if self._asked is None else self._asked)
        self._asked = asked
        return replace(output, q_command=self._command + share * motion)

    def _fade_out(self) -> ControllerOutput:
        """Continue the last motion, slower and slower, until it stands still.

        After false forces it is the way back from where they led.
        """
        if self._fade == 0:
            self._motion = self._command - self._before
            if self._return_to is not None:
                # The shares below add up to half the ticks.
                steps = max(1.0, 0.5 * (self._fade_ticks - 1))
                self._motion = (self._return_to - self._command) / steps
        self._fade += 1
        share = max(0.0, 1.0 - self._fade / self._fade_ticks)
        if share == 0.0:
            self.state = StabilizerState.HELD
        self._command = self._command + share * self._motion
        before = self._output
        if before is None:
            before = ControllerOutput(self._command)
        self._output = replace(before, q_command=self._command)
        return self._output
