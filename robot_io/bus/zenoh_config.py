"""Configuration of a Zenoh session by the role of its process.

The robot is a peer that listens; all others are its clients and dial it. So the robot
forwards messages between its clients, such as a planner's reference or the stabilizer's
status; between peers it would not. Two sides never dial each other either, since that
can split a session for good.
"""

from __future__ import annotations

from enum import StrEnum

from surefoot.robot_io.security.locators import SECURED, access_control
from surefoot.schemas.arrays import MS_PER_S, JsonObject
from surefoot.schemas.codec import MAX_MESSAGE_BYTES
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.topics import resolve_keys

QUERY_TIMEOUT_MS = 1000
MAX_SESSIONS = 16
HANDSHAKE_MS = 1000
KEEP_ALIVES_PER_LEASE = 4
WAIT_BEFORE_DROP_S = 0.001
"""How long a message may wait for a busy link before it is dropped [s]."""
US_PER_S = 1e6
QUEUE_BATCHES = 16
"""Zenoh gives urgent priorities one batch by default, and then drops messages
whenever its sender thread loses the processor for a millisecond."""
BATCH_WAIT_MS = 0
"""How long a message may be held back for others to join it while the sender is at work
[ms]. Zenoh's default of one millisecond is a whole tick."""
RETRY_GROWTH = 2
RETRY_MAX_FACTOR = 4


class Role(StrEnum):
    """Role of a process on the bus."""

    ROBOT = "robot"
    """Listens; with a router it dials the router instead."""
    CLIENT = "client"
    """Dials the robot, or the router: stabilizer, planner, tools."""
    ROUTER = "router"
    """Listens for all the others, the robot included."""


def listens(endpoints: Endpoints, role: Role) -> bool:
    """Return whether a process of this role listens."""
    return role is Role.ROUTER or (role is Role.ROBOT and not endpoints.router)


def dialed(endpoints: Endpoints) -> list[str]:
    """Return the locators dialed by a process that does not listen."""
    return endpoints.router or endpoints.connect


def session_config(
    endpoints: Endpoints,
    role: Role,
    *,
    namespace: str,
    timeout_s: float,
    keys: dict[str, str] | None = None,
    wait_before_drop_s: float = WAIT_BEFORE_DROP_S,
) -> JsonObject:
    """Return Zenoh's configuration; the arguments are those of :func:`open_session`.

    Returns:
        The content of Zenoh's JSON5 file.
    """
    is_listening = listens(endpoints, role)
    config: JsonObject = {
        "mode": _mode(role, is_listening=is_listening),
        "metadata": {"name": namespace, "role": role.value},
        "listen": {
            "endpoints": endpoints.listen if is_listening else [],
            "exit_on_failure": True,
        },
        "connect": {
            "endpoints": [] if is_listening else dialed(endpoints),
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
        "transport": _transport(endpoints, wait_before_drop_s),
    }
    # A router sees keys as on the wire; so does a tool without a namespace.
    if role is not Role.ROUTER and namespace:
        config["namespace"] = namespace
    if is_listening:
        config["low_pass_filter"] = [
            {
                "id": "incoming",
                "flows": ["ingress"],
                "messages": ["put", "query", "reply", "delete"],
                "key_exprs": ["**"],
                "size_limit": endpoints.max_bytes,
            }
        ]
    if is_listening and endpoints.tls is not None:
        config["access_control"] = access_control(
            endpoints.access, keys=keys or resolve_keys({}), namespace=namespace
        )
    return config


def _mode(role: Role, *, is_listening: bool) -> str:
    if role is Role.ROUTER:
        return "router"
    return "peer" if is_listening else "client"


def _transport(endpoints: Endpoints, wait_before_drop_s: float) -> JsonObject:
    return {
        "shared_memory": {"enabled": False},
        "unicast": {
            "lowlatency": False,  # its put() blocks on a slow subscriber for ever
            "max_sessions": MAX_SESSIONS,
            "open_timeout": HANDSHAKE_MS,  # close() waits for one that hangs
            "qos": {"enabled": True},  # without it a dropping publisher never recovers
        },
        "link": {
            **_tls(endpoints),
            "rx": {"max_message_size": MAX_MESSAGE_BYTES},
            "tx": {
                "lease": endpoints.lease_ms,
                "keep_alive": KEEP_ALIVES_PER_LEASE,
                "queue": {
                    "size": {"real_time": QUEUE_BATCHES},
                    "batching": {"enabled": True, "time_limit": BATCH_WAIT_MS},
                    "congestion_control": {
                        "drop": {
                            "wait_before_drop": round(US_PER_S * wait_before_drop_s)
                        }
                    },
                },
            },
        },
    }


def _tls(endpoints: Endpoints) -> JsonObject:
    """Return the TLS part: certificates on both ends, and no unsecured protocol."""
    tls = endpoints.tls
    if tls is None:
        return {}
    return {
        "protocols": list(SECURED),
        "tls": {
            "root_ca_certificate": tls.ca,
            "listen_certificate": tls.certificate,
            "listen_private_key": tls.key,
            "connect_certificate": tls.certificate,
            "connect_private_key": tls.key,
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        },
    }
