"""Counts the messages of a channel, and what is missing between them."""

from __future__ import annotations

from typing import Any

import msgspec

from surefoot.schemas.codec import Head
from surefoot.schemas.errors import MessageError
from surefoot.schemas.messages import Count
from surefoot.schemas.topics import TICK_SENSORS, TOPICS

LARGEST_GAP = 1_000_000
"""Numbers passed over at once, beyond which they are another sender's: a quarter of
an hour of a robot at 1 kHz."""
_COMMANDS = "joint_command"
_OURS = frozenset(entry.name for entry in TOPICS)


class _CommandHead(Head, frozen=True):
    commander: str
    sequence: Count


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
    unreadable: int = 0
    """Messages that are none of the channel; in a record of ours they are kept, as
    bytes, on a channel of their own."""
    encoding: str = ""
    """What the messages are written in, where that is nothing we read."""

    def add(self, number: int, *, is_new_sender: bool = False) -> None:
        """Count one message.

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
        elif is_new_sender or number <= last or number - last > LARGEST_GAP:
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


def count_message(count: ChannelCount, message: dict[str, Any]) -> Head | None:
    """Count a decoded message of the channel.

    Returns:
        Its tick and stamp; None for a channel of another program, which needs none.

    Raises:
        MessageError: it lacks what it is counted by; it is not counted.
    """
    if count.channel not in _OURS:
        count.messages += 1
        return None
    is_command = count.channel == _COMMANDS
    try:
        head = msgspec.convert(message, _CommandHead if is_command else Head)
    except msgspec.ValidationError as error:
        raise MessageError(f"{count.channel}: {error}") from error
    if isinstance(head, _CommandHead):
        is_new, count.commander = head.commander != count.commander, head.commander
        count.add(head.sequence, is_new_sender=is_new)
    else:
        count.add(head.tick)
    return head
