"""Listens to all keys of the bus as on the wire, and reports who has declared them."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from typing import NamedTuple

import zenoh
from zenoh.handlers import Callback

from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.client_side.robot_watch import ReadOnlyClient
from surefoot.robot_io.realtime import SWITCH_INTERVAL_S
from surefoot.robot_io.robot import Robot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.topics import ALIVE_OBSERVER, ALIVE_ROBOT, ALIVE_STABILIZER

TIMEOUT_S = 1.0
"""Longest wait for a process that does not answer [s]."""
_GRACE_S = 1.0
_SHORT_ID = 6
_KINDS = ("publisher", "subscriber", "queryable", "token")
POLL_S = 0.01
KEPT = 200_000
"""Messages kept until they are taken: ten seconds of a bus at its fastest."""


class Declaration(NamedTuple):
    """One declaration of a process, on a key or a pattern of keys."""

    key: str
    process: str


class BusGraph(NamedTuple):
    """The declarations of all processes; keys are as on the wire.

    Attributes:
        is_told: whether any session reported; access control may forbid it.
        publishers: processes that may publish, by key.
        subscribers: processes that receive, by key.
        services: processes that answer queries, by key.
        processes: names of all processes.
    """

    is_told: bool
    publishers: tuple[Declaration, ...]
    subscribers: tuple[Declaration, ...]
    services: tuple[Declaration, ...]
    processes: tuple[str, ...]


def read_bus_graph(session: zenoh.Session, *, namespace: str) -> BusGraph:
    """Ask every session on the bus for its declarations.

    Args:
        session: connected, without a namespace; not part of the result.
        namespace: the robot's; its liveliness tokens give processes their names.
    """
    own = str(session.zid())
    declared: dict[str, set[tuple[str, str]]] = {kind: set() for kind in _KINDS}
    roles: dict[str, str] = {}
    for reply in _replies(session):
        if reply.ok is None:
            continue
        _, identity, _, *rest = str(reply.ok.key_expr).split("/")
        if not rest:
            roles[identity] = _role(reply.ok.payload.to_bytes())
        elif rest[0] in declared:
            key = "/".join(rest[1:])
            for source in _sources(reply.ok.payload.to_bytes()):
                declared[rest[0]].add((key, source))
    names = _names(declared["token"], roles, namespace=namespace)

    others = {source for kind in _KINDS for _, source in declared[kind]} - {own}

    def name(source: str) -> str:
        return names.get(source) or f"? {source[:_SHORT_ID]}"

    def told(kind: str) -> tuple[Declaration, ...]:
        return tuple(
            Declaration(key, name(source))
            for key, source in sorted(declared[kind])
            if source in others
        )

    return BusGraph(
        bool(others),
        told("publisher"),
        told("subscriber"),
        told("queryable"),
        tuple(sorted(map(name, others))),
    )


def processes_of(declarations: Iterable[Declaration], key: str) -> list[str]:
    """Return the names of the processes with declarations that match a key."""
    wanted = zenoh.KeyExpr(key)
    return sorted(
        {
            process
            for declared, process in declarations
            if zenoh.KeyExpr(declared).intersects(wanted)
        }
    )


def _replies(session: zenoh.Session) -> list[zenoh.Reply]:
    """Collect all replies of Zenoh's admin space in a list, without blocking.

    A channel would either block the close of a session that is interrupted here, or
    lose its remaining replies when the query is over.
    """
    replies: list[zenoh.Reply] = []
    is_over = threading.Event()
    session.get(
        "@/**",
        Callback(replies.append, drop=is_over.set, indirect=False),
        timeout=TIMEOUT_S,
    )
    is_over.wait(TIMEOUT_S + _GRACE_S)
    return replies


def _names(
    tokens: Iterable[tuple[str, str]], roles: dict[str, str], *, namespace: str
) -> dict[str, str]:
    names = {
        identity: f"{role or '?'} {identity[:_SHORT_ID]}"
        for identity, role in roles.items()
    }
    for key, source in tokens:
        alive = key.removeprefix(f"{namespace}/")
        for prefix in (ALIVE_STABILIZER, ALIVE_OBSERVER):
            if alive.startswith(f"{prefix}/"):
                kind = prefix.rsplit("/", 1)[-1]
                names[source] = f"{kind} {alive.removeprefix(f'{prefix}/')}"
        if alive.split("/")[:2] == ALIVE_ROBOT.split("/"):
            names[source] = "robot"
    return names


def _sources(payload: bytes) -> list[str]:
    """Return the sessions that declared a key, without those that only forward it."""
    told = _table(payload).get("clients")
    return [str(source) for source in told] if isinstance(told, list) else []


def _role(payload: bytes) -> str:
    metadata = _table(payload).get("metadata")
    return str(metadata.get("role", "")) if isinstance(metadata, dict) else ""


def _table(payload: bytes) -> dict[str, object]:
    try:
        table = json.loads(payload)
    except ValueError:
        return {}
    return table if isinstance(table, dict) else {}


class RawMessage(NamedTuple):
    """One message of any key.

    Attributes:
        key: with the namespace, as on the wire.
        data: its bytes, not checked.
        received_ns: this process's monotonic clock when Zenoh received it [ns].
    """

    key: str
    data: bytes
    received_ns: int


class Listener(ReadOnlyClient):
    """Receives known and unknown keys, without any part in the robot's control.

    An :class:`~surefoot.robot_io.client_side.observer.Observer` reads a robot's
    channels. A listener also receives patterns such as ``walker/**``, and stamps each
    message on Zenoh's thread as it comes. The stamp takes some microseconds, so the
    robot never waits for it. Messages not taken in time are lost here, and counted.

    A context manager, used by one thread.

    Attributes:
        lost: messages dropped for newer ones before they were taken.
    """

    _hears_all = True  # needed to see other keys and the graph

    def __init__(
        self,
        robot: Robot,
        *,
        endpoints: Endpoints,
        patterns: Iterable[str],
        elsewhere: bool = False,
    ) -> None:
        """Prepare; :meth:`connect` dials.

        Args:
            robot: whose presence is watched, and whose namespace precedes the patterns.
            endpoints: where to dial.
            patterns: keys or patterns relative to the namespace.
            elsewhere: receive keys outside the namespace too.
        """
        super().__init__(robot, endpoints=endpoints)
        self.lost = 0
        self._patterns = [f"{self._namespace}/{pattern}" for pattern in patterns]
        self._elsewhere = elsewhere
        self._heard: deque[RawMessage] = deque()
        self._session: zenoh.Session | None = None

    def take(self, *, timeout_s: float = 0.0) -> list[RawMessage]:
        """Return all messages received so far, in order of arrival.

        Returns:
            The messages; empty when none came in time.
        """
        end = time.monotonic() + timeout_s
        while not self._heard and (left := end - time.monotonic()) > 0.0:
            time.sleep(min(POLL_S, left))  # an event would cost a wake-up per message
        return [self._heard.popleft() for _ in range(len(self._heard))]

    def bus_graph(self) -> BusGraph:
        """Return who publishes, subscribes and answers, except this process.

        The graph is empty while there is no link.
        """
        if self._session is None or self._session.is_closed():
            return BusGraph(False, (), (), (), ())
        return read_bus_graph(self._session, namespace=self._namespace)

    def _open(self, stack: ExitStack, timeout_s: float) -> None:
        # Other threads get short turns, so that stamps are not late.
        stack.callback(sys.setswitchinterval, sys.getswitchinterval())
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        super()._open(stack, timeout_s)

    def _declare(self, bus: Bus) -> None:
        self._session = bus.session
        for pattern in self._patterns:
            self._subscribe(pattern, self._on_sample)
        if self._elsewhere:
            self._subscribe("**", self._on_foreign_sample)

    def _subscribe(
        self, pattern: str, on_sample: Callable[[zenoh.Sample], None]
    ) -> None:
        if self._session is not None:
            self._session.declare_subscriber(
                pattern, Callback(on_sample, indirect=False)
            )

    def _on_sample(self, sample: zenoh.Sample) -> None:
        received_ns = time.monotonic_ns()
        if len(self._heard) >= KEPT:
            self._heard.popleft()
            self.lost += 1
        self._heard.append(
            RawMessage(str(sample.key_expr), sample.payload.to_bytes(), received_ns)
        )

    def _on_foreign_sample(self, sample: zenoh.Sample) -> None:
        if not str(sample.key_expr).startswith(f"{self._namespace}/"):
            self._on_sample(sample)
