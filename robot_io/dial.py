"""Dials a robot's bus for as long as one wants, such that Ctrl-C ends it at once."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from robot_io.bus import Bus
from robot_io.errors import RobotUnreachableError
from robot_io.session import Role, unreachable
from schemas.endpoints import Endpoints

DIAL_S = 0.5
"""One attempt: Zenoh cannot be interrupted in it."""


@contextmanager
def dialed_bus(
    endpoints: Endpoints, *, namespace: str, timeout_s: float
) -> Iterator[Bus]:
    """Opens the bus as a client, in short attempts.

    Args:
        endpoints: where to dial.
        namespace: put before every key; empty for a tool that looks at all of them.
        timeout_s: how long in all [s].

    Raises:
        EndpointError: a locator is malformed.
        RobotUnreachableError: nobody answered in time.
    """
    end = time.monotonic() + timeout_s
    attempt_s = min(DIAL_S, timeout_s)
    with ExitStack() as stack:
        while True:
            bus = Bus(endpoints, Role.CLIENT, namespace=namespace, timeout_s=attempt_s)
            try:
                stack.enter_context(bus)
                break
            except RobotUnreachableError:
                if time.monotonic() >= end:
                    words = unreachable(endpoints, "nobody answers", timeout_s)
                    raise RobotUnreachableError(words) from None
        yield bus
