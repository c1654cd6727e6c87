"""Tables about records, for people."""

from __future__ import annotations

from collections.abc import Iterable

from rich.table import Table

from cli.recording.channel_count import ChannelCount


def counts_table(counts: Iterable[ChannelCount]) -> Table:
    """What came on each channel, and what is missing."""
    table = Table("channel", "messages", "first", "last", "missing", "restarts")
    for count in counts:
        counted = bool(count.counted_by)
        table.add_row(
            count.channel,
            str(count.messages),
            "-" if count.first is None else str(count.first),
            "-" if count.last is None else str(count.last),
            f"{count.missing} by {count.counted_by}" if counted else "-",
            str(count.restarts) if counted else "-",
        )
    return table
