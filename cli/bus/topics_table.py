"""The tables of ``surefoot topics``."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table

from cli.bus.topics import Topics

NONE = "-"


def topics_table(told: Topics) -> Table:
    """One line a channel."""
    namespace = told.channels[0].key.split("/")[0]
    table = _table(
        f"{told.robot}: keys under {namespace}/, heard for {told.listened_s:.1f} s",
        ("channel", "key", "type"),
    )
    for row in told.channels:
        table.add_row(
            row.channel,
            escape(row.key.removeprefix(f"{namespace}/")),
            row.type,
            _names(row.publishers),
            _names(row.subscribers),
            _rate(row.rate_hz),
            _size(row.bytes),
        )
    return table


def unknown_table(told: Topics) -> Table:
    """One line a key that is no channel."""
    table = _table(f"keys that are no channel of {told.robot}", ("key",))
    for row in told.unknown:
        table.add_row(
            escape(row.key),
            _names(row.publishers),
            _names(row.subscribers),
            _rate(row.rate_hz),
            _size(row.bytes),
        )
    return table


def _table(title: str, first: tuple[str, ...]) -> Table:
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for heading in first:
        table.add_column(heading, no_wrap=heading == "channel", overflow="fold")
    table.add_column("from", overflow="fold")
    table.add_column("heard by", overflow="fold")
    table.add_column("Hz", justify="right")
    table.add_column("bytes", justify="right")
    return table


def _names(names: list[str] | None) -> str:
    """What they are; who exactly is told under the table."""
    if names is None:
        return "?"
    kinds = dict.fromkeys(name.split()[0] for name in names)
    return escape(", ".join(kinds)) or NONE


def _rate(rate_hz: float) -> str:
    return f"{rate_hz:.0f}" if rate_hz else NONE


def _size(size: float | None) -> str:
    return NONE if size is None else f"{size:.0f}"
