"""A process reports errors of its own addresses and certificates."""

from __future__ import annotations

import os
import socket
import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import pytest

from surefoot.errors import ExitCode, exit_code_of
from surefoot.robot_io.bus.session import Role, open_session
from surefoot.robot_io.client_side.observer import Observer
from surefoot.robot_io.errors import (
    CertificateError,
    EndpointError,
    LocatorError,
    RobotUnreachableError,
)
from surefoot.robot_io.robot import load_robot
from surefoot.robot_io.security.locators import check_locators
from surefoot.robot_io.security.own_certificates import peer_fault
from surefoot.schemas.endpoints import Endpoints, load_endpoints
from tests.robot_io.secured import Authority
from tests.robot_io.served_robot import serving
from tests.support import free_port

WALKER = load_robot("walker")


def opened(endpoints: Endpoints, role: Role = Role.ROBOT) -> None:
    with open_session(endpoints, role, namespace="walker", timeout_s=0.2):
        pass


@pytest.mark.parametrize(
    ("locator", "words"),
    [
        ("tcp/127.0.0.1:99999", "got the port '99999', expected a number up to 65535"),
        ("tcp/127.0.0.1:80x", "got the port '80x'"),
        ("tcp/127.0.0.1:", "got the port ''"),
        ("tcp/127.0.0.1:-1", "got the port '-1'"),
        ("tcp/127.0.0.1:٣", "got the port"),
        ("tcp/127.0.0.1", "no :port at its end"),
        ("tcp/:7447", "no host before the port"),
        ("tls/:7447", "no host before the port"),
        ("tcp/::1:7447", "an IPv6 address stands in brackets"),
        ("tcp/[::zz]:7447", "no IPv6 address"),
        ("tcp/a b:7447", "a blank in it"),
        ("tcp/a,b:7447", "no name of a host"),
        ("tpc/127.0.0.1:7447", "got the protocol 'tpc'"),
        ("127.0.0.1:7447", "no protocol"),
        ("", "no protocol"),
        ("pigeon/1", "got the protocol 'pigeon'"),
        ("unixsock-stream/", "no path"),
        ("unixsock-stream/" + "x" * 200, "more than 103 bytes"),
    ],
)
@pytest.mark.parametrize("role", Role)
def test_malformed_locators_are_refused_with_what_is_wrong(
    locator: str, words: str, role: Role
) -> None:
    with pytest.raises(LocatorError) as caught:
        opened(Endpoints(listen=[locator], connect=[locator]), role)
    assert words in str(caught.value)
    assert "expected protocol/address" in str(caught.value)
    assert exit_code_of(caught.value) is ExitCode.USAGE


@pytest.mark.parametrize(
    "locator",
    [
        *("tcp/127.0.0.1:7447", "tcp/[::1]:1", "tls/robot.lan:65535", "udp/a-b_c:9"),
        *("tcp/127.0.0.1:7447#iface=lo", "unixsock-stream//tmp/a.sock", "quic/h:1?x=y"),
    ],
)
def test_well_formed_locators_pass(locator: str) -> None:
    check_locators([locator], verb="dial")


def test_port_0_is_for_listening_alone() -> None:
    check_locators(["tcp/127.0.0.1:0"], verb="listen on")
    with pytest.raises(LocatorError, match="can only be listened on"):
        check_locators(["tcp/127.0.0.1:0"], verb="dial")


def test_a_certificate_is_not_compared_with_an_ipv6_address() -> None:
    check_locators(["tls/[::1]:7447"], verb="listen on")
    with pytest.raises(LocatorError, match="dial a name of that host"):
        check_locators(["tls/[::1]:7447"], verb="dial")


def at_path(path: Path) -> Endpoints:
    return Endpoints(listen=[f"unixsock-stream/{path}"])


def test_a_file_in_the_place_of_a_socket_is_never_removed(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("mine")
    link = tmp_path / "link"
    link.symlink_to(path)
    folder = tmp_path / "folder"
    folder.mkdir()
    for place in (path, link, folder):
        with pytest.raises(LocatorError, match="there already and is no socket"):
            opened(at_path(place))
    locked = tmp_path / "free"
    lock = tmp_path / "free.lock"
    lock.write_text("mine too")
    with pytest.raises(LocatorError, match="would be its lock"):
        opened(at_path(locked))
    assert (path.read_text(), lock.read_text()) == ("mine", "mine too")
    assert link.is_symlink()
    with pytest.raises(LocatorError, match="there is no folder"):
        opened(at_path(tmp_path / "none" / "sock"))


def test_the_socket_of_a_living_process_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "sock"
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(path))
        other.listen()
        with pytest.raises(EndpointError, match="another process listens") as caught:
            opened(at_path(path))
        assert exit_code_of(caught.value) is ExitCode.ENVIRONMENT
        assert stat.S_ISSOCK(path.stat().st_mode)
    # Nobody listens any more: what is left of it may go.
    opened(at_path(path))


def test_a_router_listens_where_the_others_dial_it(tmp_path: Path) -> None:
    file = tmp_path / "router.toml"
    file.write_text(f'router = ["tcp/127.0.0.1:{free_port()}"]\n')
    endpoints = load_endpoints(file)
    assert endpoints.listen == endpoints.router
    with open_session(endpoints, Role.ROUTER, namespace="walker"):
        opened(endpoints, Role.CLIENT)
    file.write_text('listen = ["tcp/[::1]:1"]\nrouter = ["tcp/127.0.0.1:2"]\n')
    assert load_endpoints(file).listen == ["tcp/[::1]:1"]


def other_file(endpoints: Endpoints, **files: str) -> Endpoints:
    assert endpoints.tls is not None
    tls = msgspec.structs.replace(endpoints.tls, **files)
    return msgspec.structs.replace(endpoints, tls=tls)


def expired(authority: Authority, tmp_path: Path) -> Endpoints:
    authority.issue("robot-late", days=1, now=datetime.now(UTC) - timedelta(days=2))
    return authority.endpoints("robot-late")


def early(authority: Authority, tmp_path: Path) -> Endpoints:
    authority.issue("robot-soon", days=9, now=datetime.now(UTC) + timedelta(days=2))
    return authority.endpoints("robot-soon")


def others_key(authority: Authority, tmp_path: Path) -> Endpoints:
    key = str(authority.folder / "router.key.pem")
    return other_file(authority.endpoints("robot"), key=key)


def no_key(authority: Authority, tmp_path: Path) -> Endpoints:
    path = tmp_path / "odd.key.pem"
    path.write_text("not a key")
    return other_file(authority.endpoints("robot"), key=str(path))


def no_certificate(authority: Authority, tmp_path: Path) -> Endpoints:
    path = tmp_path / "odd.pem"
    path.write_bytes(os.urandom(100))
    return other_file(authority.endpoints("robot"), certificate=str(path))


def other_authority(authority: Authority, tmp_path: Path) -> Endpoints:
    other = Authority(tmp_path / "other")
    ca = str(other.folder / "ca.pem")
    return other_file(authority.endpoints("robot"), ca=ca)


@pytest.mark.parametrize(
    ("make", "name", "words"),
    [
        (expired, "robot-late.pem", "our certificate expired on 2"),
        (early, "robot-soon.pem", "is valid from 2"),
        (others_key, "router.key.pem", "does not belong to"),
        (no_key, "odd.key.pem", "no private key that can be used"),
        (no_certificate, "odd.pem", "holds no certificate"),
        (other_authority, "robot.pem", "not signed by the authority"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
@pytest.mark.parametrize("role", [Role.ROBOT, Role.CLIENT])
def test_a_process_knows_what_is_wrong_with_its_own_certificate(
    make: object,
    name: str,
    words: str,
    role: Role,
    authority: Authority,
    tmp_path: Path,
) -> None:
    endpoints = make(authority, tmp_path)  # type: ignore[operator]
    with pytest.raises(CertificateError) as caught:
        opened(endpoints, role)
    if make in (expired, early) and role is Role.ROBOT:
        assert str(datetime.now(UTC).year) in str(caught.value)
    assert name in str(caught.value)
    assert words in str(caught.value)
    assert exit_code_of(caught.value) is ExitCode.USAGE


def test_who_listens_needs_a_certificate_to_listen_with(
    authority: Authority,
) -> None:
    with pytest.raises(CertificateError, match="not a certificate to listen with"):
        opened(authority.endpoints("stabilizer"), Role.ROBOT)


def test_a_name_that_is_not_in_the_robots_certificate_is_told_with_those_that_are(
    authority: Authority,
) -> None:
    port = free_port()
    robot = msgspec.structs.replace(
        authority.endpoints("robot"), listen=[f"tls/0.0.0.0:{port}"]
    )
    observer = msgspec.structs.replace(
        authority.endpoints("observer"), connect=[f"tls/127.0.0.2:{port}"]
    )
    with (
        serving(WALKER, robot),
        Observer(WALKER, endpoints=observer, channels=("status",)) as client,
        pytest.raises(RobotUnreachableError) as caught,
    ):
        client.connect(timeout_s=0.6)
    told = str(caught.value)
    assert "is for robot, localhost, 127.0.0.1, ::1, not for 127.0.0.2" in told
    assert "--host 127.0.0.2" in told


def refused_by(robot: Endpoints, client: Endpoints, word: str) -> None:
    """A handshake with the robot alone, as a client whose certificate it refuses."""
    with serving(WALKER, robot):
        fault = peer_fault(client, client.connect)
    assert f"our certificate is refused at {client.connect[0]}" in fault
    assert word in fault


def test_a_clock_that_differs_is_told(authority: Authority) -> None:
    authority.issue("late", days=1, now=datetime.now(UTC) - timedelta(days=2))
    refused_by(
        authority.endpoints("robot"), authority.endpoints("late"), "set the clocks"
    )


def test_an_authority_that_the_robot_does_not_trust_is_told(
    authority: Authority, tmp_path: Path
) -> None:
    other = Authority(tmp_path / "other")
    both = tmp_path / "both.pem"
    files = [folder / "ca.pem" for folder in (authority.folder, other.folder)]
    both.write_text("".join(file.read_text() for file in files))
    stranger = other_file(other.endpoints("observer"), ca=str(both))
    stranger = msgspec.structs.replace(
        stranger, connect=authority.endpoints("observer").connect
    )
    refused_by(authority.endpoints("robot"), stranger, "another authority")


def test_a_host_that_is_not_known_is_told() -> None:
    place = Endpoints(connect=["tcp/no-such-robot.invalid:7447"])
    with (
        Observer(WALKER, endpoints=place, channels=("status",)) as client,
        pytest.raises(RobotUnreachableError, match=r"knows no host 'no-such-robot\.in"),
    ):
        client.connect(timeout_s=0.1)


def test_an_address_of_another_machine_is_told() -> None:
    with pytest.raises(EndpointError, match="no network interface of this machine"):
        opened(Endpoints(listen=["tcp/192.0.2.1:7447"], insecure=True))
