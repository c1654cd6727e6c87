"""What tests of several processes share: deadlines instead of sleeps."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from typing import TypeVar

_T = TypeVar("_T")
DEADLINE_S = 20.0
"""Generous: it bounds a failing test, no passing one gets near it."""
_PAUSE_S = 0.002


def wait_until(
    condition: Callable[[], _T], *, what: str, deadline_s: float = DEADLINE_S
) -> _T:
    """Ask again and again until the answer is truthy.

    Returns:
        That answer.

    Raises:
        AssertionError: the deadline passed first.
    """
    end = time.monotonic() + deadline_s
    while not (answer := condition()):
        assert time.monotonic() < end, f"waited {deadline_s} s for {what}"
        time.sleep(_PAUSE_S)
    return answer


def free_port() -> int:
    """A TCP port nobody listens on at 127.0.0.1."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
