"""Messages of one channel, checked, each tick once and in order."""

from __future__ import annotations

from typing import TypeVar

from robot_io.channel import Channel
from robot_io.message_reader import MessageReader
from schemas.messages import Message

M = TypeVar("M", bound=Message)
NEVER = -1


class Inbox(MessageReader[M]):
    """Reads a channel message by message.

    What cannot be read is counted and skipped; so is what comes twice, or after a
    message of a later tick.

    Attributes:
        outdated: messages that came twice or too late.
    """

    def __init__(
        self, channel: Channel, kind: type[M], *, joint_count: int | None = None
    ) -> None:
        """Reads from a channel; see :class:`MessageReader`."""
        super().__init__(channel, kind, joint_count=joint_count)
        self.outdated = 0
        self._head: M | None = None
        self._last_tick = NEVER

    def peek(self) -> M | None:
        """The next message, left where it is; None when there is none yet."""
        while self._head is None:
            data = self._channel.poll()
            if data is None:
                return None
            self._head = self._read(data)
        return self._head

    def peek_wait(self, deadline: float) -> M | None:
        """The next message, waited for.

        Args:
            deadline: until when, on ``time.monotonic`` [s].

        Returns:
            None when the deadline has passed or the wait was broken off.
        """
        while self._head is None:
            data = self._channel.wait(deadline)
            if data is None:
                return None
            self._head = self._read(data)
        return self._head

    @property
    def was_nudged(self) -> bool:
        """Whether the last wait that gave None was broken off before its deadline."""
        return self._channel.was_nudged

    def drop(self) -> None:
        """Moves on to the next message."""
        if self._head is not None:
            self._last_tick = self._head.tick
            self._head = None

    def restart(self) -> None:
        """Forgets what has come; ticks may begin anew."""
        self._channel.discard()
        self._head = None
        self._last_tick = NEVER

    def _read(self, data: bytes) -> M | None:
        message = self._decode(data)
        if message is not None and message.tick <= self._last_tick:
            self.outdated += 1
            return None
        return message
