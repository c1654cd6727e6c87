"""Checks locators, and makes the access rules of the bus.

The listening side, robot or router, enforces the rules on incoming and outgoing
messages; nothing depends on the good will of a dialing process.
"""

from __future__ import annotations

import ipaddress
import re
import socket
import stat
from pathlib import Path

import msgspec

from surefoot.robot_io.errors import EndpointError, LocatorError
from surefoot.schemas.arrays import JsonObject
from surefoot.schemas.endpoints import DEFAULT_LOCATOR, Access, Endpoints
from surefoot.schemas.topics import ALIVE_ROBOT, ALIVE_STABILIZER, TOPICS, Direction

PROTOCOLS = ("tcp", "tls", "quic", "udp", "ws", "unixsock-stream")
SECURED = ("tls", "quic")
SOCKET_FILE = "unixsock-stream"
LARGEST_PORT = 65535
LONGEST_SOCKET_PATH = 103
"""Longest path of a Unix socket that every system allows [bytes]."""
_NAME = re.compile(r"[\w.-]+")
_BLANK = re.compile(r"\s")
_OPTIONS = re.compile(r"[?#].*", re.DOTALL)
INGRESS, EGRESS = ["ingress"], ["egress"]
ESTOP = "estop"
PUSH = "push"
_SUBSCRIBE = (
    "declare_subscriber",
    "declare_liveliness_subscriber",
    "liveliness_query",
)
_ANSWER = ("declare_queryable", "reply")
_TOLD = ("put", "query", "liveliness_token", *_ANSWER, *_SUBSCRIBE)
"""Messages that may be sent to a listed identity; other rules say what it may send."""


def check_locators(locators: list[str], *, verb: str) -> None:
    """Refuse malformed locators; Zenoh would dial them until the time is up.

    Raises:
        LocatorError: a locator is malformed, or there is none.
    """
    if not locators:
        _refuse("nowhere", "no locator is given", verb=verb)
    for locator in locators:
        why = _fault(locator, is_dialed=verb == "dial")
        if why:
            _refuse(locator, why, verb=verb)


def _refuse(locator: str, why: str, *, verb: str) -> None:
    raise LocatorError(
        f"cannot {verb} {locator}: {why}; expected protocol/address with one of "
        f"{', '.join(PROTOCOLS)}, such as {DEFAULT_LOCATOR}"
    )


def _fault(locator: str, *, is_dialed: bool) -> str:
    """Return what is wrong with a locator; empty when it is well formed."""
    protocol, slash, rest = locator.partition("/")
    if not slash or protocol not in PROTOCOLS:
        return f"got the protocol {protocol!r}" if slash else "no protocol before a /"
    if _BLANK.search(rest):
        return "a blank in it"
    address = _OPTIONS.sub("", rest)
    if protocol == SOCKET_FILE:
        return _path_fault(address)
    host, colon, port = address.rpartition(":")
    if not colon:
        return "no :port at its end"
    if not port.isascii() or not port.isdigit() or int(port) > LARGEST_PORT:
        return f"got the port {port!r}, expected a number up to {LARGEST_PORT}"
    if is_dialed and int(port) == 0:
        return "port 0 means any free one, which can only be listened on"
    if is_dialed and protocol in SECURED and host.startswith("["):
        return (
            "Zenoh compares certificates with names and IPv4 addresses only; dial a "
            "name of that host, which /etc/hosts may give it"
        )
    return _host_fault(host)


def _path_fault(path: str) -> str:
    if not path or path.endswith("/"):
        return "no path of a socket after the protocol"
    if len(path.encode()) > LONGEST_SOCKET_PATH:
        return f"a path of more than {LONGEST_SOCKET_PATH} bytes, the most for a socket"
    return ""


def _host_fault(host: str) -> str:
    if not host:
        return "no host before the port"
    if host.startswith("[") and host.endswith("]"):
        try:
            ipaddress.IPv6Address(host[1:-1])
        except ValueError:
            return f"got {host}, which is no IPv6 address"
        return ""
    if ":" in host:
        return "an IPv6 address stands in brackets, such as [::1]:7447"
    return "" if _NAME.fullmatch(host) else f"got {host!r}, which is no name of a host"


def place_of(locator: str) -> tuple[str, int]:
    """Return host, without brackets, and port of a well-formed locator."""
    address = _OPTIONS.sub("", locator.split("/", 1)[1])
    host, _, port = address.rpartition(":")
    return host.strip("[]"), int(port)


def check_socket_files(locators: list[str]) -> None:
    """Refuse to listen where Zenoh would remove a file of others.

    A socket on which nobody listens any more may be replaced.

    Raises:
        LocatorError: the path or its lock is another file, or the folder is missing.
        EndpointError: another process listens there.
    """
    for locator in locators:
        if protocol_of(locator) == SOCKET_FILE:
            path = Path(_OPTIONS.sub("", locator.split("/", 1)[1]))
            _check_socket_file(path, locator)


def _check_socket_file(path: Path, locator: str) -> None:
    def refused(what: str) -> LocatorError:
        return LocatorError(
            f"cannot listen on {locator}: {what}; name a path that is free"
        )

    if not path.parent.is_dir():
        raise refused(f"there is no folder {path.parent}")
    lock = path.with_name(path.name + ".lock")
    try:
        is_locked = stat.S_ISREG(lock.lstat().st_mode) and not lock.lstat().st_size
    except FileNotFoundError:
        is_locked = True
    if not is_locked:
        raise refused(f"{lock}, which would be its lock, holds something else")
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(mode):
        raise refused(f"{path} is there already and is no socket")
    if _is_alive(path):
        raise EndpointError(
            f"cannot listen on {locator}: another process listens there; stop it, or "
            "name another path"
        )


def _is_alive(path: Path) -> bool:
    """Return whether somebody listens on a socket; True when it is unclear."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        try:
            probe.connect(str(path))
        except (ConnectionRefusedError, FileNotFoundError):
            return False
        except OSError:
            return True
    return True


def check_encryption(endpoints: Endpoints, locators: list[str]) -> None:
    """Refuse locators that do not fit the certificates.

    Raises:
        LocatorError: a plain locator with TLS, or a secured one without.
    """
    for locator in locators:
        is_secured = protocol_of(locator) in SECURED
        if is_secured and endpoints.tls is None:
            raise LocatorError(
                f"{locator} needs certificates; give an endpoint file with a [tls] "
                "table (--endpoints FILE; surefoot certs makes certificates)"
            )
        if not is_secured and endpoints.tls is not None:
            raise LocatorError(
                f"{locator} is not encrypted although there is a [tls] table; write "
                f"{' or '.join(f'{name}/' for name in SECURED)} before the address, "
                "or leave the table out"
            )


def check_exposure(endpoints: Endpoints) -> None:
    """Refuse to listen without TLS on other addresses than loopback.

    Raises:
        LocatorError: a locator would be open to the network.
    """
    if endpoints.insecure:
        return
    for locator in endpoints.listen:
        if protocol_of(locator) not in SECURED and not is_local(locator):
            raise LocatorError(
                f"{locator} would let anyone on that network command the robot; "
                "listen on tls/ with certificates (surefoot certs), or say "
                "--insecure (insecure = true in the endpoint file) on a network "
                "that nobody else is on"
            )


def protocol_of(locator: str) -> str:
    """Return the protocol of a locator."""
    return locator.split("/", 1)[0]


def is_local(locator: str) -> bool:
    """Return whether only this host can reach a locator; a name might be anywhere."""
    if protocol_of(locator) == SOCKET_FILE:
        return True
    host, _ = place_of(locator)  # options, such as iface=, are not examined
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def access_control(
    access: Access, *, keys: dict[str, str], namespace: str
) -> JsonObject:
    """Return the access rules by identity; anything that no rule allows is dropped.

    Args:
        access: common names of the certificates, by group.
        keys: bus key of each channel, with the robot file's overrides applied.
        namespace: the robot's namespace, put before every key.

    Returns:
        The ``access_control`` section of Zenoh's configuration.
    """
    may = {
        "stabilizer": ["command", "ask", "serve", "live", "read", "hear"],
        "operator": ["operate", "plan", "read", "hear"],
        "planner": ["plan", "read", "hear"],
        "observer": ["read", "hear"],
        "robot": ["robot-put", "robot-answer", "robot-live", "read", "hear"],
        "router": [
            *("command", "ask", "serve", "operate", "live", "plan", "read", "hear"),
        ],
    }
    groups = msgspec.structs.asdict(access)
    policies = [
        {"rules": may[group], "subjects": [f"{group}s"]}
        for group, names in groups.items()
        if names
    ]
    subjects: list[JsonObject] = [
        {"id": f"{group}s", "cert_common_names": names}
        for group, names in groups.items()
        if names
    ]
    # Every process that got through the handshake has one of our certificates.
    subjects.append({"id": "anyone"})
    policies.append({"rules": ["stop", "stop-answer"], "subjects": ["anyone"]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": _rules(keys, namespace),
        "subjects": subjects,
        "policies": policies,
    }


def _rules(keys: dict[str, str], namespace: str) -> list[JsonObject]:
    def of(*directions: Direction) -> list[str]:
        """Return the full keys of all channels of some directions, less the e-stop."""
        return [
            f"{namespace}/{keys[topic.name]}"
            for topic in TOPICS
            if topic.direction in directions and topic.name != ESTOP
        ]

    everything = [f"{namespace}/**"]
    estop = [f"{namespace}/{keys[ESTOP]}"]
    services = of(Direction.SERVICE)
    of_stabilizer = of(Direction.STABILIZER_SERVICE)
    push = f"{namespace}/{keys[PUSH]}"
    commander = [f"{namespace}/{ALIVE_STABILIZER}/*"]
    return [
        _rule("read", INGRESS, everything, *_SUBSCRIBE),
        _rule("hear", EGRESS, everything, *_TOLD),
        _rule("stop", INGRESS, estop, "query"),
        _rule("stop-answer", EGRESS, estop, "declare_queryable", "reply"),
        _rule(
            "command",
            INGRESS,
            of(Direction.TO_ROBOT, Direction.FROM_STABILIZER),
            "put",
        ),
        _rule("ask", INGRESS, services, "query"),
        _rule("serve", INGRESS, of_stabilizer, *_ANSWER),
        _rule("operate", INGRESS, [*of_stabilizer, push], "query"),
        _rule("live", INGRESS, commander, "liveliness_token"),
        _rule("plan", INGRESS, of(Direction.TO_STABILIZER), "put"),
        _rule("robot-put", INGRESS, of(Direction.FROM_ROBOT), "put"),
        _rule("robot-answer", INGRESS, [*services, *estop], *_ANSWER),
        _rule(
            "robot-live", INGRESS, [f"{namespace}/{ALIVE_ROBOT}/**"], "liveliness_token"
        ),
    ]


def _rule(name: str, flows: list[str], keys: list[str], *messages: str) -> JsonObject:
    return {
        "id": name,
        "permission": "allow",
        "flows": flows,
        "messages": list(messages),
        "key_exprs": keys,
    }
