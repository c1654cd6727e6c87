"""A robot without a body: server and gate in a thread, in step with its commander."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import TypeVar

import msgspec

from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.server import RobotServer
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import SCHEMA_VERSION, LeaseRequest
from tests.robot_io.sensor_messages import snapshot_at
from tests.support import PATIENCE_S

T = TypeVar("T")
POLL_S = 0.002


class ServedRobot:
    """A running robot, for a test to control from another thread."""

    def __init__(self, server: RobotServer, gate: CommandGate) -> None:
        self.server = server
        self._gate = gate
        self._orders: list[tuple[Callable[[], object], Future]] = []
        self.tick = 0

    def do(self, order: Callable[[RobotServer, CommandGate], T]) -> T:
        """Call a function in the robot's own thread; return its result."""
        done: Future = Future()
        self._orders.append((lambda: order(self.server, self._gate), done))
        return done.result(timeout=PATIENCE_S)

    def loop(self, stop: StopRequest) -> None:
        """Serve requests and calls; takes commands between them."""
        pause = threading.Event()
        while not stop.is_set:
            now_s = self.tick * 1e-3
            self.server.serve_requests(now_s=now_s)
            self.server.take_newest(now_s=now_s)
            self.server.publish_status(now_s=now_s)
            while self._orders:
                order, done = self._orders.pop(0)
                try:
                    done.set_result(order())
                except Exception as error:
                    done.set_exception(error)
            pause.wait(POLL_S)

    def lease_request(self, commander: str, **changes: str) -> LeaseRequest:
        """Return a request for this robot's lease, with some fields changed."""
        identity = self.server.identity
        request = LeaseRequest(
            schema=SCHEMA_VERSION,
            action="take",
            commander=commander,
            robot=identity.instance,
            description=identity.description,
        )
        return msgspec.structs.replace(request, **changes)

    def publish_tick(self) -> int:
        """Publish the sensors of the next tick; return the tick."""
        tick = self.tick

        def order(server: RobotServer, gate: CommandGate) -> None:
            gate.begin_tick(now_s=tick * 1e-3)
            server.publish_sensors(snapshot_at(tick), stamp_ns=1)

        self.do(order)
        self.tick += 1
        return tick


@contextmanager
def serving(robot: Robot, endpoints: Endpoints) -> Iterator[ServedRobot]:
    """Run a robot until the context is left."""
    gate = CommandGate(robot, robot.nominal)
    stop = StopRequest()
    up: Future[ServedRobot] = Future()

    def run() -> None:
        try:
            with RobotServer(robot, gate, endpoints=endpoints, stop=stop) as server:
                served = ServedRobot(server, gate)
                up.set_result(served)
                served.loop(stop)
        except Exception as error:
            up.set_exception(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield up.result(timeout=PATIENCE_S)
    finally:
        stop.set()
        thread.join()
