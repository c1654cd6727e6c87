"""Places where robot and clients meet: at the robot, or at a router."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from surefoot.robot_io.bus.session import Role, open_session
from surefoot.schemas.endpoints import Endpoints
from tests.support import free_port


@contextmanager
def meeting_place(*, routed: bool) -> Iterator[Endpoints]:
    """Return endpoints on loopback for everyone; a router runs during the context."""
    locator = f"tcp/127.0.0.1:{free_port()}"
    endpoints = Endpoints(
        listen=[locator], connect=[locator], router=[locator] if routed else []
    )
    with ExitStack() as stack:
        if routed:
            stack.enter_context(
                open_session(endpoints, Role.ROUTER, namespace="walker")
            )
        yield endpoints
