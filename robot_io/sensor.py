"""One sensor of the robot as the controller's side sees it."""

from __future__ import annotations

import time
from typing import Generic

from robot_io.inbox import NEVER, Inbox, M

CAUGHT_UP_TICKS = 1


class Sensor(Generic[M]):
    """The newest reading of one sensor, and whether one may wait for the next.

    Attributes:
        name: name of its channel.
        inbox: where its messages come in.
        latest: newest message taken; None before the first.
        is_lost: it has kept the others waiting, and is not waited for until it has
            caught up with them.
    """

    def __init__(self, name: str, inbox: Inbox[M]) -> None:
        """Nothing has come yet."""
        self.name = name
        self.inbox = inbox
        self.latest: M | None = None
        self.is_lost = False

    @property
    def tick(self) -> int:
        """Tick of the newest message taken."""
        return NEVER if self.latest is None else self.latest.tick

    def take(self) -> None:
        """Takes the message at the head of the inbox."""
        self.latest = self.inbox.peek()
        self.inbox.drop()

    def take_newest(self) -> None:
        """Takes all messages there are; the last one counts."""
        while self.inbox.peek() is not None:
            self.take()

    def reach(self, tick: int, *, patience_s: float) -> None:
        """Takes messages up to one of a tick, waiting for it unless it is lost.

        Args:
            tick: the tick wanted.
            patience_s: how long to wait [s].
        """
        head = self.inbox.peek()
        if head is not None and head.tick == tick:  # nearly always
            self.latest = head
            self.inbox.drop()
            self.is_lost = False
        else:
            self._catch_up(tick, patience_s)

    def restart(self) -> None:
        """The robot has begun anew."""
        self.inbox.restart()
        self.latest = None
        self.is_lost = False

    def _catch_up(self, tick: int, patience_s: float) -> None:
        """Takes late messages, and waits for the one of the tick."""
        while self.tick < tick:
            head = self.inbox.peek()
            if head is None and not self.is_lost:
                head = self.inbox.peek_wait(time.monotonic() + patience_s)
            if head is None:
                has_caught_up = tick - self.tick <= CAUGHT_UP_TICKS
                self.is_lost = not (self.is_lost and has_caught_up)
                return
            if head.tick > tick:  # the one wanted never came, but the sensor lives
                break
            self.take()
        self.is_lost = False
