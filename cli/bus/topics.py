"""What is on a robot's bus: channels of the topic table, and other keys."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import msgspec

from robot_io.census import Census, who
from robot_io.listener import Heard
from robot_io.robot import Robot
from schemas.codec import decode
from schemas.errors import MessageError
from schemas.topics import TOPICS, Direction, Topic

_SERVICES = (Direction.SERVICE, Direction.STABILIZER_SERVICE)


class TopicRow(msgspec.Struct, kw_only=True):
    """A channel of the topic table, as it was heard."""

    channel: str
    key: str
    """On the wire, with the namespace."""
    type: str
    direction: str
    publishers: list[str] | None
    """Who may publish, or who answers a service; None where nobody tells."""
    subscribers: list[str] | None
    messages: int
    rate_hz: float
    bytes: float | None
    """Mean size of a message."""
    malformed: int
    malformed_reason: str
    """Of the last one."""


class UnknownKey(msgspec.Struct, kw_only=True):
    """A key that is no channel of this robot."""

    key: str
    publishers: list[str] | None
    subscribers: list[str] | None
    messages: int
    rate_hz: float
    bytes: float | None


class Topics(msgspec.Struct, kw_only=True):
    """The answer of ``surefoot topics``."""

    robot: str
    listened_s: float
    processes: list[str]
    """Everyone on the bus but this command."""
    channels: list[TopicRow]
    unknown: list[UnknownKey]


def list_topics(
    robot: Robot, heard: Iterable[Heard], census: Census, *, listened_s: float
) -> Topics:
    """Sorts what was heard by channel.

    Args:
        robot: names the keys.
        heard: everything on the bus.
        census: who declared what.
        listened_s: over what time it was heard [s].
    """
    messages: dict[str, list[bytes]] = defaultdict(list)
    for one in heard:
        messages[one.key].append(one.data)
    prefix = f"{robot.file.namespace}/"
    rows = [
        _row(
            entry,
            messages[f"{prefix}{robot.keys[entry.name]}"],
            census,
            robot=robot,
            listened_s=listened_s,
        )
        for entry in TOPICS
    ]
    known = {row.key for row in rows}
    declared = {
        entry.key
        for entry in (*census.publishers, *census.subscribers, *census.services)
        if "*" not in entry.key
    }
    unknown = [
        UnknownKey(
            key=key,
            publishers=_who(census, key, is_service=False),
            subscribers=_subscribers(census, key),
            messages=len(messages[key]),
            rate_hz=len(messages[key]) / listened_s,
            bytes=_mean_size(messages[key]),
        )
        for key in sorted((declared | set(messages)) - known)
    ]
    return Topics(
        robot=robot.file.name,
        listened_s=listened_s,
        processes=list(census.processes),
        channels=rows,
        unknown=unknown,
    )


def _row(
    entry: Topic,
    payloads: list[bytes],
    census: Census,
    *,
    robot: Robot,
    listened_s: float,
) -> TopicRow:
    is_service = entry.direction in _SERVICES
    key = f"{robot.file.namespace}/{robot.keys[entry.name]}"
    malformed, reason = _malformed(entry, payloads, joint_count=robot.n_a)
    return TopicRow(
        channel=entry.name,
        key=key,
        type=entry.message.__name__,
        direction=entry.direction.value,
        publishers=_who(census, key, is_service=is_service),
        subscribers=_subscribers(census, key) if not is_service else [],
        messages=len(payloads),
        rate_hz=len(payloads) / listened_s,
        bytes=_mean_size(payloads),
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


def _who(census: Census, key: str, *, is_service: bool) -> list[str] | None:
    if not census.is_told:
        return None
    return who(census.services if is_service else census.publishers, key)


def _subscribers(census: Census, key: str) -> list[str] | None:
    return who(census.subscribers, key) if census.is_told else None


def _mean_size(payloads: list[bytes]) -> float | None:
    return sum(map(len, payloads)) / len(payloads) if payloads else None
