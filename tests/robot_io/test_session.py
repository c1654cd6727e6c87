from __future__ import annotations

import os
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import msgspec
import pytest
import zenoh
from zenoh.handlers import RingChannel

from surefoot.robot_io.bus import session
from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.bus.session import RUNTIME_VARIABLE, Role, open_session
from surefoot.robot_io.errors import EndpointError, RobotUnreachableError
from surefoot.schemas.endpoints import Endpoints
from tests.robot_io.meeting_places import meeting_place
from tests.support import PATIENCE_S, free_port, wait_until

DIALING_S = 0.5


def test_namespaces_do_not_hear_each_other(endpoints: Endpoints) -> None:
    with (
        open_session(endpoints, Role.ROBOT, namespace="walker") as robot,
        open_session(endpoints, Role.CLIENT, namespace="other") as other,
        open_session(endpoints, Role.CLIENT, namespace="walker") as client,
    ):
        strange = other.declare_subscriber("state/x", RingChannel(4))
        subscriber = client.declare_subscriber("state/x", RingChannel(4))
        publisher = robot.declare_publisher("state/x")
        wait_until(lambda: publisher.matching_status.matching, what="the client")
        publisher.put(b"hello")
        assert subscriber.handler.recv().payload.to_bytes() == b"hello"
        assert strange.handler.try_recv() is None


def test_what_is_delivered_arrives_on_a_link_that_is_full(endpoints: Endpoints) -> None:
    words = [b"%d" % number for number in range(10)]
    with (
        Bus(endpoints, Role.ROBOT, namespace="walker") as robot,
        Bus(endpoints, Role.CLIENT, namespace="walker", timeout_s=PATIENCE_S) as client,
    ):
        heard = client.channel("words", depth=len(words))
        drowned = client.channel("flood", depth=1)
        flood = robot.publisher("flood", urgent=False)
        wait_until(lambda: flood.matching_status.matching, what="the client")
        for word in words:
            for _ in range(300):
                flood.put(bytes(60_000))
            robot.deliver("words", word)
        deadline = time.monotonic() + PATIENCE_S
        assert [heard.wait(deadline) for _ in words] == words
        assert drowned.poll()


def test_port_in_use_names_the_endpoint() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        locator = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        with (
            pytest.raises(EndpointError, match=rf"{locator}.*in use.*another port"),
            open_session(Endpoints(listen=[locator]), Role.ROBOT, namespace="walker"),
        ):
            pass


def test_a_name_that_does_not_resolve_cannot_be_listened_on() -> None:
    endpoints = Endpoints(listen=["tcp/nowhere.invalid:7447"], insecure=True)
    with (
        pytest.raises(EndpointError, match=r"nowhere.invalid:7447: failed to lookup"),
        open_session(endpoints, Role.ROBOT, namespace="walker"),
    ):
        pass


def test_clients_hear_each_other_through_the_robot(endpoints: Endpoints) -> None:
    with (
        open_session(endpoints, Role.ROBOT, namespace="walker"),
        open_session(endpoints, Role.CLIENT, namespace="walker") as planner,
        open_session(endpoints, Role.CLIENT, namespace="walker") as stabilizer,
    ):
        subscriber = stabilizer.declare_subscriber("ref", RingChannel(4))
        publisher = planner.declare_publisher("ref")
        wait_until(lambda: publisher.matching_status.matching, what="the stabilizer")
        publisher.put(b"hello")
        assert subscriber.handler.recv().payload.to_bytes() == b"hello"


def test_the_port_is_free_again_after_an_error_inside(endpoints: Endpoints) -> None:
    with (
        pytest.raises(ZeroDivisionError),
        open_session(endpoints, Role.ROBOT, namespace="walker"),
    ):
        raise ZeroDivisionError
    with open_session(endpoints, Role.ROBOT, namespace="walker") as session:
        assert isinstance(session, zenoh.Session)


def test_a_host_that_never_speaks_is_no_robot() -> None:
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        locator = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        with (
            pytest.raises(RobotUnreachableError, match="nobody answers"),
            open_session(
                Endpoints(connect=[locator]),
                Role.CLIENT,
                namespace="walker",
                timeout_s=0.1,
            ),
        ):
            pass


def test_threads_may_open_sessions_at_the_same_time(
    endpoints: Endpoints, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each sees the variable neither half set nor taken away by another one."""
    count = 8
    together = threading.Barrier(count)

    class Slow(dict[str, str]):
        """An environment in which each look takes so long that all look at once."""

        def __contains__(self, key: object) -> bool:
            is_there = super().__contains__(key)
            if key == RUNTIME_VARIABLE:
                time.sleep(0.05)  # the slow look itself
            return is_there

    monkeypatch.setattr(session.os, "environ", Slow(os.environ))

    def dial(_: int) -> None:
        together.wait()
        with (
            pytest.raises(RobotUnreachableError),
            open_session(endpoints, Role.CLIENT, namespace="walker", timeout_s=0.05),
        ):
            pass

    with ThreadPoolExecutor(max_workers=count) as pool:
        list(pool.map(dial, range(count)))
    assert RUNTIME_VARIABLE not in session.os.environ


@pytest.mark.parametrize("role", [Role.ROBOT, Role.CLIENT])
def test_the_first_place_that_answers_is_taken(role: Role) -> None:
    with meeting_place(routed=True) as routed:
        places = [f"tcp/127.0.0.1:{free_port()}", *routed.router]
        several = msgspec.structs.replace(routed, router=places)
        with open_session(
            several, role, namespace="walker", timeout_s=DIALING_S
        ) as session:
            assert list(session.info.routers_zid())
