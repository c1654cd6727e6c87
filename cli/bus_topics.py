"""A table of who publishes, subscribes and answers on a bus."""

from __future__ import annotations

import difflib
from collections import defaultdict
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import msgspec
import typer
from rich.table import Table

from surefoot.cli.console import new_table
from surefoot.errors import ExitCode, UsageError
from surefoot.robot_io.client_side.listener import BusGraph, RawMessage, processes_of
from surefoot.robot_io.robot import Robot
from surefoot.schemas.codec import decode
from surefoot.schemas.errors import MessageError
from surefoot.schemas.reasons import NONE, given
from surefoot.schemas.topics import ALL_CHANNELS, PUBLISHED, SERVICES, TOPICS, Topic

if TYPE_CHECKING:
    from surefoot.robot_io.client_side.robot_watch import Absences


class KeyRow(msgspec.Struct, kw_only=True):
    """A key of the bus and what was heard on it."""

    key: str
    """With the namespace, as it is on the bus."""
    publishers: list[str] | None
    """Who may publish, or who answers a service; None where access control hides it."""
    subscribers: list[str] | None
    messages: int
    rate_hz: float
    bytes: float | None
    """Mean size of a message."""


class TopicRow(KeyRow, kw_only=True):
    """A channel of the topic table."""

    channel: str
    type: str
    direction: str
    malformed: int
    malformed_reason: str
    """Why the last malformed message is malformed; empty without one."""


class Topics(msgspec.Struct, kw_only=True):
    """The answer of ``surefoot topics``."""

    robot: str
    listened_s: float
    processes: list[str]
    """Everyone on the bus except this command."""
    channels: list[TopicRow]
    unknown: list[KeyRow]
    """Keys that are no channel of this robot."""


def list_topics(
    robot: Robot, heard: Iterable[RawMessage], graph: BusGraph, *, listened_s: float
) -> Topics:
    """Sort the messages that were heard by channel."""
    messages: dict[str, list[bytes]] = defaultdict(list)
    for one in heard:
        messages[one.key].append(one.data)
    prefix = f"{robot.file.namespace}/"
    rows = [
        _row(
            entry,
            messages[f"{prefix}{robot.keys[entry.name]}"],
            graph,
            robot=robot,
            listened_s=listened_s,
        )
        for entry in TOPICS
    ]
    known = {row.key for row in rows}
    declared = {
        entry.key
        for entry in (*graph.publishers, *graph.subscribers, *graph.services)
        if "*" not in entry.key
    }
    unknown = [
        KeyRow(**_seen(graph, key, messages[key], listened_s=listened_s))
        for key in sorted((declared | set(messages)) - known)
    ]
    return Topics(
        robot=robot.file.name,
        listened_s=listened_s,
        processes=list(graph.processes),
        channels=rows,
        unknown=unknown,
    )


def _row(
    entry: Topic,
    payloads: list[bytes],
    graph: BusGraph,
    *,
    robot: Robot,
    listened_s: float,
) -> TopicRow:
    is_service = entry.direction in SERVICES
    key = f"{robot.file.namespace}/{robot.keys[entry.name]}"
    malformed, reason = _malformed(entry, payloads, joint_count=robot.n_a)
    seen = _seen(graph, key, payloads, listened_s=listened_s)
    if is_service:
        answers = processes_of(graph.services, key) if graph.is_told else None
        seen |= {"publishers": answers, "subscribers": []}
    return TopicRow(
        **seen,
        channel=entry.name,
        type=entry.message.__name__,
        direction=entry.direction.value,
        malformed=malformed,
        malformed_reason=reason,
    )


def _malformed(
    entry: Topic, payloads: Iterable[bytes], *, joint_count: int
) -> tuple[int, str]:
    count, reason = 0, ""
    for data in payloads:
        try:
            decode(data, entry.message, joint_count=joint_count)
        except MessageError as error:
            count, reason = count + 1, str(error)
    return count, reason


def _seen(
    graph: BusGraph, key: str, payloads: list[bytes], *, listened_s: float
) -> dict[str, Any]:
    """Return the fields of a :class:`KeyRow`."""
    size = sum(map(len, payloads))
    return {
        "key": key,
        "publishers": processes_of(graph.publishers, key) if graph.is_told else None,
        "subscribers": processes_of(graph.subscribers, key) if graph.is_told else None,
        "messages": len(payloads),
        "rate_hz": len(payloads) / listened_s,
        "bytes": size / len(payloads) if payloads else None,
    }


def topics_table(told: Topics) -> Table:
    """Return a table with one row per channel."""
    namespace = told.channels[0].key.split("/")[0]
    table = _table(
        f"{told.robot}: keys under {namespace}/, heard for {told.listened_s:.1f} s",
        *("channel", "key", "type"),
    )
    table.columns[0].no_wrap = True
    for row in told.channels:
        key = row.key.removeprefix(f"{namespace}/")
        table.add_row(row.channel, key, row.type, *_heard(row))
    return table


def unknown_table(told: Topics) -> Table:
    """Return a table with one row per key that is not a channel."""
    table = _table(f"keys that are no channel of {told.robot}", "key")
    for row in told.unknown:
        table.add_row(row.key, *_heard(row))
    return table


def _table(title: str, *first: str) -> Table:
    figures = ("Hz", "bytes")
    return new_table(title, *first, "from", "heard by", figures=figures, boxed=False)


def _heard(row: KeyRow) -> tuple[str, ...]:
    """Return the cells that all keys have: from, heard by, rate, mean size."""
    return (
        _names(row.publishers),
        _names(row.subscribers),
        given(row.rate_hz or None, ".0f"),
        given(row.bytes, ".0f"),
    )


def _names(names: list[str] | None) -> str:
    """Return the kinds of processes; their names are printed below the table."""
    if names is None:
        return "?"
    kinds = dict.fromkeys(name.split()[0] for name in names)
    return ", ".join(kinds) or NONE


def find_channel(text: str, robot: Robot) -> Topic:
    """Find a channel that is published on.

    Args:
        text: name in the topic table, or key with or without the namespace.
        robot: defines the keys.

    Raises:
        UsageError: there is no such channel, or it is a service.
    """
    there = f"channels are {', '.join(ALL_CHANNELS)}"
    wanted = text.strip("/").removeprefix(f"{robot.file.namespace}/")
    for entry in TOPICS:
        if wanted in (entry.name, robot.keys[entry.name]):
            if entry.direction in SERVICES:
                raise UsageError(
                    f"{entry.name} is a {entry.direction}: it answers requests and "
                    f"publishes nothing; {there}"
                )
            return entry
    keys = {robot.keys[entry.name]: entry.name for entry in PUBLISHED}
    near = difflib.get_close_matches(wanted, [*ALL_CHANNELS, *keys], n=1)
    hint = f"did you mean {keys.get(near[0], near[0])!r}? " if near else ""
    raise UsageError(f"no channel {text!r}; {hint}{there}")


def tell_absences(absences: Absences) -> None:
    """Report when the link to the robot was lost.

    Raises:
        Exit: with code 1 if it was lost: the output is incomplete.
    """
    from surefoot.cli.console import print_note

    if absences.times:
        print_note(f"{absences}; messages of that time are missing here")
        raise typer.Exit(ExitCode.FAILED)
