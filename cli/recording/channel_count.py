"""Counts the messages of one channel, and those that are missing between them."""

from __future__ import annotations

from typing import Any

import msgspec

from schemas.topics import TICK_SENSORS

_COMMANDS = "joint_command"


class ChannelCount(msgspec.Struct, kw_only=True):
    """What came on a channel.

    ``first`` and ``last`` are ticks; for commands they are sequence numbers, and
    for channels that do not speak every tick nothing can be known to be missing.
    """

    channel: str
    counted_by: str
    """``tick``, ``sequence``, or empty for a channel without a fixed rate."""
    messages: int = 0
    first: int | None = None
    last: int | None = None
    missing: int = 0
    """Numbers passed over between the first message and the last."""
    gaps: int = 0
    """Places where some are missing."""
    commander: str = ""
    """Who sent the latest command."""
    restarts: int = 0
    """Times the count did not go on but began anew: another robot or commander."""

    def add(self, number: int, *, is_new_sender: bool = False) -> None:
        """Counts one message.

        Args:
            number: its tick, or its sequence number.
            is_new_sender: it cannot be compared with the one before.
        """
        self.messages += 1
        last, self.last = self.last, number
        if last is None:
            self.first = number
        elif not self.counted_by:
            return
        elif is_new_sender or number <= last:
            self.restarts += 1
        elif number > last + 1:
            self.missing += number - last - 1
            self.gaps += 1


def new_count(channel: str) -> ChannelCount:
    """A count of a channel by what its messages are numbered with."""
    if channel == _COMMANDS:
        return ChannelCount(channel=channel, counted_by="sequence")
    by = "tick" if channel in TICK_SENSORS else ""
    return ChannelCount(channel=channel, counted_by=by)


def count_message(count: ChannelCount, message: dict[str, Any]) -> None:
    """Counts a decoded message of the channel.

    Raises:
        KeyError: it lacks what it is counted by.
    """
    if count.channel != _COMMANDS:
        count.add(message["tick"])
        return
    is_new = message["commander"] != count.commander
    count.commander = message["commander"]
    count.add(message["sequence"], is_new_sender=is_new)
