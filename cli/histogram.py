"""Times of a loop as bars that a terminal can show."""

from __future__ import annotations

from rich.table import Table

from schemas.result import Histogram

BAR_WIDTH = 40
_EIGHTHS = " ▏▎▍▌▋▊▉"


def histogram_table(name: str, histogram: Histogram) -> Table:
    """One line per range of times that anything fell into, or lies between such.

    Bars are proportional to the share, and whatever happened at all shows at least a
    sliver: the rare late tick is what one looks for.

    Args:
        name: what was timed.
        histogram: how often it took how long.
    """
    edges, counts = histogram.edges_ms, histogram.counts
    total = sum(counts)
    table = Table(title=f"{name}, {total} times", title_justify="left", box=None)
    table.add_column("ms", justify="right", no_wrap=True)
    table.add_column("", width=BAR_WIDTH, no_wrap=True)
    table.add_column("count", justify="right", no_wrap=True)
    table.add_column("share", justify="right", no_wrap=True)
    filled = [index for index, count in enumerate(counts) if count]
    if not filled:
        return table
    most = max(counts)
    for index in range(filled[0], filled[-1] + 1):
        count = counts[index]
        table.add_row(
            _range(edges, index),
            _bar(count / most),
            str(count),
            f"{100.0 * count / total:.2f} %",
        )
    return table


def _range(edges: list[float], index: int) -> str:
    if index == 0:
        return f"under {edges[0]:g}"
    if index == len(edges):
        return f"over {edges[-1]:g}"
    return f"{edges[index - 1]:g} to {edges[index]:g}"


def _bar(share: float) -> str:
    eighths = round(8 * BAR_WIDTH * share)
    if share > 0.0:
        eighths = max(1, eighths)
    return "█" * (eighths // 8) + _EIGHTHS[eighths % 8].strip()
