"""Who is on the bus, from the declarations of each Zenoh session."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable
from typing import NamedTuple

import zenoh
from zenoh.handlers import Callback

from surefoot.schemas.topics import ALIVE_OBSERVER, ALIVE_ROBOT, ALIVE_STABILIZER

TIMEOUT_S = 1.0
"""Longest wait for a process that does not answer [s]."""
_GRACE_S = 1.0
_SHORT_ID = 6
_KINDS = ("publisher", "subscriber", "queryable", "token")


class Declaration(NamedTuple):
    """A declaration of a process on a key or a pattern of keys."""

    key: str
    process: str


class BusGraph(NamedTuple):
    """Who has declared what; keys are as on the wire.

    Attributes:
        is_told: whether any session reported; access control may forbid it.
        publishers: who may publish, by key.
        subscribers: who receives, by key.
        services: who answers queries, by key.
        processes: everyone, by name.
    """

    is_told: bool
    publishers: tuple[Declaration, ...]
    subscribers: tuple[Declaration, ...]
    services: tuple[Declaration, ...]
    processes: tuple[str, ...]


def read_bus_graph(session: zenoh.Session, *, namespace: str) -> BusGraph:
    """Ask every session on the bus what it has declared.

    Args:
        session: connected, without a namespace; left out of the census.
        namespace: the robot's; liveliness tokens in it give processes their names.
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
    lose what is still in it when the query is over.
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
    """Return the sessions that declared it, without those that only forward it."""
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
