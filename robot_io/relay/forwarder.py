"""Carries one channel from one side of the relay to the other."""

from __future__ import annotations

import threading
import time
from functools import partial

import zenoh
from zenoh.handlers import Callback

from robot_io.bus import Bus
from robot_io.relay.dispatcher import Dispatcher
from robot_io.relay.lane import Lane
from robot_io.relay.parcel import Parcel
from robot_io.relay.plan_clock import PlanClock
from schemas.topics import TICK_SENSORS

COMMAND = "joint_command"
URGENT = (*TICK_SENSORS, COMMAND)
"""Channels of the control loop, sent before everything else as their owners do."""


class Forwarder:
    """Subscribes on one side, publishes on the other.

    What goes on at once does so on Zenoh's own thread; what waits is sent by the
    dispatcher, and so is everything behind it, to keep the order.
    """

    def __init__(
        self,
        name: str,
        key: str,
        *,
        source: Bus,
        target: Bus,
        lane: Lane,
        dispatcher: Dispatcher,
        clock: PlanClock,
    ) -> None:
        """Begins to carry.

        Args:
            name: of the channel.
            key: of the channel, relative to the namespace.
            source: where it is said.
            target: where it is to be heard.
            lane: what becomes of its messages.
            dispatcher: sends what waits.
            clock: of the plan.
        """
        self._begins_clock = name == COMMAND
        self._lane, self._dispatcher, self._clock = lane, dispatcher, clock
        self._waiting = 0
        self._lock = threading.Lock()
        self._publisher = target.publisher(
            key, urgent=name in URGENT, flush=name == TICK_SENSORS[-1]
        )
        self._subscriber = source.session.declare_subscriber(
            key, Callback(self._on_sample, indirect=False)
        )

    def close(self) -> None:
        """Hears nothing more."""
        # Zenoh gives this method no types.
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]

    def _on_sample(self, sample: zenoh.Sample) -> None:
        now_s = time.monotonic()
        if self._begins_clock:
            self._clock.begin(now_s)
        parcels = self._lane.pass_on(
            sample.payload.to_bytes(),
            now_s=now_s,
            elapsed_s=self._clock.elapsed_s(now_s),
        )
        for parcel in parcels:
            self._send(parcel, now_s)

    def _send(self, parcel: Parcel, now_s: float) -> None:
        if self._waiting == 0 and parcel.at_s <= now_s:
            self._publisher.put(parcel.data)
            return
        with self._lock:
            self._waiting += 1
        self._dispatcher.do(partial(self._deliver, parcel.data), at_s=parcel.at_s)

    def _deliver(self, data: bytes) -> None:
        self._publisher.put(data)
        with self._lock:  # only now may the next one go on without waiting
            self._waiting -= 1
