"""Channels of a robot's bus by whatever name a user gives them."""

from __future__ import annotations

import difflib

from cli.errors import UsageError
from robot_io.robot import Robot
from schemas.topics import TOPICS, Direction, Topic

_SERVICES = (Direction.SERVICE, Direction.STABILIZER_SERVICE)
PUBLISHED = tuple(entry for entry in TOPICS if entry.direction not in _SERVICES)
"""Channels that carry messages; services are asked instead."""


def find_channel(text: str, robot: Robot) -> Topic:
    """A channel that carries messages.

    Args:
        text: name of the topic table, or key with or without the namespace.
        robot: names the keys.

    Raises:
        UsageError: no such channel, with the nearest name; or it is a service.
    """
    wanted = text.strip("/").removeprefix(f"{robot.file.namespace}/")
    for entry in TOPICS:
        if wanted in (entry.name, robot.keys[entry.name]):
            if entry.direction in _SERVICES:
                raise UsageError(
                    f"{entry.name} is a {entry.direction}: it is asked and answers, "
                    f"there is nothing to listen to; channels are {_names()}"
                )
            return entry
    known = [entry.name for entry in PUBLISHED]
    keys = {robot.keys[entry.name]: entry.name for entry in PUBLISHED}
    near = difflib.get_close_matches(wanted, [*known, *keys], n=1)
    hint = f"did you mean {keys.get(near[0], near[0])!r}? " if near else ""
    raise UsageError(f"no channel {text!r}; {hint}channels are {_names()}")


def same_clock(locators: list[str]) -> bool:
    """Whether who is dialed there reads the same monotonic clock as we do."""
    from robot_io.exposure import is_local

    return all(is_local(locator) for locator in locators)


def _names() -> str:
    return ", ".join(entry.name for entry in PUBLISHED)
