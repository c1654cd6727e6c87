"""A relay between robot and stabilizer, and the shipped plans of faults."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from surefoot.robot_io.bus.bus import Bus, dial
from surefoot.robot_io.bus.session import Role, expect_to_listen
from surefoot.robot_io.client_side.robot_watch import RobotWatch
from surefoot.robot_io.errors import RobotIoError
from surefoot.robot_io.realtime import StopRequest, quiet_interpreter
from surefoot.robot_io.relay.forwarder import (
    Dispatcher,
    Forwarder,
    PresenceMirror,
    ServiceForwarder,
)
from surefoot.robot_io.relay.lane import Lane, PlanClock
from surefoot.robot_io.robot import Robot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.relay_plan import RelayPlan
from surefoot.schemas.result import RelayResult
from surefoot.schemas.toml_file import find_toml
from surefoot.schemas.topics import (
    ALIVE_OBSERVER,
    ALIVE_ROBOT,
    ALIVE_STABILIZER,
    SERVICES,
    TOPICS,
    Direction,
)

PLANS_DIR = Path(__file__).parent / "plans"


def list_plans() -> list[str]:
    """Return the names of the shipped plans, sorted."""
    return sorted(path.stem for path in PLANS_DIR.glob("*.toml"))


def find_plan(name_or_path: str) -> Path:
    """Return the path of a plan, given a shipped name or a path.

    Raises:
        FileFormatError: there is no such plan; the message names the nearest.
    """
    shipped = {name: PLANS_DIR / f"{name}.toml" for name in list_plans()}
    return find_toml(name_or_path, shipped, what="relay plan", error=FileFormatError)


POLL_S = 0.1


FROM_THE_ROBOTS_SIDE = (
    Direction.FROM_ROBOT,
    Direction.TO_STABILIZER,
    Direction.STABILIZER_SERVICE,
)
"""Directions of messages and requests from the side of robot, planners and tools."""


class Relay:
    """Dials the robot as a client does, and listens as the robot does.

    It carries each entry of the topic table in one direction: messages of the robot or
    a planner to the stabilizer's side, messages of the stabilizer to the robot's side,
    and requests to the side of their service. It shows on each side who is present on
    the other.
    """

    def __init__(self, robot: Robot, plan: RelayPlan, *, seed: int) -> None:
        """Prepare; :meth:`run` opens both sides."""
        self._robot = robot
        self._plan = plan
        self._lanes = {
            entry.name: Lane(plan, entry.name, seed=seed) for entry in TOPICS
        }
        self._forwarders: list[Forwarder] = []
        self._watch = RobotWatch(robot)

    def run(
        self,
        endpoints: Endpoints,
        *,
        stop: StopRequest,
        wait_s: float,
        listening: Endpoints | None = None,
        on_ready: Callable[[], None] | None = None,
    ) -> RelayResult:
        """Forward until asked to stop.

        The robot may come and go meanwhile; at the start it must be there.

        Args:
            endpoints: ``connect`` (or ``router``) leads to the robot; the stabilizer's
                side dials ``listen``.
            stop: ends the relay, besides signals.
            wait_s: how long the robot may take to be there [s].
            listening: its ``listen``, certificates and access are used instead for the
                stabilizer's side, since with TLS each side has an identity.
            on_ready: called once both sides are open.

        Returns:
            Counts of what was done to the messages.

        Raises:
            EndpointError: Zenoh cannot listen there, or a locator is malformed.
            RobotUnreachableError: no robot was ready in time.
            RobotMismatchError: the robot has another description, or there are two.
            RobotIoError: the relay cannot send any more.
        """
        expect_to_listen()
        place = listening or endpoints
        pause = threading.Event()  # never set: a signal may come in the midst of a wait
        dispatcher = Dispatcher()
        with stop.on_signals(), ExitStack() as stack:
            namespace = self._robot.file.namespace
            end_s = time.monotonic() + wait_s
            robots_side = dial(
                stack, endpoints, namespace=namespace, timeout_s=wait_s, stop=stop
            )
            if robots_side is not None:
                self._watch.follow(robots_side)
                self._watch.find_within(
                    end_s, endpoints=endpoints, timeout_s=wait_s, stop=stop
                )
            if robots_side is not None and not stop.is_set:
                other_side = stack.enter_context(
                    Bus(place, Role.ROBOT, namespace=namespace, keys=self._robot.keys)
                )
                stack.enter_context(dispatcher.running())
                stack.enter_context(quiet_interpreter())
                stack.callback(self._disconnect)
                self._connect(robots_side, other_side, dispatcher)
                if on_ready is not None:
                    on_ready()
                while not stop.is_set:
                    pause.wait(POLL_S)
                    self._watch.check()
                    if dispatcher.error is not None:
                        raise RobotIoError(
                            f"the relay cannot send any more: {dispatcher.error}"
                        ) from dispatcher.error
        counts = {name: dict(lane.counts) for name, lane in self._lanes.items()}
        return RelayResult(
            plan=self._plan.name,
            counts={name: count for name, count in counts.items() if count},
        )

    def _connect(
        self, robots_side: Bus, other_side: Bus, dispatcher: Dispatcher
    ) -> None:
        """Join the two sides; tokens come last, as on the sides themselves."""
        clock = PlanClock()
        for entry in TOPICS:
            ends = {"source": other_side, "target": robots_side}
            if entry.direction in FROM_THE_ROBOTS_SIDE:
                ends = {"source": robots_side, "target": other_side}
            key, lane = self._robot.keys[entry.name], self._lanes[entry.name]
            if entry.direction in SERVICES:
                ServiceForwarder(
                    key, lane=lane, dispatcher=dispatcher, clock=clock, **ends
                )
            else:
                self._forwarders.append(
                    Forwarder(
                        entry.name,
                        key,
                        lane=lane,
                        dispatcher=dispatcher,
                        clock=clock,
                        **ends,
                    )
                )
        for pattern, source, target in (
            (f"{ALIVE_ROBOT}/**", robots_side, other_side),
            (f"{ALIVE_STABILIZER}/*", other_side, robots_side),
            (f"{ALIVE_OBSERVER}/*", other_side, robots_side),
        ):
            PresenceMirror(pattern, source=source, target=target, dispatcher=dispatcher)

    def _disconnect(self) -> None:
        """Stop receiving, so that nothing is sent on a closed side."""
        for forwarder in self._forwarders:
            forwarder.close()
