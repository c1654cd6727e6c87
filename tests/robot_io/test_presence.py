"""Arrival and departure of robot and client, and the end of waits."""

from __future__ import annotations

import math
import threading
import time
from contextlib import ExitStack

import pytest

from surefoot.robot_io.bus import bus
from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.bus.session import Role
from surefoot.robot_io.client_side import robot_watch
from surefoot.robot_io.errors import RobotUnreachableError
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.server import NoAnswer, RobotServer
from surefoot.schemas.endpoints import Endpoints
from tests.robot_io.client_at_work import (
    WALKER,
    new_client,
)
from tests.robot_io.served_robot import ServedRobot, serving
from tests.support import PATIENCE_S, wait_until


def test_no_robot_is_an_error_that_names_endpoint_and_limit(
    endpoints: Endpoints,
) -> None:
    with (
        new_client(endpoints, "ann") as client,
        pytest.raises(RobotUnreachableError, match=r"within 0.2 s.*is the robot") as e,
    ):
        client.connect(timeout_s=0.2)
    assert endpoints.connect[0] in str(e.value)


def test_something_else_that_listens_is_not_taken_for_the_robot(
    endpoints: Endpoints,
) -> None:
    with (
        Bus(endpoints, Role.ROBOT, namespace="other"),
        new_client(endpoints, "ann") as client,
        pytest.raises(RobotUnreachableError, match="no robot 'walker' is ready"),
    ):
        client.connect(timeout_s=0.2)


def test_the_client_notices_that_the_robot_is_gone(endpoints: Endpoints) -> None:
    with new_client(endpoints, "ann") as client:
        with serving(WALKER, endpoints):
            client.connect(timeout_s=PATIENCE_S)
            client.take_lease()
        wait_until(lambda: not client.robot_is_here, what="the robot to be gone")
        assert client.wait_snapshot(timeout_s=PATIENCE_S) is None, "the wait is ended"
        with pytest.raises(RobotUnreachableError, match="went away"):
            client.enable()


def test_the_client_may_come_before_the_robot(endpoints: Endpoints) -> None:
    started = threading.Event()
    over = threading.Event()

    def robot() -> None:
        started.wait(PATIENCE_S)
        with serving(WALKER, endpoints):
            over.wait(PATIENCE_S)

    thread = threading.Thread(target=robot)
    thread.start()
    with new_client(endpoints, "ann") as client:
        started.set()
        assert client.connect(timeout_s=PATIENCE_S)
        client.take_lease()
        client.enable()
    over.set()
    thread.join()


def test_a_stop_request_ends_the_robots_waits(endpoints: Endpoints) -> None:
    stop = StopRequest()
    stop.set("a test")
    gate = CommandGate(WALKER, WALKER.nominal)
    with RobotServer(WALKER, gate, endpoints=endpoints, stop=stop) as server:
        assert not server.wait_until_active(timeout_s=None)
        deadline = time.monotonic() + PATIENCE_S
        assert server.answer(0, now_s=0.0, deadline=deadline) is NoAnswer.YET
        assert time.monotonic() < deadline


def test_a_stop_request_ends_the_clients_waits(
    served: ServedRobot, endpoints: Endpoints
) -> None:
    stop = StopRequest()
    with new_client(endpoints, "ann", stop) as client:
        assert client.connect(timeout_s=PATIENCE_S)
        stop.set("a test")
        begin = time.monotonic()
        assert client.wait_snapshot(timeout_s=PATIENCE_S) is None
        assert time.monotonic() < begin + PATIENCE_S
    with new_client(endpoints, "bob", stop) as late:
        assert not late.connect(timeout_s=PATIENCE_S)


@pytest.mark.parametrize("is_other_there", [False, True])
def test_a_long_wait_tells_once_what_is_missing(
    endpoints: Endpoints,
    is_other_there: bool,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    for module in (bus, robot_watch):
        monkeypatch.setattr(module, "TELL_S", 0.1)
    stop = StopRequest()

    def connect() -> None:
        with new_client(endpoints, "ann", stop) as client:
            client.connect(timeout_s=math.inf)

    def told() -> list[str]:
        return [record.getMessage() for record in caplog.records]

    with ExitStack() as stack:
        if is_other_there:
            stack.enter_context(Bus(endpoints, Role.ROBOT, namespace="other"))
        waiting = threading.Thread(target=connect)
        waiting.start()
        wait_until(lambda: bool(told()), what="a word of the wait")
        waiting.join(1.5)
        stop.set("a test")
        waiting.join()
    (words,) = told()
    what = "no robot 'walker' is ready" if is_other_there else "nobody answers"
    assert words.startswith(f"{what} at {endpoints.connect[0]}")
