from __future__ import annotations

import socket

import pytest
import zenoh
from zenoh.handlers import RingChannel

from robot_io.errors import EndpointError
from robot_io.session import Role, open_session
from schemas.endpoints import Endpoints
from tests.support import wait_until


def test_a_peer_hears_the_robot(endpoints: Endpoints) -> None:
    with (
        open_session(endpoints, Role.ROBOT, namespace="walker") as robot,
        open_session(endpoints, Role.PEER, namespace="walker") as peer,
    ):
        subscriber = peer.declare_subscriber("state/x", RingChannel(4))
        publisher = robot.declare_publisher("state/x")
        wait_until(lambda: publisher.matching_status.matching, what="the peer")
        publisher.put(b"hello")
        assert subscriber.handler.recv().payload.to_bytes() == b"hello"


def test_namespaces_do_not_hear_each_other(endpoints: Endpoints) -> None:
    with (
        open_session(endpoints, Role.ROBOT, namespace="walker") as robot,
        open_session(endpoints, Role.PEER, namespace="other") as other,
        open_session(endpoints, Role.PEER, namespace="walker") as peer,
    ):
        strange = other.declare_subscriber("state/x", RingChannel(4))
        subscriber = peer.declare_subscriber("state/x", RingChannel(4))
        publisher = robot.declare_publisher("state/x")
        wait_until(lambda: publisher.matching_status.matching, what="the peer")
        publisher.put(b"hello")
        assert subscriber.handler.recv().payload.to_bytes() == b"hello"
        assert strange.handler.try_recv() is None


def test_port_in_use_names_the_endpoint() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        locator = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        with (
            pytest.raises(EndpointError, match=r"in use.*another port") as caught,
            open_session(Endpoints(listen=[locator]), Role.ROBOT, namespace="walker"),
        ):
            pass
    assert locator in str(caught.value)
    assert caught.value.locators == [locator]


@pytest.mark.parametrize("role", Role)
def test_unknown_protocol_is_refused_on_both_ends(role: Role) -> None:
    endpoints = Endpoints(listen=["pigeon/1"], connect=["pigeon/1"])
    with (
        pytest.raises(EndpointError, match=r"pigeon.*expected locators such as tcp/"),
        open_session(endpoints, role, namespace="walker"),
    ):
        pass


def test_the_port_is_free_again_after_an_error_inside(endpoints: Endpoints) -> None:
    with (
        pytest.raises(ZeroDivisionError),
        open_session(endpoints, Role.ROBOT, namespace="walker"),
    ):
        raise ZeroDivisionError
    with open_session(endpoints, Role.ROBOT, namespace="walker") as session:
        assert isinstance(session, zenoh.Session)


def test_a_host_that_never_speaks_does_not_hang_the_close() -> None:
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        locator = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        with open_session(
            Endpoints(connect=[locator]), Role.PEER, namespace="walker"
        ) as session:
            assert list(session.info.peers_zid()) == []
