"""Messages of one channel, checked, each tick once and in order."""

from __future__ import annotations

from typing import Generic, TypeVar

import msgspec

from surefoot.robot_io.bus.channel import Channel
from surefoot.schemas.codec import decode
from surefoot.schemas.errors import MessageError
from surefoot.schemas.messages import Message

M = TypeVar("M", bound=Message)
NEVER = -1
T = TypeVar("T", bound=msgspec.Struct)


class MessageReader(Generic[T]):
    """What every reader of a channel does: check, and count what cannot be read.

    Attributes:
        malformed: messages that could not be read.
        error: what was wrong with the last of these.
    """

    def __init__(
        self, channel: Channel, kind: type[T], *, joint_count: int | None = None
    ) -> None:
        """Read from a channel.

        Args:
            channel: where the bytes come from.
            kind: what they must be.
            joint_count: n_a, when the message holds per-joint fields.
        """
        self.malformed = 0
        self.error = ""
        self._channel = channel
        self._kind = kind
        self._joint_count = joint_count

    def _decode(self, data: bytes) -> T | None:
        """Return the message, or None when it cannot be read."""
        try:
            return decode(data, self._kind, joint_count=self._joint_count)
        except MessageError as error:
            self.malformed += 1
            self.error = str(error)
            return None


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
        """Read from a channel; see :class:`MessageReader`."""
        super().__init__(channel, kind, joint_count=joint_count)
        self.outdated = 0
        self._head: M | None = None
        self._last_tick = NEVER

    def peek(self) -> M | None:
        """Return the next message without taking it; None if there is none yet."""
        while self._head is None:
            data = self._channel.poll()
            if data is None:
                return None
            self._head = self._read(data)
        return self._head

    def peek_wait(self, deadline: float) -> M | None:
        """Wait for the next message and return it, without taking it.

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
    def was_interrupted(self) -> bool:
        """Whether the last wait that gave None was broken off before its deadline."""
        return self._channel.was_interrupted

    def drop(self) -> None:
        """Move on to the next message."""
        if self._head is not None:
            self._last_tick = self._head.tick
            self._head = None

    def restart(self) -> None:
        """Forget what has come; ticks may begin anew."""
        self._channel.discard()
        self._head = None
        self._last_tick = NEVER

    def _read(self, data: bytes) -> M | None:
        message = self._decode(data)
        if message is not None and message.tick <= self._last_tick:
            self.outdated += 1
            return None
        return message


class Latest(MessageReader[T]):
    """Keeps the newest valid message of a channel."""

    def __init__(
        self, channel: Channel, kind: type[T], *, joint_count: int | None = None
    ) -> None:
        """Read from a channel; see :class:`MessageReader`."""
        super().__init__(channel, kind, joint_count=joint_count)
        self._message: T | None = None

    def poll(self) -> T | None:
        """Return the newest message so far, the same object until a newer one comes."""
        while (data := self._channel.poll()) is not None:
            message = self._decode(data)
            if message is not None:
                self._message = message
        return self._message

    def forget(self) -> None:
        """Forget what has come so far."""
        self._channel.discard()
        self._message = None
