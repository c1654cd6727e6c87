"""The newest message of a channel that need not be read in full."""

from __future__ import annotations

from typing import Generic, TypeVar

import msgspec

from robot_io.channel import Channel
from schemas.codec import decode
from schemas.errors import MessageError

T = TypeVar("T", bound=msgspec.Struct)


class Latest(Generic[T]):
    """Keeps the newest valid message of a channel.

    Attributes:
        malformed: messages that could not be read.
        error: what was wrong with the last of these.
    """

    def __init__(
        self, channel: Channel, kind: type[T], *, joint_count: int | None = None
    ) -> None:
        """Reads from a channel.

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
        self._message: T | None = None

    def poll(self) -> T | None:
        """The newest message so far, the same object until a newer one comes."""
        while (data := self._channel.poll()) is not None:
            try:
                self._message = decode(data, self._kind, joint_count=self._joint_count)
            except MessageError as error:
                self.malformed += 1
                self.error = str(error)
        return self._message

    def forget(self) -> None:
        """Forgets what has come so far."""
        self._channel.discard()
        self._message = None
