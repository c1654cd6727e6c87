"""What a robot said while it was listened to."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from schemas.arrays import Array
from schemas.topics import TICK_SENSORS


@dataclass
class Recording:
    """Sensor messages by channel, in the order they came.

    Attributes:
        messages: those that could be read.
        malformed: how many could not.
        error: what was wrong with the last of these.
    """

    messages: dict[str, list[Any]] = field(
        default_factory=lambda: {name: [] for name in TICK_SENSORS}
    )
    malformed: dict[str, int] = field(
        default_factory=lambda: dict.fromkeys(TICK_SENSORS, 0)
    )
    error: dict[str, str] = field(
        default_factory=lambda: dict.fromkeys(TICK_SENSORS, "")
    )

    def column(self, channel: str, name: str) -> Array:
        """One field of all messages of a channel: (messages,) or (messages, size)."""
        return np.array([getattr(m, name) for m in self.messages[channel]])

    def mean(self, channel: str, name: str) -> Array:
        """Mean of one field over the recording."""
        mean: Array = self.column(channel, name).mean(axis=0)
        return mean
