"""A relay between a real server and a real client, over Zenoh on this host."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import Any

import msgspec
import pytest

from surefoot.robot_io.client_side.client import RobotClient
from surefoot.robot_io.client_side.observer import Observer
from surefoot.robot_io.client_side.requests import Requests
from surefoot.robot_io.errors import RequestRefusedError, RobotUnreachableError
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.relay.relay import Relay
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.relay_plan import RelayPlan
from surefoot.schemas.result import RelayResult
from surefoot.schemas.toml_file import convert
from tests.robot_io.client_at_work import new_client
from tests.robot_io.meeting_places import meeting_place
from tests.robot_io.served_robot import ServedRobot, serving
from tests.support import PATIENCE_S, free_port, wait_until

WALKER = load_robot("walker")
WAIT_S = 0.2
"""Wait for messages that must not come [s]."""


def plan(*faults: dict[str, Any]) -> RelayPlan:
    """Return a plan with these faults."""
    return convert({"name": "test", "fault": list(faults)}, RelayPlan, source="test")


class Line:
    """A robot, a relay, and the endpoints that the stabilizer's side dials."""

    def __init__(self, robot: ServedRobot, beyond: Endpoints) -> None:
        self.robot = robot
        self.beyond = beyond
        self.stop_relay = StopRequest()
        self.result: Future[RelayResult] = Future()

    def mode(self) -> RobotMode:
        return self.robot.do(lambda server, gate: gate.mode)

    def holder(self) -> str:
        return self.robot.do(lambda server, gate: gate.modes.lease.holder)


@contextmanager
def line(endpoints: Endpoints, relay_plan: RelayPlan) -> Iterator[Line]:
    """Run robot and relay, each in a thread, until the context is left."""
    there = f"tcp/127.0.0.1:{free_port()}"
    both = Endpoints(listen=[there], connect=endpoints.connect)
    ready = threading.Event()
    with serving(WALKER, endpoints) as robot:
        made = Line(robot, Endpoints(listen=[], connect=[there]))

        def run() -> None:
            try:
                relay = Relay(WALKER, relay_plan, seed=0)
                made.result.set_result(
                    relay.run(
                        both,
                        stop=made.stop_relay,
                        wait_s=PATIENCE_S,
                        on_ready=ready.set,
                    )
                )
            except Exception as error:
                made.result.set_exception(error)
                ready.set()

        thread = threading.Thread(target=run)
        thread.start()
        try:
            assert ready.wait(PATIENCE_S), "the relay did not open"
            yield made
        finally:
            made.stop_relay.set()
            thread.join()


@contextmanager
def commanding(made: Line, identity: str = "ann") -> Iterator[RobotClient]:
    """Return a client beyond the relay that has taken command of the robot."""
    with new_client(made.beyond, identity) as client:
        assert client.connect(timeout_s=PATIENCE_S)
        client.take_lease()
        client.enable()
        yield client


def first_command(made: Line, client: RobotClient) -> None:
    """Send the command at which the plan's time begins."""
    tick = made.robot.publish_tick()
    assert client.wait_snapshot(timeout_s=PATIENCE_S) is not None
    client.send(WALKER.nominal, tick=tick)
    wait_until(
        lambda: made.robot.do(lambda server, gate: gate._sequence) == 0,
        what="the first command",
    )


def accepted(made: Line) -> int:
    """Return the sequence number of the last command that reached the robot."""
    return made.robot.do(lambda server, gate: gate._sequence)


def test_a_clear_relay_carries_everything(endpoints: Endpoints) -> None:
    with line(endpoints, plan()) as made, commanding(made) as client:
        assert made.mode() is RobotMode.ACTIVE
        assert made.holder() == "ann"
        for number in range(20):
            tick = made.robot.publish_tick()
            reading = client.wait_snapshot(timeout_s=PATIENCE_S)
            assert reading is not None
            assert (reading.snapshot.tick, reading.stale) == (tick, ())
            client.send(WALKER.nominal, tick=tick)
            wait_until(lambda n=number: accepted(made) == n, what="the command")
        wait_until(lambda: client.status() is not None, what="the robot's status")
        caller = client._services
        assert Requests(caller, WALKER, source="ann").stop_robot().accepted
        assert made.mode() is RobotMode.FAULT
        made.stop_relay.set()
        counts = made.result.result(PATIENCE_S).counts
    assert counts["joints"] == {"arrived": 20, "left": 20}
    assert counts["joint_command"] == {"arrived": 20, "left": 20}
    assert counts["estop"] == {"arrived": 1, "left": 1}


def test_who_asks_beyond_the_relay_is_refused_with_the_robots_own_words(
    endpoints: Endpoints,
) -> None:
    with (
        line(endpoints, plan()) as made,
        commanding(made),
        new_client(made.beyond, "eve") as eve,
    ):
        assert eve.connect(timeout_s=PATIENCE_S)
        with pytest.raises(RequestRefusedError, match="ann holds the lease"):
            eve.take_lease()


def test_who_is_there_is_seen_on_both_sides(endpoints: Endpoints) -> None:
    with line(endpoints, plan()) as made:
        with Observer(WALKER, endpoints=endpoints, channels=("status",)) as observer:
            observer.connect(timeout_s=PATIENCE_S)
            with commanding(made):
                wait_until(lambda: observer.stabilizers == ("ann",), what="ann")
            wait_until(lambda: observer.stabilizers == (), what="ann to go")
        assert made.holder() == ""


def test_a_stabilizer_loses_the_robot_when_the_relay_ends(
    endpoints: Endpoints,
) -> None:
    with line(endpoints, plan()) as made, commanding(made) as client:
        made.stop_relay.set()
        wait_until(lambda: not client.robot_is_here, what="the robot to be gone")
        wait_until(lambda: made.holder() == "", what="the lease to be lost")
        assert made.mode() is RobotMode.HOLD


def test_a_cut_of_one_sensor_leaves_the_others(endpoints: Endpoints) -> None:
    cut = {"kind": "cut", "topics": ["imu"], "duration_s": 3600.0}
    with line(endpoints, plan(cut)) as made, commanding(made) as client:
        first_command(made, client)
        tick = made.robot.publish_tick()
        reading = client.wait_snapshot(timeout_s=PATIENCE_S)
        assert reading is not None
        assert (reading.snapshot.tick, reading.stale) == (tick, ("imu",))
        assert reading.ages == (0, 1, 0, 0)


def test_copies_of_commands_are_refused_and_counted(endpoints: Endpoints) -> None:
    twice = {"kind": "duplicate", "direction": "commands", "probability": 1.0}
    with line(endpoints, plan(twice)) as made, commanding(made) as client:
        first_command(made, client)
        wait_until(
            lambda: made.robot.do(lambda server, gate: gate.refused["sequence"]) == 1,
            what="the copy to be refused",
        )


def test_a_lost_request_is_asked_again(endpoints: Endpoints) -> None:
    loss = {"kind": "drop", "topics": ["mode"], "probability": 0.5}
    with line(endpoints, plan(loss)) as made, commanding(made) as client:
        first_command(made, client)
        for _ in range(10):
            client.request_mode("hold")
        made.stop_relay.set()
        counts = made.result.result(PATIENCE_S).counts["mode"]
    assert counts["drop"] > 0
    assert counts["left"] >= 10


def test_a_delayed_command_comes_later_than_what_is_not_delayed(
    endpoints: Endpoints,
) -> None:
    late = {"kind": "delay", "direction": "commands", "ms": 1000.0 * WAIT_S}
    with line(endpoints, plan(late)) as made, commanding(made) as client:
        tick = made.robot.publish_tick()
        assert client.wait_snapshot(timeout_s=PATIENCE_S) is not None
        client.send(WALKER.nominal, tick=tick)
        client.request_mode("hold")  # a service, which nothing delays
        assert accepted(made) == -1
        wait_until(lambda: accepted(made) == 0, what="the command after all")


def test_without_a_robot_the_relay_gives_up(endpoints: Endpoints) -> None:
    both = Endpoints(listen=[f"tcp/127.0.0.1:{free_port()}"], connect=endpoints.connect)
    with pytest.raises(RobotUnreachableError, match="nobody answers"):
        Relay(WALKER, plan(), seed=0).run(both, stop=StopRequest(), wait_s=0.1)


def test_a_relay_waits_for_the_robot_behind_a_router() -> None:
    with meeting_place(routed=True) as routed:
        both = msgspec.structs.replace(routed, listen=[f"tcp/127.0.0.1:{free_port()}"])
        relay, ready = Relay(WALKER, plan(), seed=0), threading.Event()
        with pytest.raises(RobotUnreachableError, match="no robot 'walker' is ready"):
            relay.run(both, stop=StopRequest(), wait_s=0.1, on_ready=ready.set)
        assert not ready.is_set()
        stop = StopRequest()
        thread = threading.Thread(
            target=relay.run,
            args=(both,),
            kwargs={"stop": stop, "wait_s": PATIENCE_S, "on_ready": ready.set},
        )
        thread.start()
        try:
            with serving(WALKER, routed):
                assert ready.wait(PATIENCE_S)
        finally:
            stop.set()
            thread.join()
