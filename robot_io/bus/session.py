"""Opens the Zenoh session of a process, or runs a router.

The robot is a peer that listens; all others are its clients and dial it. So the robot
forwards messages between its clients, such as a planner's reference or the stabilizer's
status; between peers it would not. Two sides never dial each other either, since that
can split a session for good.

The router is Zenoh's own, run from its library. ``zenohd`` with the configurations in
deploy/ does the same.
"""

from __future__ import annotations

import json
import logging
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import StrEnum

import msgspec
import zenoh

from surefoot.robot_io.errors import EndpointError, RobotUnreachableError
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.security.locators import (
    SECURED,
    access_control,
    check_encryption,
    check_exposure,
    check_locators,
    check_socket_files,
)
from surefoot.schemas.arrays import MS_PER_S, JsonObject
from surefoot.schemas.codec import MAX_MESSAGE_BYTES
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.topics import resolve_keys

CONNECT_TIMEOUT_S = 5.0
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
RUNTIME_VARIABLE = "ZENOH_RUNTIME"
RUNTIME = "(rx:(worker_threads:{}),acc:(handover:tx),app:(handover:tx))"
"""Two threads of Zenoh instead of six: every thread that wakes for a message takes core
and caches from the control loop. A listening process has more; those sleep."""
PANICS_OF = "pyo3_runtime"
"""Module of the exceptions that stand for a panic in Zenoh."""
LISTENING_WORKERS = 64
"""Threads of a listening process. A peer that stands still for longer than the lease,
or whose cable is pulled, blocks one for half a minute, or several if it comes and goes.
"""
_will_listen = False
_opening = 0
"""Number of sessions that threads of this process are opening now."""
_opening_lock = threading.Lock()
RETRY_GROWTH = 2
RETRY_MAX_FACTOR = 4
POLL_S = 0.1


class Role(StrEnum):
    """Role of a process on the bus."""

    ROBOT = "robot"
    """Listens; with a router it dials the router instead."""
    CLIENT = "client"
    """Dials the robot, or the router: stabilizer, planner, tools."""
    ROUTER = "router"
    """Listens for all the others, the robot included."""


@contextmanager
def open_session(
    endpoints: Endpoints,
    role: Role,
    *,
    namespace: str,
    timeout_s: float = CONNECT_TIMEOUT_S,
    keys: dict[str, str] | None = None,
    wait_before_drop_s: float = WAIT_BEFORE_DROP_S,
) -> Iterator[zenoh.Session]:
    """Open a session and close it in every case.

    Without the close, the interpreter can hang at its exit. A connected client dials
    again by itself whenever the robot has gone.

    Args:
        endpoints: both sides of the bus; the role picks its own.
        role: robot, client or router.
        namespace: put before every key on the wire, such as ``walker``; empty for a
            tool that looks at all keys.
        timeout_s: how long a dialing process tries each locator [s].
        keys: channel name to key, for access control; the usual ones when None.
        wait_before_drop_s: how long a message may wait for a busy link [s].

    Raises:
        EndpointError: Zenoh cannot listen there, or cannot start.
        LocatorError: a locator is malformed, is open to a network without TLS, or has
            the path of a file that is no socket.
        CertificateError: the peer would refuse one of our certificates.
        RobotUnreachableError: nobody answers at the dialed locators.
    """
    check_endpoints(endpoints, role)
    configs = [
        session_config(
            place,
            role,
            namespace=namespace,
            timeout_s=timeout_s,
            keys=keys,
            wait_before_drop_s=wait_before_drop_s,
        )
        for place in _one_by_one(endpoints, role)
    ]
    try:
        with _threads(is_listening=listens(endpoints, role)):
            session = _open_first(configs)
    except zenoh.ZError as error:
        raise _open_error(endpoints, role, error, timeout_s) from error
    except BaseException as error:
        # If Zenoh cannot read its variable, it panics; a panic is no Exception.
        if isinstance(error, Exception) or type(error).__module__ != PANICS_OF:
            raise
        raise EndpointError(
            f"Zenoh cannot start: {error}; leave {RUNTIME_VARIABLE} unset, or write it "
            f"as in {RUNTIME.format(1)}"
        ) from error
    try:
        yield session
    finally:
        try:
            session.close()  # type: ignore[no-untyped-call]
        except zenoh.ZError as error:  # a hanging peer must not hide other errors
            logging.getLogger(__name__).warning("closing the bus: %s", cause_of(error))


def _one_by_one(endpoints: Endpoints, role: Role) -> list[Endpoints]:
    """Return endpoints for each locator to dial; the same for who listens.

    Given several, Zenoh dials the first until the time is up, and no other.
    """
    if listens(endpoints, role):
        return [endpoints]
    side = "router" if endpoints.router else "connect"
    return [
        msgspec.structs.replace(endpoints, **{side: [locator]})
        for locator in dialed(endpoints)
    ]


def _open_first(configs: list[JsonObject]) -> zenoh.Session:
    """Open a session with the first configuration that works.

    Raises:
        ZError: none does.
    """
    *others, last = (zenoh.Config.from_json5(json.dumps(one)) for one in configs)
    for config in others:
        with suppress(zenoh.ZError):
            return zenoh.open(config)
    return zenoh.open(last)


def expect_to_listen() -> None:
    """Declare that this process will listen, although its first session dials."""
    global _will_listen
    _will_listen = True


@contextmanager
def _threads(*, is_listening: bool) -> Iterator[None]:
    """Choose the number of Zenoh's threads unless the user has chosen it.

    Zenoh reads its variable once, at the first session of a process. The variable is
    removed again, or a child process would get the threads of another role. When
    several threads open sessions at the same time, the last one removes it.
    """
    global _opening
    with _opening_lock:
        is_users = not _opening and RUNTIME_VARIABLE in os.environ
        if not is_users:
            _opening += 1
            workers = LISTENING_WORKERS if is_listening or _will_listen else 1
            os.environ[RUNTIME_VARIABLE] = RUNTIME.format(workers)
    try:
        yield
    finally:
        if not is_users:
            with _opening_lock:
                _opening -= 1
                if not _opening:
                    del os.environ[RUNTIME_VARIABLE]


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


def cause_of(error: zenoh.ZError) -> str:
    """Return Zenoh's message without the source files of its build."""
    return str(error).split(" at /")[0]


def check_endpoints(endpoints: Endpoints, role: Role) -> None:
    """Refuse what a session would fail on, before anything is started.

    Raises:
        EndpointError: a locator, a certificate or a socket file cannot be used.
    """
    is_listening = listens(endpoints, role)
    locators = endpoints.listen if is_listening else dialed(endpoints)
    check_locators(locators, verb="listen on" if is_listening else "dial")
    check_encryption(endpoints, locators)
    if is_listening:
        check_exposure(endpoints)
        check_socket_files(locators)
    if endpoints.tls is not None:  # the library for certificates is slow to load
        from surefoot.robot_io.security.own_certificates import check_own_certificates

        check_own_certificates(endpoints, is_listening=is_listening)


def _open_error(
    endpoints: Endpoints, role: Role, error: zenoh.ZError, timeout_s: float
) -> EndpointError | RobotUnreachableError:
    if not listens(endpoints, role):
        # A client tries again, and looks for the cause when it gives up.
        words = unreachable(
            endpoints, "nobody answers", timeout_s, looks=role is not Role.CLIENT
        )
        return RobotUnreachableError(words)
    why = cause_of(error)
    if "in use" in why:
        why = "the address is in use; stop who listens there, or choose another port"
    elif "assign requested address" in why:
        why = (
            "no network interface of this machine has this address; listen on one of "
            "its own, or on 0.0.0.0 for all of them"
        )
    return EndpointError(f"cannot listen on {', '.join(endpoints.listen)}: {why}")


def unreachable(
    endpoints: Endpoints, what: str, timeout_s: float, *, looks: bool = True
) -> str:
    """Return the error text for a bus on which the other side is not found.

    Args:
        endpoints: where the process dialed.
        what: what it found instead.
        timeout_s: how long it waited [s].
        looks: find out what is wrong with host names and certificates, which takes a
            moment.
    """
    where = dialed(endpoints)
    told = f"{what} at {', '.join(where)} within {timeout_s:g} s"
    if looks:
        from surefoot.robot_io.security.own_certificates import peer_fault

        if fault := peer_fault(endpoints, where):
            return f"{told}: {fault}"
    if endpoints.router:
        hint = "are router and robot running (surefoot router, surefoot robot)"
    else:
        hint = "is the robot running (surefoot robot), and does it listen there"
    if endpoints.tls is not None:
        hint += "; does it trust the authority of our certificate"
    return f"{told}; {hint}?"


def run_router(robot: Robot, *, endpoints: Endpoints, stop: StopRequest) -> None:
    """Route until asked to stop.

    Raises:
        EndpointError: cannot listen there.
    """
    asked = threading.Event()
    stop.waking(asked.set)
    with (
        stop.on_signals(),
        open_session(
            endpoints,
            Role.ROUTER,
            namespace=robot.file.namespace,
            keys=robot.keys,
        ),
    ):
        while not asked.wait(POLL_S):  # a signal's handler runs between two waits
            pass
