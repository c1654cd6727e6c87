"""The newest message of a channel that need not be read in full."""

from __future__ import annotations

from robot_io.channel import Channel
from robot_io.message_reader import MessageReader, T


class Latest(MessageReader[T]):
    """Keeps the newest valid message of a channel."""

    def __init__(
        self, channel: Channel, kind: type[T], *, joint_count: int | None = None
    ) -> None:
        """Reads from a channel; see :class:`MessageReader`."""
        super().__init__(channel, kind, joint_count=joint_count)
        self._message: T | None = None

    def poll(self) -> T | None:
        """The newest message so far, the same object until a newer one comes."""
        while (data := self._channel.poll()) is not None:
            message = self._decode(data)
            if message is not None:
                self._message = message
        return self._message

    def forget(self) -> None:
        """Forgets what has come so far."""
        self._channel.discard()
        self._message = None
