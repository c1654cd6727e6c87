"""What a robot has sent while it was answered."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.codec import decode
from surefoot.schemas.errors import MessageError
from surefoot.schemas.topics import TICK_SENSORS, topic


class Read(NamedTuple):
    """What a channel has told.

    Attributes:
        messages: those that could be read, in the order they came.
        malformed: how many could not.
        error: what was wrong with the last of these.
    """

    messages: list[Any]
    malformed: int
    error: str


class Recording:
    """Sensor messages by channel, in the order they came.

    They are read when they are asked for: all of them, while the robot waits for an
    answer, would be more than a busy computer can do in time.
    """

    def __init__(self, *, joint_count: int) -> None:
        """Begin empty.

        Args:
            joint_count: n_a.
        """
        self._joint_count = joint_count
        self._payloads: dict[str, list[bytes]] = {name: [] for name in TICK_SENSORS}
        self._read: dict[str, Read] = {}

    def add(self, channel: str, payload: bytes) -> None:
        """Keep what has come, unread."""
        self._payloads[channel].append(payload)

    def read(self, channel: str) -> Read:
        """Read what has come on a channel; nothing more may be added to it."""
        if channel not in self._read:
            messages, malformed, error = [], 0, ""
            kind = topic(channel).message
            for payload in self._payloads[channel]:
                try:
                    messages.append(
                        decode(payload, kind, joint_count=self._joint_count)
                    )
                except MessageError as why:
                    malformed, error = malformed + 1, str(why)
            self._read[channel] = Read(messages, malformed, error)
        return self._read[channel]

    def column(self, channel: str, name: str) -> Array:
        """Return one field of a channel's messages: (messages,) or (messages, size)."""
        return np.array([getattr(m, name) for m in self.read(channel).messages])

    def mean(self, channel: str, name: str) -> Array:
        """Return the mean of one field over the recording."""
        mean: Array = self.column(channel, name).mean(axis=0)
        return mean
