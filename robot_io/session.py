"""Opens the Zenoh session of a process.

The robot is a peer that listens; everyone else is its client and dials. So the robot
passes on what its clients say to each other, a planner's reference or the
stabilizer's status, which it would not do between peers; and no two sides ever dial
each other, by which a session can split for good.
"""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum

import zenoh

from robot_io.errors import EndpointError, LocatorError, RobotUnreachableError
from schemas.arrays import JsonObject
from schemas.codec import MAX_MESSAGE_BYTES
from schemas.endpoints import DEFAULT_LOCATOR, Endpoints

PROTOCOLS = ("tcp", "tls", "quic", "udp", "ws", "unixsock-stream")
LOCATOR = re.compile(r"(?:(?:tcp|tls|quic|udp|ws)/\S+:\d+|unixsock-stream/\S+)")
CONNECT_TIMEOUT_S = 5.0
MS_PER_S = 1e3
QUERY_TIMEOUT_MS = 1000
MAX_SESSIONS = 16
HANDSHAKE_MS = 1000
KEEP_ALIVES_PER_LEASE = 4
WAIT_BEFORE_DROP_US = 1000
"""How long a publication may wait for a busy link before it is dropped."""
QUEUE_BATCHES = 16
"""Zenoh gives urgent priorities one batch by default, and then drops messages
whenever its sender thread loses the processor for a millisecond."""
RETRY_GROWTH = 2
RETRY_MAX_FACTOR = 4


class Role(StrEnum):
    """Which end of the bus a process is."""

    ROBOT = "robot"
    """Listens."""
    CLIENT = "client"
    """Dials the robot: stabilizer, planner, tools."""


@contextmanager
def open_session(
    endpoints: Endpoints,
    role: Role,
    *,
    namespace: str,
    timeout_s: float = CONNECT_TIMEOUT_S,
) -> Iterator[zenoh.Session]:
    """Opens a session and closes it whatever happens.

    Without the close, the interpreter can hang at its exit. Once connected, a client
    dials again by itself whenever the robot has gone.

    Args:
        endpoints: both sides of the bus; the role picks its own.
        role: robot or client.
        namespace: put before every key on the wire, such as ``walker``.
        timeout_s: how long a client dials before it gives up [s].

    Raises:
        EndpointError: the robot cannot listen there, or a locator is malformed.
        RobotUnreachableError: nobody answers where a client dials.
    """
    check_locators(endpoints.listen if role is Role.ROBOT else endpoints.connect, role)
    config = session_config(endpoints, role, namespace=namespace, timeout_s=timeout_s)
    try:
        session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    except zenoh.ZError as error:
        raise _open_error(endpoints, role, error, timeout_s) from error
    try:
        yield session
    finally:
        _close(session)


def session_config(
    endpoints: Endpoints, role: Role, *, namespace: str, timeout_s: float
) -> JsonObject:
    """Zenoh's configuration for a process.

    Args:
        endpoints: both sides of the bus.
        role: robot or client.
        namespace: put before every key on the wire.
        timeout_s: how long a client dials before it gives up [s].

    Returns:
        What Zenoh's JSON5 file would hold.
    """
    listens = role is Role.ROBOT
    return {
        "mode": "peer" if listens else "client",
        "namespace": namespace,
        "metadata": {"name": namespace, "role": role.value},
        "listen": {
            "endpoints": endpoints.listen if listens else [],
            "exit_on_failure": True,
        },
        "connect": {
            "endpoints": [] if listens else endpoints.connect,
            "timeout_ms": round(timeout_s * MS_PER_S),
            "exit_on_failure": True,
            "retry": {
                "period_init_ms": endpoints.retry_ms,
                "period_max_ms": RETRY_MAX_FACTOR * endpoints.retry_ms,
                "period_increase_factor": RETRY_GROWTH,
            },
        },
        "scouting": {
            "delay": 0,
            "multicast": {"enabled": False},
            "gossip": {"enabled": False},
        },
        "adminspace": {"enabled": True, "permissions": {"read": True, "write": False}},
        "queries_default_timeout": QUERY_TIMEOUT_MS,
        "transport": _transport(endpoints),
    }


def _transport(endpoints: Endpoints) -> JsonObject:
    return {
        "shared_memory": {"enabled": False},
        "unicast": {
            "lowlatency": False,  # its put() blocks on a slow subscriber for ever
            "max_sessions": MAX_SESSIONS,
            "open_timeout": HANDSHAKE_MS,  # close() waits for one that hangs
            "qos": {"enabled": True},  # without it a dropping publisher never recovers
        },
        "link": {
            "rx": {"max_message_size": MAX_MESSAGE_BYTES},
            "tx": {
                "lease": endpoints.lease_ms,
                "keep_alive": KEEP_ALIVES_PER_LEASE,
                "queue": {
                    "size": {"real_time": QUEUE_BATCHES},
                    "congestion_control": {
                        "drop": {"wait_before_drop": WAIT_BEFORE_DROP_US}
                    },
                },
            },
        },
    }


def _close(session: zenoh.Session) -> None:
    """Closes; a peer that neither talks nor hangs up must not hide other errors."""
    try:
        session.close()  # type: ignore[no-untyped-call]
    except zenoh.ZError as error:
        logging.getLogger(__name__).warning("closing the bus: %s", _cause(error))


def _cause(error: zenoh.ZError) -> str:
    """Zenoh's words without the source files of its build."""
    return str(error).split(" at /")[0]


def check_locators(locators: list[str], role: Role = Role.CLIENT) -> None:
    """Makes sure that locators are written as such.

    Zenoh would go on dialing a malformed one until the time is up.

    Args:
        locators: to listen on or to dial.
        role: which of the two.

    Raises:
        LocatorError: one is malformed, or there is none.
    """
    bad = [locator for locator in locators if not LOCATOR.match(locator)]
    if bad or not locators:
        raise LocatorError(
            f"cannot {_verb(role)} {', '.join(bad) or 'nowhere'}; expected "
            f"protocol/address with one of {', '.join(PROTOCOLS)}, such as "
            f"{DEFAULT_LOCATOR}",
            locators=locators,
        )


def _verb(role: Role) -> str:
    return "listen on" if role is Role.ROBOT else "dial"


def _open_error(
    endpoints: Endpoints, role: Role, error: zenoh.ZError, timeout_s: float
) -> EndpointError | RobotUnreachableError:
    if role is Role.CLIENT:
        return RobotUnreachableError(
            f"nobody answers at {', '.join(endpoints.connect)} within {timeout_s:g} s; "
            "is the robot running (surefoot robot), and does it listen there?"
        )
    why = _cause(error)
    if "in use" in why:
        why = "the address is in use; stop who listens there, or choose another port"
    return EndpointError(
        f"cannot listen on {', '.join(endpoints.listen)}: {why}",
        locators=endpoints.listen,
    )
