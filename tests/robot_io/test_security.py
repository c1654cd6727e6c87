"""Rights of each identity, over TLS on loopback."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import AbstractContextManager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import numpy as np
import pytest
import zenoh
from zenoh.handlers import RingChannel

from surefoot.robot_io.bus.session import Role, open_session
from surefoot.robot_io.errors import LocatorError, RobotUnreachableError
from surefoot.robot_io.identity import new_identity
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.schemas.codec import encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import (
    RobotMode,
)
from tests.robot_io.client_at_work import new_client
from tests.robot_io.gate_at_work import command
from tests.robot_io.secured import Authority
from tests.robot_io.served_robot import ServedRobot, serving
from tests.support import PATIENCE_S, free_port, wait_until

REFUSED_WITHIN_S = 1.0
"""Time for a handshake that must fail [s]."""
ATTEMPTS = 5


@pytest.fixture(
    scope="module",
    params=[pytest.param("walker", marks=pytest.mark.slow), "walker-real"],
)
def robot(request: pytest.FixtureRequest) -> Robot:
    """Return a robot that has keys of its own beside the usual ones."""
    return load_robot(request.param)


@pytest.fixture(scope="module")
def served(authority: Authority, robot: Robot) -> Iterator[ServedRobot]:
    with serving(robot, authority.endpoints("robot")) as served:
        yield served


def as_one(
    authority: Authority, identity: str
) -> AbstractContextManager[zenoh.Session]:
    """Open a session of one of the identities."""
    return open_session(authority.endpoints(identity), Role.CLIENT, namespace="walker")


def refusals(served: ServedRobot) -> int:
    """Return how many commands reached the gate and were refused."""
    return served.do(lambda server, gate: sum(gate.refused.values()))


def can_read(session: zenoh.Session, robot: Robot, served: ServedRobot) -> bool:
    """Return whether sensors and status arrive; the robot sends them repeatedly."""
    heard = {
        name: session.declare_subscriber(robot.keys[name], RingChannel(4))
        for name in ("joints", "imu", "left_ankle_ft", "right_ankle_ft", "status")
    }
    for _ in range(ATTEMPTS):
        served.publish_tick()
        try:
            wait_until(
                lambda: any(h.handler.try_recv() for h in heard.values()),
                what="anything",
                patience_s=0.2,
            )
        except AssertionError:
            continue
        return True
    return False


def ask(session: zenoh.Session, key: str, data: bytes) -> bool:
    """Return whether a service answers; repeated, since its declaration may be late."""
    for _ in range(ATTEMPTS):
        if any(reply.ok for reply in session.get(key, payload=data, timeout=0.3)):
            return True
    return False


def test_the_stabilizer_reads_commands_and_asks(
    authority: Authority, robot: Robot, served: ServedRobot
) -> None:
    with new_client(authority.endpoints("stabilizer"), "ann", robot=robot) as ann:
        assert ann.connect(timeout_s=PATIENCE_S)
        ann.take_lease()
        q = ann.enable()
        np.testing.assert_array_equal(q, robot.nominal)
        tick = served.publish_tick()
        reading = wait_until(
            lambda: ann.wait_snapshot(timeout_s=0.1), what="a snapshot"
        )
        assert reading.snapshot.tick == tick
        ann.send(q, tick=tick)
        wait_until(
            lambda: served.do(lambda server, gate: gate._is_commanded),
            what="the command",
        )
    assert served.do(lambda server, gate: gate.mode) is RobotMode.HOLD


def test_an_observer_reads_but_does_not_command(
    authority: Authority, robot: Robot, served: ServedRobot
) -> None:
    before = refusals(served)
    with as_one(authority, "observer") as session:
        assert can_read(session, robot, served)
        for sequence in range(ATTEMPTS):
            session.put(
                robot.keys["joint_command"],
                encode(command(robot.nominal, sequence=sequence)),
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
        lease = served.lease_request("eve")
        assert not ask(session, robot.keys["lease"], encode(lease))
        assert not ask(session, robot.keys["mode"], encode(lease))
    assert refusals(served) == before  # they never even reached the gate
    assert served.do(lambda server, gate: gate.modes.lease.holder) == ""


def test_messages_that_are_too_long_are_dropped_unread(
    authority: Authority, robot: Robot, served: ServedRobot
) -> None:
    limit = authority.endpoints("robot").max_bytes
    before = refusals(served)
    with as_one(authority, "stabilizer") as session:
        publisher = session.declare_publisher(
            robot.keys["joint_command"],
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        wait_until(lambda: publisher.matching_status.matching, what="the robot")
        for size in (limit + 1, 4 * limit, 40 * limit):
            publisher.put(bytes(size))
        assert not ask(session, robot.keys["estop"], bytes(limit + 1))
        publisher.put(bytes(limit - 1))  # arrives, and after the others
        wait_until(lambda: refusals(served) > before, what="the short one")
    assert refusals(served) == before + 1
    assert served.do(lambda server, gate: gate.mode) is not RobotMode.FAULT


def test_a_planner_is_heard_by_the_stabilizer_and_does_not_command(
    authority: Authority, robot: Robot, served: ServedRobot
) -> None:
    before = refusals(served)
    with (
        as_one(authority, "stabilizer") as session,
        as_one(authority, "planner") as planner,
        as_one(authority, "observer") as observer,
    ):
        references = session.declare_subscriber(robot.keys["reference"], RingChannel(9))
        publisher = planner.declare_publisher(robot.keys["reference"])
        wait_until(lambda: publisher.matching_status.matching, what="the stabilizer")
        observer.put(robot.keys["reference"], b"forged")
        publisher.put(b"planned")
        sample = wait_until(references.handler.try_recv, what="the reference")
        assert sample.payload.to_bytes() == b"planned"
        planner.put(robot.keys["joint_command"], encode(command(robot.nominal)))
        publisher.put(b"again")
        wait_until(references.handler.try_recv, what="the second")
    assert refusals(served) == before


@pytest.mark.parametrize("identity", ["observer", "planner", "guest"])
def test_everyone_with_a_certificate_can_stop_the_robot(
    authority: Authority, robot: Robot, served: ServedRobot, identity: str
) -> None:
    authority.issue("guest", days=1)
    with as_one(authority, identity) as session:
        assert ask(session, robot.keys["estop"], b"stop")
    assert served.do(lambda server, gate: gate.mode) is RobotMode.FAULT
    with new_client(authority.endpoints("stabilizer"), "ann", robot=robot) as ann:
        assert ann.connect(timeout_s=PATIENCE_S)
        ann.take_lease()
        ann.request_mode("reset")


def test_an_identity_that_is_not_listed_reads_nothing(
    authority: Authority, robot: Robot, served: ServedRobot
) -> None:
    authority.issue("guest", days=1)
    with as_one(authority, "guest") as session:
        assert not can_read(session, robot, served)


def test_an_observer_cannot_pose_as_a_stabilizer_that_left(
    authority: Authority, robot: Robot, served: ServedRobot
) -> None:
    with new_client(authority.endpoints("stabilizer"), "ann", robot=robot) as ann:
        assert ann.connect(timeout_s=PATIENCE_S)
        ann.take_lease()
        with as_one(authority, "observer") as session:
            token = session.liveliness().declare_token("alive/stabilizer/ann")
            assert can_read(session, robot, served)
            token.undeclare()
            assert can_read(session, robot, served)
        assert served.do(lambda server, gate: gate.modes.lease.holder) == "ann"


def test_an_observer_cannot_pose_as_a_second_robot(
    authority: Authority, robot: Robot, served: ServedRobot
) -> None:
    with as_one(authority, "observer") as session:
        token = session.liveliness().declare_token(new_identity(robot).token)
        assert token is not None
        assert can_read(session, robot, served)
        with new_client(authority.endpoints("stabilizer"), "ann", robot=robot) as ann:
            assert ann.connect(timeout_s=10.0)
            assert ann.take_lease().instance == served.server.identity.instance


def no_certificate(authority: Authority, tmp_path: Path) -> dict:
    del tmp_path
    return {"root_ca_certificate": str(authority.folder / "ca.pem")}


def expired(authority: Authority, tmp_path: Path) -> dict:
    del tmp_path
    authority.issue("late", days=1, now=datetime.now(UTC) - timedelta(days=2))
    return _as_zenoh(authority.endpoints("late"))


def foreign(authority: Authority, tmp_path: Path) -> dict:
    other = Authority(tmp_path / "other").endpoints("stabilizer")
    # Trusts the robot's authority, but is signed by another.
    return {**_as_zenoh(other), "root_ca_certificate": str(authority.folder / "ca.pem")}


def _as_zenoh(endpoints: Endpoints) -> dict:
    assert endpoints.tls is not None
    return {
        "root_ca_certificate": endpoints.tls.ca,
        "connect_certificate": endpoints.tls.certificate,
        "connect_private_key": endpoints.tls.key,
        "enable_mtls": True,
    }


@pytest.mark.parametrize("make", [no_certificate, expired, foreign])
def test_without_a_valid_certificate_nothing_is_read_or_commanded(
    make: object,
    authority: Authority,
    robot: Robot,
    served: ServedRobot,
    tmp_path: Path,
) -> None:
    before = refusals(served)
    config = {
        "mode": "client",
        "namespace": "walker",
        "connect": {
            "endpoints": authority.endpoints("robot").connect,
            "timeout_ms": 1000 * REFUSED_WITHIN_S,
            "exit_on_failure": False,
        },
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"link": {"tls": make(authority, tmp_path)}},
    }
    try:
        session = zenoh.open(
            zenoh.Config.from_json5(msgspec.json.encode(config).decode())
        )
    except zenoh.ZError:
        pass  # turned away at once
    else:
        with session:
            assert not can_read(session, robot, served)
            session.put(robot.keys["joint_command"], encode(command(robot.nominal)))
            assert not ask(session, robot.keys["estop"], b"stop")
    assert refusals(served) == before
    assert served.do(lambda server, gate: gate.mode) is not RobotMode.FAULT


def test_a_client_is_told_that_the_robot_is_of_another_authority(
    authority: Authority, robot: Robot, served: ServedRobot, tmp_path: Path
) -> None:
    """Its own name is not known here, so it is asked whether it is trusted there."""
    other = Authority(tmp_path / "other").endpoints("stabilizer")
    there = msgspec.structs.replace(other, connect=authority.endpoints("robot").connect)
    with (
        pytest.raises(RobotUnreachableError, match="of another authority than ours"),
        new_client(there, "ann", robot=robot) as late,
    ):
        late.connect(timeout_s=REFUSED_WITHIN_S)


@pytest.mark.parametrize(
    "locator",
    [
        "tcp/0.0.0.0:0",
        "tcp/[::]:0",
        "udp/192.0.2.1:1",
        "ws/robot.lan:1",
    ],
)
@pytest.mark.parametrize("role", [Role.ROBOT, Role.ROUTER])
def test_listening_on_a_network_without_tls_is_refused(
    locator: str, role: Role
) -> None:
    with (
        pytest.raises(LocatorError, match=r"command the robot.*--insecure"),
        open_session(Endpoints(listen=[locator]), role, namespace="walker"),
    ):
        pass


def test_listening_on_a_network_is_possible_on_purpose() -> None:
    port = free_port()
    endpoints = Endpoints(listen=[f"tcp/0.0.0.0:{port}"], insecure=True)
    with (
        open_session(endpoints, Role.ROBOT, namespace="walker"),
        socket.create_connection(("127.0.0.1", port)),
    ):
        pass


@pytest.mark.parametrize(
    "locator", ["tcp/127.0.0.1:0", "tcp/[::1]:0", "tcp/localhost:0"]
)
def test_loopback_needs_no_tls(locator: str) -> None:
    with open_session(Endpoints(listen=[locator]), Role.ROBOT, namespace="walker"):
        pass


def test_tls_and_plain_locators_do_not_mix(authority: Authority) -> None:
    plain = msgspec.structs.replace(
        authority.endpoints("robot"), listen=["tcp/127.0.0.1:0"]
    )
    with (
        pytest.raises(LocatorError, match="not encrypted although"),
        open_session(plain, Role.ROBOT, namespace="walker"),
    ):
        pass
    with (
        pytest.raises(LocatorError, match=r"needs certificates.*\[tls\]"),
        open_session(
            Endpoints(listen=["tls/127.0.0.1:0"]), Role.ROBOT, namespace="walker"
        ),
    ):
        pass
