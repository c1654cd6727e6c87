"""A controller as a process on the bus."""

from __future__ import annotations

import logging
import os
import socket
import time
from pathlib import Path

import msgspec

from robot_io.assembler import SnapshotReading
from robot_io.client import RobotClient
from robot_io.errors import RequestRefusedError
from robot_io.pace import Pace
from robot_io.quiet import quiet_interpreter
from robot_io.robot import Robot
from robot_io.stop_request import StopRequest
from schemas.arrays import Array
from schemas.endpoints import Endpoints
from schemas.messages import RobotMode
from schemas.result import ControllerResult
from schemas.settings import ControllerSettings, SafetySettings
from stabilizer.controller import Controller, ControllerOutput
from stabilizer.desk import Desk
from stabilizer.failure_dump import save_failure
from stabilizer.safety import Safety
from stabilizer.telemetry import GOOD, ControllerTelemetry

_LOG = logging.getLogger(__name__)

CONNECT_TIMEOUT_S = 10.0
SILENCE_POLL_S = 0.1
SILENCE_LIMIT_S = 10.0
"""A robot that is there but sends nothing for so long is given up."""
STATUS_RATE_HZ = 50.0
RUN_OVER = "run over"
"""How a robot begins to say that its run went to its end."""


def run_stabilizer(
    controller: Controller,
    robot: Robot,
    *,
    endpoints: Endpoints,
    pace: Pace,
    identity: str | None = None,
    connect_timeout_s: float = CONNECT_TIMEOUT_S,
    failure_file: Path | None = None,
    settings: ControllerSettings | None = None,
    stop: StopRequest | None = None,
    safety: SafetySettings | None = None,
) -> ControllerResult:
    """Waits for the robot, takes command of it and answers its ticks.

    In lockstep every tick is answered exactly once, in order; in real time the newest
    one. It ends when the robot does, or takes command away, or on SIGINT or SIGTERM;
    the lease is given back, and the robot holds its posture.

    Args:
        controller: what answers.
        robot: what its files say; the same as on the robot's side.
        endpoints: where to dial.
        pace: the robot's.
        identity: one word, unique on the bus; made up when None.
        connect_timeout_s: how long the robot may take to appear [s].
        failure_file: where the first QP that cannot be solved is kept (.npz).
        settings: the controller was made with; None refuses changes on the bus.
        stop: ends the run from outside, besides signals.
        safety: limits of the sensors and what their loss leads to; None for defaults.

    Returns:
        Figures of the run and why it ended.

    Raises:
        EndpointError: a locator is malformed.
        RobotUnreachableError: no robot there, or it does not answer.
        RequestRefusedError: somebody else commands it, or it is in fault.
    """
    stop = stop or StopRequest()
    telemetry = ControllerTelemetry(controller.name, period_s=robot.period_s)
    with (
        stop.on_signals(),
        RobotClient(
            robot,
            endpoints=endpoints,
            identity=identity or _made_up_identity(controller.name),
            in_order=pace is Pace.LOCKSTEP,
            stop=stop,
        ) as client,
    ):
        if not client.connect(timeout_s=connect_timeout_s):
            return telemetry.result(f"stopped: {stop.cause}")
        robots_pace = client.take_lease().pace
        if robots_pace != pace:
            raise RequestRefusedError(
                f"the robot runs in {robots_pace}, this stabilizer in {pace}; start it "
                f"with --{robots_pace}",
                reason=f"pace {pace}",
            )
        q_held = client.enable()
        with quiet_interpreter():
            desk = Desk(controller, client, settings, period_s=robot.period_s)
            watched = Safety(controller, robot, safety or SafetySettings())
            loop = _Loop(watched, client, telemetry, desk, robot.period_s)
            loop.failure_file = failure_file
            reason = loop.run(q_held, stop)
    result = telemetry.result(reason)
    return msgspec.structs.replace(result, settings_changes=desk.changes)


def _made_up_identity(controller_name: str) -> str:
    host = socket.gethostname().split(".")[0]
    return f"{controller_name}-{host}-{os.getpid()}"


def _why_off(reason: str) -> str:
    """A robot that has done its run says so; any other end is the robot's own."""
    if reason.startswith(RUN_OVER):
        return reason
    return f"the robot ended: {reason or 'it is off'}"


class _Loop:
    """Answers snapshots until there is a reason to end."""

    def __init__(
        self,
        safety: Safety,
        client: RobotClient,
        telemetry: ControllerTelemetry,
        desk: Desk,
        period_s: float,
    ) -> None:
        """Joins controller and bus."""
        self._desk = desk
        self._output: ControllerOutput | None = None
        self._safety, self._controller = safety, safety.controller
        self._client = client
        self._telemetry = telemetry
        self._status_every = max(1, round(1.0 / (STATUS_RATE_HZ * period_s)))
        self._is_started = False
        self._began_ns = 0
        self._answered = 0
        self.failure_file: Path | None = None

    def run(self, q_held: Array, stop: StopRequest) -> str:
        """Answers until the end; returns its reason."""
        heard_s = time.monotonic()
        while not stop.is_set:
            reading = self._client.wait_snapshot(timeout_s=SILENCE_POLL_S)
            if reading is not None:
                heard_s = time.monotonic()
                is_time = self._attend(reading, q_held)
                if self._safety.is_done and self._output is not None:
                    self._tell(reading, self._output)
                    self._client.request_mode("hold")
                    return self._safety.reason
                if not is_time:
                    continue
            reason = self._why_end(time.monotonic() - heard_s)
            if reason:
                return reason
        return f"stopped: {stop.cause}"

    def _attend(self, reading: SnapshotReading, q_held: Array) -> bool:
        """Requests, then the answer; whether it is time to look after the robot."""
        desk = self._desk
        desk.serve(reading.snapshot.tick)
        if desk.holding:
            return self._hold(reading)
        if desk.q_held is not None:
            # What came before the hold's end is old: the next snapshot begins anew.
            q_held[:], desk.q_held = desk.q_held, None
            self._is_started = False
            return True
        self._output = self._answer(reading, q_held)
        if self._answered % self._status_every != 0:
            return False
        self._tell(reading, self._output)
        return True

    def _hold(self, reading: SnapshotReading) -> bool:
        """Keeps command of a robot that keeps its posture."""
        self._desk.keep_lease()
        self._answered += 1
        if self._answered % self._status_every != 0:
            return False
        if self._output is not None:
            self._tell(reading, self._output)
        return True

    def _answer(self, reading: SnapshotReading, q_held: Array) -> ControllerOutput:
        if not self._is_started:
            self._safety.start(reading.snapshot, q_held)
            self._is_started = True
            self._began_ns = reading.snapshot.stamp_ns
        output = self._safety.step(
            reading.snapshot, reading.ages, self._client.reference()
        )
        self._client.send(output.q_command, tick=reading.snapshot.tick)
        self._telemetry.add(
            output,
            duration_ns=time.perf_counter_ns() - reading.complete_ns,
            is_stale=bool(reading.stale),
        )
        self._telemetry.note(self._safety.state, self._safety.reason)
        self._answered += 1
        if output.qp_status != GOOD and self.failure_file is not None:
            self._keep_failure(self.failure_file)
        return output

    def _keep_failure(self, path: Path) -> None:
        """Writes the failed QP, once; the command has left already."""
        self.failure_file = None
        if self._controller.failure is None:
            return
        try:
            save_failure(self._controller.failure, path)
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
        )
        if self._desk.holding:
            status = msgspec.structs.replace(
                status, state="hold", reason=self._desk.holding
            )
        self._client.publish_status(status)

    def _why_end(self, silence_s: float) -> str:
        """Why to end; empty to go on."""
        client = self._client
        status = client.status()
        if status is not None:
            if status.mode is RobotMode.FAULT:
                return f"the robot is in fault: {status.fault}"
            if status.mode is RobotMode.OFF:
                return _why_off(status.reason)
            # On a busy machine, one from before the lease may come after it.
            is_news = self._is_started and status.stamp_ns >= self._began_ns
            if is_news and status.commander != client.identity:
                return f"lost command of the robot: {status.reason}"
        if not client.robot_is_here:
            return "the robot is gone"
        if silence_s > SILENCE_LIMIT_S:
            names = ", ".join(client.missing_sensors()) or "any sensor"
            return f"no news from {names} for {silence_s:.1f} s"
        return ""
