"""The open bus: a Zenoh session with its publishers, channels and presence tokens.

Client and server both build on it: sensors go from server to client, commands back.
"""

from __future__ import annotations

import logging
import os
import socket
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Self

import zenoh
from zenoh.handlers import Callback

from surefoot.robot_io.bus.channel import Channel, Waker
from surefoot.robot_io.bus.session import (
    CONNECT_TIMEOUT_S,
    Role,
    open_session,
    unreachable,
)
from surefoot.robot_io.errors import RobotUnreachableError
from surefoot.robot_io.realtime import Pace, StopRequest, distribution_of
from surefoot.schemas.arrays import MS_PER_S
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.result import Distribution

GRANULARITY_S = {Pace.REALTIME: 0.005, Pace.LOCKSTEP: 0.02}
"""How late a wait with a deadline may end [s]. Lockstep checks less often, since both
sides wait anyway and each check costs time."""
WAIT_BEFORE_DROP_S = {Pace.REALTIME: 0.001, Pace.LOCKSTEP: 0.5}
"""How long a message may wait for a busy link before it is dropped [s]. In lockstep the
robot's time stands still meanwhile, and a slow recorder loses nothing."""
SETTLE_S = 1.0
"""Longest time for the bus to report that nobody else is there [s]."""
_NOBODY = "alive/nobody"
DIAL_S = 0.5
"""Length of one attempt to connect, which Zenoh cannot interrupt [s]."""
TELL_S = 10.0
"""Time without an answer after which a longer wait tells the likely cause [s]."""
_LOG = logging.getLogger(__name__)
ROUND_TRIPS = 200
_WARM_UP = 20
_ANSWER_S = 2.0
_NAMESPACE = "loopback"
_BYTES = 600
"""Size of a message with a robot's joints."""
_POLL_S = 0.002
ONE_HOST_LEASE_MS = 10_000
"""Lease of links between processes of one run [ms]. A process that dies closes its link
at once; a silent one is alive, but a busy machine has not let it run."""
LONGEST_SOCKET_PATH = 90
"""Longest path [bytes]: systems allow 104 or 108, Zenoh adds a lock file beside it."""


class Bus:
    """An open session with the parts that client and server share.

    A context manager; leaving it closes everything declared on it.
    """

    session: zenoh.Session
    waker: Waker

    def __init__(
        self,
        endpoints: Endpoints,
        role: Role,
        *,
        namespace: str,
        timeout_s: float = CONNECT_TIMEOUT_S,
        keys: dict[str, str] | None = None,
        pace: Pace = Pace.REALTIME,
    ) -> None:
        """Prepare; entering the context opens the session.

        Args:
            endpoints: both sides of the bus.
            role: robot or client.
            namespace: the robot's namespace.
            timeout_s: how long a client dials before it gives up [s].
            keys: the robot's keys, for access control; the usual ones when None.
            pace: in lockstep messages may wait for a busy reader, and waits end later.
        """
        self._endpoints, self._role, self._namespace = endpoints, role, namespace
        self._timeout_s = timeout_s
        self._keys = keys
        self._pace = pace
        self._stack = ExitStack()
        self._tokens: list[zenoh.LivelinessToken] = []
        """Kept, since Zenoh withdraws a token that is no longer referenced."""

    def __enter__(self) -> Self:
        """Open the session.

        Raises:
            EndpointError: Zenoh cannot listen there, or a locator is malformed.
            RobotUnreachableError: nobody answers at the dialed locators.
        """
        with ExitStack() as stack:
            self.session = stack.enter_context(
                open_session(
                    self._endpoints,
                    self._role,
                    namespace=self._namespace,
                    timeout_s=self._timeout_s,
                    keys=self._keys,
                    wait_before_drop_s=WAIT_BEFORE_DROP_S[self._pace],
                )
            )
            granularity_s = GRANULARITY_S[self._pace]
            self.waker = Waker(self.session, granularity_s=granularity_s)
            stack.enter_context(self.waker.running())
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *why: object) -> None:
        """Close the session."""
        self._stack.close()

    def publisher(
        self, key: str, *, urgent: bool, flush: bool = False
    ) -> zenoh.Publisher:
        """Declare a publisher that drops rather than blocks on a slow subscriber.

        Zenoh gathers messages into batches. Flushing hands the batch over at once, but
        takes one batch out of the queue each time. So a publisher that always flushes
        loses messages whenever the machine is busy: flushing every tick lost 8 of 22500
        ticks beside three busy processes. It saves a few ticks in a hundred a wait for
        the sender.

        Args:
            key: relative to the namespace.
            urgent: part of the control loop, sent before everything else.
            flush: send at once, together with urgent messages that wait before it.
        """
        priority = zenoh.Priority.REAL_TIME if urgent else zenoh.Priority.DATA
        return self.session.declare_publisher(
            key,
            priority=priority,
            congestion_control=zenoh.CongestionControl.DROP,
            express=flush,
        )

    def deliver(self, key: str, data: bytes) -> None:
        """Send a message that waits for room, where those of publishers are dropped.

        Args:
            key: relative to the namespace.
            data: the message.
        """
        block = zenoh.CongestionControl.BLOCK
        self.session.put(key, data, congestion_control=block)

    def channel(self, key: str, *, depth: int) -> Channel:
        """Subscribe to a key; see :class:`Channel`."""
        return Channel(self.session, key, waker=self.waker, depth=depth)

    def queryable(self, key: str, answer: Callable[[zenoh.Query], None]) -> None:
        """Answer queries on a key.

        Args:
            key: relative to the namespace.
            answer: called on Zenoh's thread; must be quick and not raise.
        """
        self.session.declare_queryable(key, Callback(answer, indirect=False))

    def announce(self, key: str) -> None:
        """Declare a liveliness token; it ends with the session or the process."""
        self._tokens.append(self.session.liveliness().declare_token(key))

    def settle(self) -> None:
        """Wait until a presence watch knows everyone who is there.

        It sends a query that nobody answers. The query's end arrives on the same path,
        after the first reports to the watch. A query for the tokens would not do: Zenoh
        leaves out those that the session has already heard of.
        """
        for _ in self.session.liveliness().get(_NOBODY, timeout=SETTLE_S):
            pass

    def watch_presence(self, key: str, changed: Callable[[str, bool], None]) -> None:
        """Watch liveliness tokens, including those already there.

        Args:
            key: a key, or a pattern such as ``alive/stabilizer/*``.
            changed: called on Zenoh's thread with the token's key and whether it is
                there; must be quick and not raise.
        """

        def on_sample(sample: zenoh.Sample) -> None:
            changed(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        self.session.liveliness().declare_subscriber(
            key, Callback(on_sample, indirect=False), history=True
        )


def bytes_of(query: zenoh.Query) -> bytes:
    """Return the payload of a query; empty when it has none."""
    return b"" if query.payload is None else query.payload.to_bytes()


@contextmanager
def dialed_bus(
    endpoints: Endpoints, *, namespace: str, timeout_s: float
) -> Iterator[Bus]:
    """Open the bus as a client, in short attempts.

    Args:
        endpoints: where to dial.
        namespace: put before every key; empty for a tool that looks at all robots.
        timeout_s: how long to dial in all [s].

    Raises:
        EndpointError: a locator is malformed.
        RobotUnreachableError: nobody answered in time.
    """
    with ExitStack() as stack:
        bus = dial(stack, endpoints, namespace=namespace, timeout_s=timeout_s)
        assert bus is not None
        yield bus


def dial(
    stack: ExitStack,
    endpoints: Endpoints,
    *,
    namespace: str,
    timeout_s: float,
    pace: Pace = Pace.REALTIME,
    stop: StopRequest | None = None,
) -> Bus | None:
    """Open the bus as :func:`dialed_bus` does, unless asked to stop meanwhile.

    Returns:
        The bus; None when the dialing was stopped.
    """
    begin_s, attempt_s = time.monotonic(), min(DIAL_S, timeout_s)
    is_told = False
    while stop is None or not stop.is_set:
        bus = Bus(
            endpoints, Role.CLIENT, namespace=namespace, timeout_s=attempt_s, pace=pace
        )
        try:
            return stack.enter_context(bus)
        except RobotUnreachableError:
            waited_s = time.monotonic() - begin_s
            if waited_s >= timeout_s:
                words = unreachable(endpoints, "nobody answers", timeout_s)
                raise RobotUnreachableError(words) from None
            if waited_s >= TELL_S and not is_told:
                is_told = True
                words = unreachable(endpoints, "nobody answers", round(waited_s))
                _LOG.warning("%s; still dialing", words)
    return None


@contextmanager
def private_bus() -> Iterator[Endpoints]:
    """Provide a private bus: a Unix socket in a folder that only this user enters.

    No other process can take its address meanwhile, and it costs the loop less than
    loopback. Without such sockets, or with a long path, it is a free loopback port.
    """
    with tempfile.TemporaryDirectory(prefix="surefoot-") as folder:
        path = f"{folder}/bus"
        if os.name != "posix" or len(path.encode()) > LONGEST_SOCKET_PATH:
            yield loopback_endpoints()
            return
        locator = f"unixsock-stream/{path}"
        yield _one_host(locator)


def loopback_endpoints() -> Endpoints:
    """Choose a free port of the loopback interface for both sides of one run."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    return _one_host(f"tcp/127.0.0.1:{port}")


def _one_host(locator: str) -> Endpoints:
    return Endpoints(listen=[locator], connect=[locator], lease_ms=ONE_HOST_LEASE_MS)


def measure_loopback(endpoints: Endpoints) -> Distribution:
    """Open both ends of a bus in this process and send messages to and fro.

    Returns:
        Round-trip times [ms].

    Raises:
        EndpointError: Zenoh cannot listen there.
        RobotUnreachableError: no connection, or no answer.
    """
    with (
        Bus(endpoints, Role.ROBOT, namespace=_NAMESPACE) as far,
        Bus(endpoints, Role.CLIENT, namespace=_NAMESPACE) as near,
    ):
        back = far.publisher("back", urgent=True, flush=True)

        def answer(sample: zenoh.Sample) -> None:
            back.put(sample.payload)

        far.session.declare_subscriber("forth", Callback(answer, indirect=False))
        forth = near.publisher("forth", urgent=True, flush=True)
        channel = near.channel("back", depth=1)
        payload = bytes(_BYTES)

        def round_trip() -> float:
            begin = time.monotonic()
            forth.put(payload)
            if channel.wait(begin + _ANSWER_S) is None:
                raise RobotUnreachableError(
                    f"no answer on {endpoints.listen[0]} within {_ANSWER_S:g} s"
                )
            return time.monotonic() - begin

        _wait_for_match(forth, back)
        for _ in range(_WARM_UP):
            round_trip()
        times_ms = [MS_PER_S * round_trip() for _ in range(ROUND_TRIPS)]
    return distribution_of(times_ms)


def _wait_for_match(*publishers: zenoh.Publisher) -> None:
    """Wait until each publisher has its subscriber; earlier messages would be lost.

    Raises:
        RobotUnreachableError: a publisher found no subscriber in time.
    """
    end = time.monotonic() + _ANSWER_S
    # The type stubs lack this property.
    while not all(p.matching_status.matching for p in publishers):  # type: ignore[attr-defined]
        if time.monotonic() >= end:
            raise RobotUnreachableError(
                f"the two ends did not find each other within {_ANSWER_S:g} s"
            )
        time.sleep(_POLL_S)  # a listener would need a thread for this one moment
