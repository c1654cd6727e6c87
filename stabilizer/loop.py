"""The stabilizer's loop: snapshot -> requests -> safety and controller -> command."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from surefoot.robot_io.client_side.assembler import SnapshotReading
from surefoot.robot_io.client_side.client import RobotClient
from surefoot.robot_io.errors import RobotIoError
from surefoot.robot_io.realtime import StopRequest
from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import Reference, RobotMode, RobotStatus
from surefoot.schemas.reasons import (
    EndReason,
    ModeCause,
    SensorTrouble,
    StabilizerState,
    in_words,
    plain,
)
from surefoot.schemas.walk_plan import WalkPlan
from surefoot.stabilizer.control.reference import ReferenceLimits
from surefoot.stabilizer.controller import ControllerOutput
from surefoot.stabilizer.qp import save_failure
from surefoot.stabilizer.requests import RequestHandler
from surefoot.stabilizer.safety.safety import Safety
from surefoot.stabilizer.telemetry import GOOD, ControllerTelemetry
from surefoot.stabilizer.walking.feet import WalkState

_LOG = logging.getLogger(__name__)

SILENCE_POLL_S = 0.1
SILENCE_LIMIT_S = 10.0
"""Time without sensors after which a robot that is there is given up [s]."""
STATUS_RATE_HZ = 50.0
LEAVING_LIMIT_S = 1.0
"""Time beyond its own ramp that an orderly end may take; then it is immediate."""
RETAKE_AFTER_NS = 100_000_000
"""Time for which the robot holds for late commands until we start anew from there."""


class End(NamedTuple):
    """End of a stay in command, and its reason.

    Attributes:
        reason: why the stay ended.
        detail: the same in words; may be empty.
        may_return: whether to take command again when the robot is back: it went away,
            or our silence lost the command and nobody else has it.
    """

    reason: EndReason
    detail: str = ""
    may_return: bool = False


class Loop:
    """Answers snapshots until there is a reason to end."""

    def __init__(
        self,
        make_safety: Callable[[], Safety],
        client: RobotClient,
        telemetry: ControllerTelemetry,
        requests: RequestHandler,
        *,
        period_s: float,
        leave_s: float,
        failure_file: Path | None,
        walk: WalkPlan | None,
        limits: ReferenceLimits,
    ) -> None:
        """Join controller and bus.

        Args:
            make_safety: makes a fresh watched controller for a start, with the present
                settings. It takes some ms, so it is only called while the robot holds
                its posture and does not wait.
            client: in command of the robot.
            telemetry: counts and times the ticks.
            requests: answers requests to the stabilizer.
            period_s: from tick to tick [s].
            leave_s: time over which commands fade out when asked to stop [s].
            failure_file: file for the first QP that cannot be solved.
            walk: steps for the controller of the first start.
            limits: of a planner's references.
        """
        self._limits = limits
        self._heard: Reference | None = None
        self._followed: Reference | None = None
        self._given = walk
        self._requests = requests
        self._output: ControllerOutput | None = None
        self._plan: WalkPlan | None = None
        self._make_safety = make_safety
        self._begin_with(make_safety())
        self._client = client
        self._telemetry = telemetry
        self._status_every = max(1, round(1.0 / (STATUS_RATE_HZ * period_s)))
        self._began = (0, 0)
        self._is_told = False
        self._error_told: Exception | None = None
        self._answered = 0
        self._last_tick = 0
        self._hold_since_ns: int | None = None
        self._leave_s = leave_s
        self._leave_by_s: float | None = None
        self._has_news = False
        self._failure_file = failure_file

    def run(self, q_held: Array, stop: StopRequest) -> End:
        """Answer until the end.

        Args:
            q_held: (n_a,) posture that the robot holds, to begin from [rad].
            stop: asks for an end; the commands then fade out first.
        """
        heard_s = time.monotonic()
        while not (stop.is_set and self._has_left(stop)):
            reading = self._client.wait_snapshot(timeout_s=SILENCE_POLL_S)
            if reading is not None:
                heard_s = time.monotonic()
                is_time = self._attend(reading, q_held)
                if self._safety.is_done and self._output is not None:
                    self._tell(reading, self._output)
                    self._ask_to_hold()
                    return End(self._safety.end, self._safety.detail)
                if not is_time:
                    continue
            end = self._why_end(time.monotonic() - heard_s, q_held)
            if end is not None and not self._is_owed_an_answer(reading):
                return end if self._leave_by_s is None else _stopped(stop)
        return _stopped(stop)

    def _begin_with(self, safety: Safety) -> None:
        """Let the next snapshot start this new controller."""
        self._safety, self._is_started = safety, False
        self._losses_told: dict[str, SensorTrouble] = {}
        self._requests.serve_controller(safety)

    def _has_left(self, stop: StopRequest) -> bool:
        """Fade the commands out; return whether nothing more is to be waited for."""
        if stop.is_urgent or not self._is_started or self._requests.holding:
            return True
        now_s = time.monotonic()
        if self._leave_by_s is None:
            self._leave_by_s = now_s + self._leave_s + LEAVING_LIMIT_S
            self._safety.request_soft_stop(stop.cause)
            self._has_news = True  # a replay fades out from the tick this is told of
        return now_s > self._leave_by_s

    def _ask_to_hold(self) -> None:
        """Ask for a hold, at rest; a robot that has gone is no problem by then."""
        try:
            self._client.request_mode("hold")
        except RobotIoError:
            if self._leave_by_s is None:
                raise

    def _attend(self, reading: SnapshotReading, q_held: Array) -> bool:
        """Serve requests, then answer; return whether to look after the robot."""
        requests = self._requests
        requests.serve(reading.snapshot.tick)
        if requests.holding:
            return self._hold(reading)
        if requests.q_held is not None:
            # Readings from before the hold's end are old: the next snapshot begins
            # anew.
            q_held[:], requests.q_held = requests.q_held, None
            self._retire()
            return True
        self._output = self._answer(reading, q_held)
        if self._answered % self._status_every != 0 and not self._has_news:
            return False
        self._has_news = False
        self._tell(reading, self._output)
        return True

    def _hold(self, reading: SnapshotReading) -> bool:
        """Keep command of a robot that holds its posture."""
        self._retire()
        self._requests.keep_lease()
        self._answered += 1
        if self._answered % self._status_every != 0:
            return False
        if self._output is not None:
            self._tell(reading, self._output)
        return True

    def _retire(self) -> None:
        """Replace a controller that has been started."""
        if self._is_started:
            self._begin_with(self._make_safety())

    def _answer(self, reading: SnapshotReading, q_held: Array) -> ControllerOutput:
        tick = reading.snapshot.tick
        if not self._is_started:
            self._safety.start(reading.snapshot, q_held)
            self._is_started = True
            self._telemetry.begin()
            self._began = (tick, reading.snapshot.stamp_ns)
            self._is_told = False
            self._hold_since_ns = None
            self._last_tick = tick - 1
        for snapshot in reading.overtaken:
            self._safety.pass_over(snapshot)
        taken = self._take_plan()
        output = self._safety.step(
            reading.snapshot, reading.ages, self._reference(tick)
        )
        self._client.send(output.q_command, tick=tick)
        if taken is not None:
            now_ns = time.monotonic_ns()
            self._client.publish_taken(replace(taken, tick=tick, stamp_ns=now_ns))
        self._telemetry.add(
            output,
            tick=tick,
            duration_ns=time.perf_counter_ns() - reading.complete_ns,
            is_stale=bool(reading.stale),
            skipped=tick - self._last_tick - 1,
        )
        self._last_tick = tick
        safety = self._safety
        self._telemetry.note(
            safety.state, safety.end, safety.detail, lost=safety.losses
        )
        if safety.losses != self._losses_told:
            self._tell_losses(tick)
        if safety.error is not None and safety.error is not self._error_told:
            self._error_told = safety.error
            _LOG.error("tick %d: %s", tick, safety.detail, exc_info=safety.error)
        self._answered += 1
        if output.qp_status != GOOD and self._failure_file is not None:
            self._keep_failure(self._failure_file)
        return output

    def _tell_losses(self, tick: int) -> None:
        """Say which sensors have trouble; of each once in a start."""
        for name, why in self._safety.losses.items():
            if self._losses_told.get(name) is not why:
                then = "corrected" if why is SensorTrouble.OFFSET else "not believed"
                _LOG.warning("tick %d: %s %s, %s", tick, name, plain(why), then)
        self._losses_told = dict(self._safety.losses)

    def _reference(self, tick: int) -> Reference | None:
        """A planner's newest reference that can be followed; None before the first."""
        new, before = self._client.reference(), self._heard
        if new is not None and new is not before:
            self._heard = new
            why = self._limits.why_not(new)
            if not why:
                self._followed = new
            elif before is self._followed:  # said once, until one can be followed
                _LOG.warning("tick %d: a reference is refused: %s", tick, why)
        return self._followed

    def _take_plan(self) -> WalkPlan | None:
        """Give the controller new steps, once; a planner's come before given ones."""
        new, self._given = self._given, None
        plan = self._client.plan()
        if plan is not self._plan:
            new = self._plan = plan
        if new is None or not self._safety.follow_plan(new):
            return None
        return new

    def _keep_failure(self, path: Path) -> None:
        """Write the failed QP, once; the command has already been sent."""
        self._failure_file = None
        failure = self._safety.controller.failure
        if failure is None:
            return
        try:
            save_failure(failure, path)
        except OSError as error:
            _LOG.warning("a QP failed and could not be kept: %s", error)
        else:
            _LOG.warning("a QP failed, the posture is held; it is kept in %s", path)

    def _tell(self, reading: SnapshotReading, output: ControllerOutput) -> None:
        status = self._telemetry.status(
            output,
            tick=reading.snapshot.tick,
            stamp_ns=time.monotonic_ns(),
            stale=reading.stale,
            lost=self._safety.lost_sensors,
        )
        if self._requests.holding:
            status = replace(
                status, state=StabilizerState.PAUSED, detail=self._requests.holding
            )
        self._client.publish_status(status)
        walk = output.walk if self._is_started else None
        if walk is None and self._telemetry.has_walked:
            walk = WalkState()  # what one that has given way said is not so any more
        if walk is not None:
            self._client.publish_walk(
                walk.message(tick=status.tick, stamp_ns=status.stamp_ns)
            )

    def _why_end(self, silence_s: float, q_held: Array) -> End | None:
        """Return why to end; None to go on, from the held posture in a hold."""
        client = self._client
        status = client.status()
        if status is not None:
            if status.mode is RobotMode.FAULT:
                return End(EndReason.ROBOT_FAULT, status.detail)
            if status.mode is RobotMode.OFF:
                reason, detail = told_end(status.cause, status.detail)
                may_return = reason is EndReason.ROBOT_ENDED
                unheard = client.missing_sensors()
                if reason is EndReason.RUN_OVER and not self._answered and unheard:
                    names = ", ".join(unheard)
                    reason = EndReason.ROBOT_SILENT
                    detail = f"no news from {names} until its run was over"
                return End(reason, detail, may_return=may_return)
            if self._is_started and self._is_since_start(status):
                if status.commander != client.identity:
                    return End(
                        EndReason.LEASE_LOST,
                        status.detail,
                        may_return=not status.commander,
                    )
                if self._is_held_too_long(status):
                    self._start_anew(status, q_held)
        if not client.robot_is_here:
            return End(EndReason.ROBOT_GONE, may_return=True)
        if silence_s > SILENCE_LIMIT_S:
            names = ", ".join(client.missing_sensors()) or "any sensor"
            detail = f"no news from {names} for {silence_s:.1f} s"
            return End(EndReason.ROBOT_SILENT, detail, may_return=True)
        return None

    def _is_since_start(self, status: RobotStatus) -> bool:
        """Whether a status tells of this start: one from before may come after it.

        Told by ticks, which sensors and status have in common: their stamps need not be
        of one clock, and only order what is of one tick.
        """
        if not self._is_told:
            self._is_told = (status.tick, status.stamp_ns) >= self._began
        return self._is_told

    def _is_owed_an_answer(self, reading: SnapshotReading | None) -> bool:
        """Return whether a robot that is off has sent later ticks, still unread.

        Its last status may overtake our reading, since it waits for no answer to its
        last ticks. Without a reading nothing more came.
        """
        status = self._client.status()
        return (
            reading is not None
            and status is not None
            and status.mode is RobotMode.OFF
            and reading.snapshot.tick < status.tick
        )

    def _is_held_too_long(self, status: RobotStatus) -> bool:
        """Return whether the robot holds by itself and takes up no commands."""
        if status.mode is not RobotMode.HOLD or self._requests.holding:
            self._hold_since_ns = None
            return False
        if self._hold_since_ns is None:
            self._hold_since_ns = status.stamp_ns
        held_ns = status.stamp_ns - self._hold_since_ns
        return held_ns > RETAKE_AFTER_NS and self._leave_by_s is None

    def _start_anew(self, status: RobotStatus, q_held: Array) -> None:
        """Enable the robot again, with a new controller from its held posture."""
        _LOG.warning(
            "tick %d: the robot holds (%s); starting again from its posture",
            status.tick,
            in_words(status.cause, status.detail),
        )
        fresh = self._make_safety()  # the robot waits for nobody yet
        try:
            q_held[:] = self._client.enable()
        except RobotIoError:
            return  # its next status tells why
        self._begin_with(fresh)
        self._telemetry.restarts += 1


def _stopped(stop: StopRequest) -> End:
    return End(EndReason.STOPPED, stop.cause)


def told_end(cause: ModeCause, detail: str) -> tuple[EndReason, str]:
    """Return why a robot that is off ends its stabilizer, and the same in words.

    A robot that finished its run says so; any other end is the robot's own.
    """
    if cause is ModeCause.RUN_OVER:
        return EndReason.RUN_OVER, detail
    if cause is ModeCause.FELL:
        return EndReason.FELL, detail
    return EndReason.ROBOT_ENDED, in_words(cause, detail)
