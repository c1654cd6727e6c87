"""Turns the bytes of a channel into checked messages of one kind."""

from __future__ import annotations

from typing import Generic, TypeVar

import msgspec

from robot_io.channel import Channel
from schemas.codec import decode
from schemas.errors import MessageError

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

    def _decode(self, data: bytes) -> T | None:
        """The message, or None when it cannot be read."""
        try:
            return decode(data, self._kind, joint_count=self._joint_count)
        except MessageError as error:
            self.malformed += 1
            self.error = str(error)
            return None
