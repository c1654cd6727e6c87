"""Opens the Zenoh session of a process.

The robot listens, everyone else dials: with two dialers a session can split for
good. The settings below were measured; docs/decisions.md says what each one costs
when it is left out.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum

import zenoh

from robot_io.errors import EndpointError
from schemas.arrays import JsonObject
from schemas.codec import MAX_MESSAGE_BYTES
from schemas.endpoints import DEFAULT_LOCATOR, Endpoints

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
    PEER = "peer"
    """Dials the robot: stabilizer, tools."""


@contextmanager
def open_session(
    endpoints: Endpoints, role: Role, *, namespace: str
) -> Iterator[zenoh.Session]:
    """Opens a session and closes it whatever happens.

    Without the close, the interpreter can hang at its exit. A peer's session is
    there at once and dials in the background, again and again.

    Args:
        endpoints: both sides of the bus; the role picks its own.
        role: robot or peer.
        namespace: put before every key on the wire, such as ``walker``.

    Raises:
        EndpointError: the robot cannot listen there, or a locator is malformed.
    """
    config = session_config(endpoints, role, namespace=namespace)
    try:
        session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    except zenoh.ZError as error:
        raise _endpoint_error(endpoints, role, error) from error
    try:
        yield session
    finally:
        _close(session)


def session_config(endpoints: Endpoints, role: Role, *, namespace: str) -> JsonObject:
    """Zenoh's configuration for a process.

    Args:
        endpoints: both sides of the bus.
        role: robot or peer.
        namespace: put before every key on the wire.

    Returns:
        What Zenoh's JSON5 file would hold.
    """
    listens = role is Role.ROBOT
    return {
        "mode": "peer",
        "namespace": namespace,
        "metadata": {"name": namespace, "role": role.value},
        "listen": {
            "endpoints": endpoints.listen if listens else [],
            "exit_on_failure": True,
        },
        "connect": {
            "endpoints": [] if listens else endpoints.connect,
            "timeout_ms": -1,
            "exit_on_failure": False,
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


def _endpoint_error(
    endpoints: Endpoints, role: Role, error: zenoh.ZError
) -> EndpointError:
    verb, locators = (
        ("listen on", endpoints.listen)
        if role is Role.ROBOT
        else ("dial", endpoints.connect)
    )
    if "in use" in str(error):
        why = "the address is in use; stop who listens there, or choose another port"
    else:
        why = f"{_cause(error)}; expected locators such as {DEFAULT_LOCATOR}"
    return EndpointError(
        f"cannot {verb} {', '.join(locators)}: {why}", locators=locators
    )
