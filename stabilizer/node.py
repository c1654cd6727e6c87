"""The stabilizer's process: connects, takes the lease and runs a controller's loop."""

from __future__ import annotations

import logging
import math
import os
import re
import socket
import threading
import time
from pathlib import Path

import msgspec

from surefoot.robot_io.client_side.client import RobotClient
from surefoot.robot_io.errors import RequestRefusedError, RobotUnreachableError
from surefoot.robot_io.realtime import Pace, StopRequest, quiet_interpreter
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.ticks.recorder import TickSink
from surefoot.schemas.arrays import Array
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import SettingsChange
from surefoot.schemas.reasons import EndReason, RequestRefusal, in_words
from surefoot.schemas.result import ControllerResult
from surefoot.schemas.settings import ControllerSettings
from surefoot.schemas.walk_plan import WalkPlan
from surefoot.stabilizer.control.reference import ReferenceLimits
from surefoot.stabilizer.controller import Controller, ControllerFactory
from surefoot.stabilizer.loop import End, Loop
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.requests import RequestHandler
from surefoot.stabilizer.safety.safety import Safety
from surefoot.stabilizer.telemetry import ControllerTelemetry, recorder_to

_LOG = logging.getLogger(__name__)

CONNECT_TIMEOUT_S = 10.0
RETURN_PATIENCE_S = 5.0
"""Time for which a returned robot may refuse us: our former lease may still stand."""
RETURN_PAUSE_S = 0.1


def run_stabilizer(
    make_controller: ControllerFactory,
    robot: Robot,
    *,
    endpoints: Endpoints,
    pace: Pace,
    identity: str | None = None,
    connect_timeout_s: float = CONNECT_TIMEOUT_S,
    reconnect: bool = False,
    histogram: bool = False,
    failure_file: Path | None = None,
    settings: ControllerSettings | None = None,
    stop: StopRequest | None = None,
    ticks: TickSink | None = None,
    walk: WalkPlan | None = None,
) -> ControllerResult:
    """Wait for the robot, take command of it and answer its ticks.

    Every start, also after a hold or a silence, uses a new controller, made with the
    present settings.

    In lockstep every tick is answered exactly once, in order; in real time only the
    newest one. It ends when the robot ends, when the robot takes command away, or on a
    signal. Then the commands come to rest, the lease is given back, and the robot holds
    its posture. A second signal ends it at once.

    With ``reconnect``, it waits for a robot that went away, even before it answered, or
    lost contact, and takes command again as at first: new lease, new controller from
    the held posture. It never does so after a fault, another commander, a requested
    hold, or the run's end.

    Args:
        make_controller: makes the controller of each start.
        robot: content of the robot's files; the same as on the robot's side.
        endpoints: locators to dial.
        pace: pace of the robot.
        identity: one word, unique on the bus; None: one is made up.
        connect_timeout_s: time that the robot may take to appear at first [s].
        reconnect: whether to wait for a robot that went away, for as long as it takes.
        histogram: whether the result has a histogram of the ticks' times.
        failure_file: file for the first QP that cannot be solved (.npz).
        settings: initial settings; None for the defaults.
        stop: ends the run from outside, in addition to signals.
        ticks: receives the controller's signals of every tick; None keeps none.
        walk: steps for the first controller only: a later one stands elsewhere. None to
            stand.

    Returns:
        Figures of the run and why it ended.

    Raises:
        EndpointError: a locator is malformed.
        RobotUnreachableError: there is no robot, or it does not answer.
        RequestRefusedError: somebody else commands the robot, or it is in FAULT.
    """
    node = _Node(
        make_controller,
        robot,
        endpoints=endpoints,
        pace=pace,
        identity=identity,
        failure_file=failure_file,
        settings=settings or ControllerSettings(),
        stop=stop or StopRequest(),
        ticks=ticks,
        walk=walk,
    )
    end = node.run(connect_timeout_s=connect_timeout_s, reconnect=reconnect)
    result = node.telemetry.result(end.reason, end.detail, histogram=histogram)
    return msgspec.structs.replace(result, settings_changes=node.changes)


def _made_up_identity(controller_name: str) -> str:
    """Return one word; a controller from a file is called by its class."""
    host = socket.gethostname().split(".")[0]
    law = re.sub(r"[^\w-]+", "-", controller_name.rpartition(":")[2])
    return f"{law}-{host}-{os.getpid()}"


class _Node:
    """Successive stays in command of the robot."""

    def __init__(
        self,
        make_controller: ControllerFactory,
        robot: Robot,
        *,
        endpoints: Endpoints,
        pace: Pace,
        identity: str | None,
        failure_file: Path | None,
        settings: ControllerSettings,
        stop: StopRequest,
        ticks: TickSink | None,
        walk: WalkPlan | None,
    ) -> None:
        self._walk = walk
        self._make, self._robot = make_controller, robot
        # The first controller is made now, so that a failure is reported before
        # dialing.
        first = make_controller(settings)
        self._first: Controller | None = first
        self._endpoints, self._pace = endpoints, pace
        self._identity = identity or _made_up_identity(first.name)
        self._failure_file, self._settings = failure_file, settings
        self._limits = ReferenceLimits(RobotModel(robot))
        self._stop = stop
        self.telemetry = ControllerTelemetry(
            first.name,
            period_s=robot.period_s,
            calibration_s=settings.estimator.calibration_s,
            recorder=recorder_to(ticks, robot, walks=walk is not None),
        )
        self._requests: RequestHandler | None = None
        self._stays = 0
        self._has_commanded = False
        self._refused_since_s = math.inf
        self._pause = threading.Event()

    @property
    def changes(self) -> list[SettingsChange]:
        """All changes of settings in all stays."""
        return [] if self._requests is None else self._requests.changes

    def run(self, *, connect_timeout_s: float, reconnect: bool) -> End:
        """Stay in command, with returns, until a final end; see run_stabilizer."""
        with self._stop.on_signals():
            end = self._stay(connect_timeout_s)
            while reconnect and end.may_return and not self._stop.is_set:
                said = in_words(end.reason, end.detail)
                _LOG.warning("%s; waiting for it to come back", said)
                end = self._return()
        return end

    def _return(self) -> End:
        """Take command again as soon as there is a robot that allows it."""
        self._refused_since_s = math.inf
        while True:
            try:
                return self._stay(math.inf)
            except RobotUnreachableError as error:
                _LOG.info("%s", error)  # it was about to end, or ended again
            except RequestRefusedError:
                now_s = time.monotonic()
                self._refused_since_s = min(self._refused_since_s, now_s)
                if now_s > self._refused_since_s + RETURN_PATIENCE_S:
                    raise
            self._pause.wait(RETURN_PAUSE_S)

    def _stay(self, timeout_s: float) -> End:
        """Connect, take command and answer until something ends it."""
        self._stays += 1
        # A new name each time keeps remains of the last stay from being taken for it.
        suffix = f"-{self._stays}" if self._stays > 1 else ""
        with RobotClient(
            self._robot,
            endpoints=self._endpoints,
            identity=self._identity + suffix,
            in_order=self._pace is Pace.LOCKSTEP,
            stop=self._stop,
        ) as client:
            if not client.connect(timeout_s=timeout_s):
                return End(EndReason.STOPPED, self._stop.cause)
            # All slow work comes before the robot waits for the first answer.
            with quiet_interpreter():
                requests = self._requests_at(client)
                loop = self._loop(client, requests)
                try:
                    q_held = self._take_command(client)
                except RobotUnreachableError:
                    if client.robot_is_here:
                        raise  # it is silent, or may not answer us
                    return End(EndReason.ROBOT_GONE, may_return=True)
                end = loop.run(q_held, self._stop)
                if requests.holding:
                    return end._replace(may_return=False)
                return end

    def _take_command(self, client: RobotClient) -> Array:
        """Take command; return the posture that the robot holds."""
        robots_pace = client.take_lease().pace
        if robots_pace != self._pace:
            raise RequestRefusedError(
                f"the robot runs in {robots_pace}, this command in {self._pace}; "
                f"give it --{robots_pace}",
                refusal=RequestRefusal.PACE,
                detail=f"the robot runs in {robots_pace}",
            )
        q_held = client.enable()
        self._walk = None  # its steps begin where the robot stands now
        if self._has_commanded:
            self.telemetry.restarts += 1
            _LOG.warning("in command again, as %s", client.identity)
        self._has_commanded = True
        return q_held

    def _requests_at(self, client: RobotClient) -> RequestHandler:
        if self._requests is None:
            self._requests = RequestHandler(
                client, self._settings, period_s=self._robot.period_s
            )
        else:
            self._requests.move_to(client)
        return self._requests

    def _loop(self, client: RobotClient, requests: RequestHandler) -> Loop:
        def make_safety() -> Safety:
            settings = requests.settings
            controller = self._first or self._make(settings)
            self._first = None
            return Safety(controller, self._robot, settings.safety)

        return Loop(
            make_safety,
            client,
            self.telemetry,
            requests,
            period_s=self._robot.period_s,
            leave_s=self._settings.safety.leave_s,
            failure_file=self._failure_file,
            walk=self._walk,
            limits=self._limits,
        )
