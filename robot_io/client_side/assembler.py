"""Joins the sensor messages of a tick into one snapshot for the controller."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any, Generic, NamedTuple

from surefoot.robot_io.bus.channel import NEVER, Inbox, M
from surefoot.robot_io.snapshot import Ages, Snapshot, SnapshotLayout, ages_of
from surefoot.schemas.messages import Message

CAUGHT_UP_TICKS = 1
KNOWN_PATIENCE_S = 0.05
"""Longest wait for a sensor that was lost before [s]."""


class SensorReader(Generic[M]):
    """The newest reading of one sensor, and whether to wait for the next one.

    Attributes:
        name: name of its channel.
        inbox: receives its messages.
        latest: newest message taken; None before the first.
        passed: messages taken one by one since the last snapshot.
        is_lost: whether it has kept the others waiting too long. It is not waited for
            until it has caught up with them.
        patience_s: longest time it may keep the others waiting; shorter once it was
            lost [s].
    """

    def __init__(self, name: str, inbox: Inbox[M], *, patience_s: float) -> None:
        """Begin without any message."""
        self.name = name
        self.inbox = inbox
        self.latest: M | None = None
        self.passed: list[M] = []
        self.is_lost = False
        self.patience_s = patience_s

    @property
    def tick(self) -> int:
        """Tick of the newest message taken."""
        return NEVER if self.latest is None else self.latest.tick

    def take(self) -> None:
        """Take the message at the head of the inbox."""
        self.latest = self.inbox.peek()
        self.inbox.drop()
        if self.latest is not None:
            self.passed.append(self.latest)

    def take_newest(self) -> None:
        """Take all messages received so far; the last one counts."""
        while self.inbox.peek() is not None:
            self.take()

    def give_up(self) -> None:
        """Stop waiting for this sensor until it has caught up."""
        self.is_lost = True
        self.patience_s = min(self.patience_s, KNOWN_PATIENCE_S)

    def reach(self, tick: int) -> None:
        """Take messages up to the given tick; wait for that one unless lost."""
        head = self.inbox.peek()
        if head is not None and head.tick == tick:  # nearly always
            self.latest = head
            self.inbox.drop()
            self.is_lost = False
        else:
            self._catch_up(tick)

    def restart(self) -> None:
        """Begin anew with a restarted robot."""
        self.inbox.restart()
        self.latest = None
        self.passed.clear()
        self.is_lost = False

    def _catch_up(self, tick: int) -> None:
        """Take late messages, and wait for the one of this tick."""
        while self.tick < tick:
            head = self.inbox.peek()
            if head is None and not self.is_lost:
                head = self.inbox.peek_wait(time.monotonic() + self.patience_s)
            if head is None:
                if self.is_lost and tick - self.tick <= CAUGHT_UP_TICKS:
                    self.is_lost = False
                else:
                    self.give_up()
                return
            if head.tick > tick:  # this tick's message never came, but the sensor lives
                break
            self.take()
        self.is_lost = False


class SnapshotReading(NamedTuple):
    """A snapshot and its freshness.

    Attributes:
        snapshot: sensors of one tick.
        stale: names of the channels whose message of this tick did not come; the
            snapshot holds their newest values.
        ages: ticks since each channel's message, in the order of the sensor table.
        complete_ns: end of the wait for it, on ``time.perf_counter_ns`` [ns].
        overtaken: complete snapshots since the last reading that this one has
            overtaken, oldest first: nobody has answered them.
    """

    snapshot: Snapshot
    stale: tuple[str, ...]
    ages: Ages
    complete_ns: int
    overtaken: tuple[Snapshot, ...] = ()


class SnapshotAssembler:
    """Waits for the sensors of a tick and joins them.

    The robot sends them in a fixed order. So the arrival of the last one shows that the
    others are there: one wait per tick. A sensor that keeps the others waiting for
    longer than its patience is left out, with its old values kept, until it is back.
    """

    def __init__(
        self,
        sensors: Sequence[SensorReader[Any]],
        *,
        joint_count: int,
        in_order: bool,
    ) -> None:
        """Join sensors.

        Args:
            sensors: all sensors, in the order of sending.
            joint_count: number of joints n_a.
            in_order: deliver every tick once, none skipped (lockstep); otherwise
                the newest.
        """
        self._sensors = sensors
        self._in_order = in_order
        self._partial_since_s = math.inf
        self._tick = NEVER
        self._complete_ns = 0
        self._layout = SnapshotLayout(joint_count)

    def wait(self, deadline: float) -> SnapshotReading | None:
        """Wait for the next snapshot.

        Args:
            deadline: end of the wait, on ``time.monotonic`` [s].

        Returns:
            The snapshot; None when the deadline has passed or an interrupt came.
        """
        while True:
            tick = self._next_tick(deadline)
            if tick is None:
                return None
            for sensor in self._sensors:
                sensor.reach(tick)
            last, self._tick = self._tick, tick
            overtaken = self._overtaken(last)
            messages = [s.latest for s in self._sensors if s.latest is not None]
            if len(messages) == len(self._sensors):
                return self._join(tick, messages, overtaken)

    def missing(self) -> tuple[str, ...]:
        """Return the channels without any message so far."""
        return tuple(s.name for s in self._sensors if s.latest is None)

    def restart(self) -> None:
        """Forget everything: the robot has begun anew."""
        for sensor in self._sensors:
            sensor.restart()
        self._partial_since_s = math.inf
        self._tick = NEVER

    def _next_tick(self, deadline: float) -> int | None:
        """Return the next tick to join, once its last sensor's message is there."""
        while True:
            last = self._last_sensor()
            limit = min(deadline, time.monotonic() + last.patience_s)
            head = last.inbox.peek_wait(limit)
            if head is not None:
                self._complete_ns = time.perf_counter_ns()
                self._partial_since_s = math.inf
                if head.tick > self._tick:
                    return self._choose(last)
                last.take()  # late: its tick was answered long ago
                continue
            if last.inbox.was_interrupted:
                return None
            self._doubt(last)
            if time.monotonic() >= deadline:
                return None

    def _last_sensor(self) -> SensorReader[Any]:
        """Return the sensor that is sent last among those not lost."""
        alive = [sensor for sensor in self._sensors if not sensor.is_lost]
        return alive[-1] if alive else self._sensors[-1]

    def _choose(self, last: SensorReader[Any]) -> int:
        if not self._in_order:
            last.take_newest()
            return last.tick
        heads = [sensor.inbox.peek() for sensor in self._sensors]
        ticks: list[int] = [head.tick for head in heads if head is not None]
        return min(tick for tick in ticks if tick > self._tick)

    def _doubt(self, last: SensorReader[Any]) -> None:
        """Give up the last sensor if the others came without it long ago."""
        others = (s for s in self._sensors if s is not last)
        now_s = time.monotonic()
        last.is_lost = False
        if not any(s.inbox.peek() is not None for s in others):
            self._partial_since_s = math.inf
        elif now_s - self._partial_since_s >= last.patience_s:
            self._partial_since_s = math.inf
            last.give_up()
        else:
            self._partial_since_s = min(self._partial_since_s, now_s)

    def _overtaken(self, last: int) -> tuple[Snapshot, ...]:
        """Join the ticks since the last reading that nobody has answered."""
        passed = [sensor.passed for sensor in self._sensors]
        if not any(passed):  # nearly always
            return ()
        joined = self._layout.join_passed(passed, after=last, before=self._tick)
        for messages in passed:
            messages.clear()
        return () if last == NEVER else joined

    def _join(
        self, tick: int, messages: Sequence[Message], overtaken: tuple[Snapshot, ...]
    ) -> SnapshotReading:
        snapshot = self._layout.join(tick, messages)
        ages = ages_of(messages, tick)
        stale: tuple[str, ...] = ()
        if any(ages):
            stale = tuple(s.name for s in self._sensors if s.tick != tick)
        return SnapshotReading(snapshot, stale, ages, self._complete_ns, overtaken)
