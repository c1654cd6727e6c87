"""The table of ``surefoot hz``."""

from __future__ import annotations

from collections.abc import Iterable

from rich.table import Table

from cli.bus.timing import ChannelTiming
from schemas.result import Distribution

NONE = "-"
_FINE_MS, _COARSE_MS = 10.0, 100.0
_HEADINGS = (
    "Hz",
    *("jitter\nmedian", "(ms)\np99", "\nmax"),
    *("delay\nmedian", "(ms)\np99", "\nmax"),
    *("gaps", "double", "late", "bad"),
)


def hz_table(timings: Iterable[ChannelTiming]) -> Table:
    """One line a channel."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("channel", no_wrap=True)
    for heading in _HEADINGS:
        table.add_column(heading, justify="right", no_wrap=True)
    for timing in timings:
        table.add_row(
            timing.channel,
            NONE if timing.rate_hz is None else f"{timing.rate_hz:.1f}",
            *_times(timing.jitter_ms),
            *_times(timing.delay_ms),
            _count(timing.gaps),
            _count(timing.duplicates),
            _count(timing.out_of_order),
            str(timing.unreadable),
        )
    return table


def _count(value: int | None) -> str:
    return NONE if value is None else str(value)


def _times(times: Distribution | None) -> tuple[str, str, str]:
    if times is None:
        return NONE, NONE, NONE
    return _ms(times.median), _ms(times.p99), _ms(times.max)


def _ms(value: float) -> str:
    """As many digits as are of interest, in four or five characters."""
    if abs(value) < _FINE_MS:
        return f"{value:.2f}"
    return f"{value:.1f}" if abs(value) < _COARSE_MS else f"{value:.0f}"
