"""Listens to keys as they are on the wire, and stamps each message."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from typing import NamedTuple

import zenoh
from zenoh.handlers import Callback

from surefoot.robot_io.bus.bus import dialed_bus
from surefoot.robot_io.client_side.bus_graph import BusGraph, read_bus_graph
from surefoot.robot_io.client_side.read_only_client import ReadOnlyClient
from surefoot.robot_io.realtime import SWITCH_INTERVAL_S
from surefoot.robot_io.robot import Robot
from surefoot.schemas.endpoints import Endpoints

POLL_S = 0.01
KEPT = 200_000
"""Messages kept until they are taken: ten seconds of a bus at its fastest."""


class RawMessage(NamedTuple):
    """One message.

    Attributes:
        key: with the namespace, as on the wire.
        data: its bytes, whatever they are.
        received_ns: this process's monotonic clock when Zenoh had it [ns].
    """

    key: str
    data: bytes
    received_ns: int


class Listener(ReadOnlyClient):
    """Hears keys, known or not, without any part in the robot's control.

    Unlike :class:`~surefoot.robot_io.client_side.observer.Observer`, which reads a
    robot's channels, it stamps each message as it comes, on Zenoh's thread, and hears
    patterns such as ``walker/**``. The stamping takes some microseconds, so the robot
    never waits for it; what is not taken in time is lost here, and counted.

    A context manager, used by one thread.

    Attributes:
        lost: messages that gave way to newer ones before they were taken.
    """

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
            robot: whose presence counts, and whose namespace is put before patterns.
            endpoints: where to dial.
            patterns: keys or patterns relative to the namespace.
            elsewhere: hear keys outside the namespace too.
        """
        super().__init__(robot, endpoints=endpoints)
        self.lost = 0
        self._status_key = robot.keys["status"]
        self._patterns = [f"{self._namespace}/{pattern}" for pattern in patterns]
        self._elsewhere = elsewhere
        self._heard: deque[RawMessage] = deque()
        self._session: zenoh.Session | None = None

    def take(self, *, timeout_s: float = 0.0) -> list[RawMessage]:
        """Return all messages that have come, in the order in which they came.

        Args:
            timeout_s: how long to wait for the first one [s].

        Returns:
            Nothing when none came in time.
        """
        end = time.monotonic() + timeout_s
        while not self._heard and (left := end - time.monotonic()) > 0.0:
            # An event per message would cost Zenoh's thread a wake-up each.
            time.sleep(min(POLL_S, left))
        return [self._heard.popleft() for _ in range(len(self._heard))]

    def bus_graph(self) -> BusGraph:
        """Return who publishes, subscribes and answers, except this process.

        Nothing is told while there is no link.
        """
        if self._session is None or self._session.is_closed():
            return BusGraph(False, (), (), (), ())
        return read_bus_graph(self._session, namespace=self._namespace)

    def _open(self, stack: ExitStack, timeout_s: float) -> None:
        # Other threads get short turns, so that stamps are not late.
        stack.callback(sys.setswitchinterval, sys.getswitchinterval())
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        # Without namespace: only so are other keys and the graph to be seen.
        bus = stack.enter_context(
            dialed_bus(self._endpoints, namespace="", timeout_s=timeout_s)
        )
        self._session = bus.session
        for pattern in self._patterns:
            self._subscribe(pattern, self._on_sample)
        if self._elsewhere:
            self._subscribe("**", self._on_foreign_sample)
        bus.announce(f"{self._namespace}/{self._token()}")
        self._follow_robot(
            bus, f"{self._namespace}/{self._status_key}", prefix=f"{self._namespace}/"
        )

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
