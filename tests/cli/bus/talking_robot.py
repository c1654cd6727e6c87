"""A robot's side of a bus that publishes exactly what a test says."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.bus.session import Role
from surefoot.robot_io.identity import new_identity
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.codec import encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import SCHEMA_VERSION, ForceTorque

NAMESPACE = "walker"
PERIOD_S = 0.002
Say = Callable[[str, bytes], None]
"""Publishes a payload on a key below the namespace."""


def force_torque(tick: int, force: list[float] | None = None) -> bytes:
    """Return a valid message of an ankle's sensor."""
    return encode(
        ForceTorque(
            schema=SCHEMA_VERSION,
            tick=tick,
            stamp_ns=time.monotonic_ns(),
            force=force or [1.0, 2.0, 343.0],
            moment=[0.1, 0.2, 0.3],
        )
    )


@contextmanager
def talking_robot(
    endpoints: Endpoints, say_one: Callable[[int, Say], None]
) -> Iterator[None]:
    """Take a robot's place on the bus; calls ``say_one`` with 0, 1, 2 and so on.

    Messages before the first listener are lost, so what is said must repeat itself.
    """
    with Bus(endpoints, Role.ROBOT, namespace=NAMESPACE) as bus:
        stop = threading.Event()

        def say(key: str, data: bytes) -> None:
            bus.session.put(key, data)

        def talk() -> None:
            count = 0
            while not stop.wait(PERIOD_S):
                say_one(count, say)
                count += 1

        bus.announce(new_identity(load_robot("walker")).token)
        thread = threading.Thread(target=talk)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()
