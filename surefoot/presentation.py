"""What people are shown: Markdown and CSV tables, units, drawings, bars of progress."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, Protocol

from surefoot.out_folder import write_whole

_UNITS = {
    "nm_s_rad": "N m s/rad",
    "kg_m2": "kg m^2",
    "nm_rad": "N m/rad",
    "deg_s": "deg/s",
    "rad_s": "rad/s",
    "m_s2": "m/s^2",
    "m_s": "m/s",
    "n_s": "N s",
    "weights": "body weights",
    "scale": "1",
    "nm": "N m",
    "hz": "Hz",
    "n": "N",
    **{
        unit: unit for unit in ("deg", "rad", "mm", "ms", "ns", "kg", "m", "s", "bytes")
    },
}
"""Unit suffixes of names, longer ones first, and their units."""


def split_unit(name: str) -> tuple[str, str]:
    """Return a value's name without its unit suffix, and the unit, or no unit."""
    for end, unit in _UNITS.items():
        if name.endswith(f"_{end}"):
            return name.removesuffix(f"_{end}"), unit
    return name, ""


def markdown(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return texts as a Markdown table."""
    head, *lines = (f"| {' | '.join(line)} |\n" for line in (columns, *rows))
    return "".join((head, f"|{'---|' * len(columns)}\n", *lines))


def write_rows(path: Path, rows: Iterable[Iterable[object]]) -> None:
    """Write a CSV file, headings first, completely or not at all."""
    text = io.StringIO(newline="")
    csv.writer(text).writerows(rows)
    write_whole(path, text.getvalue().encode())


def canvas(
    width_in: float, height_in: float, *, rows: int = 1, columns: int = 1
) -> tuple[Any, Any]:
    """Return an empty matplotlib figure and its panels, each with a grid.

    Args:
        width_in: width of the figure [in].
        height_in: height of the figure [in].
        rows: rows of panels, which share the x axis.
        columns: columns of panels.

    Returns:
        The figure; and one panel, or an array of panels without axes of length 1.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    panels = figure.subplots(rows, columns, sharex="col")
    for axes in figure.axes:
        axes.grid(alpha=0.3)
    return figure, panels


def write_out(axis: Any, numbers: Sequence[float] = ()) -> None:
    """Label a logarithmic axis with whole numbers instead of powers of ten.

    Args:
        axis: an axis of a drawing, already logarithmic.
        numbers: where to label it; 1, 2 and 5 times powers of ten when empty.
    """
    from matplotlib.ticker import FixedLocator, LogLocator, NullFormatter

    locator = FixedLocator(numbers) if numbers else LogLocator(subs=(1.0, 2.0, 5.0))
    axis.set_major_locator(locator)
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def svg_of(figure: Any, *, legend: bool = True) -> bytes:
    """Return a matplotlib figure as SVG; the same drawing gives the same bytes.

    Args:
        figure: complete except for its legend.
        legend: add one beside the panels; inside them it would cover curves.
    """
    import matplotlib as mpl

    if legend:
        figure.legend(loc="outside right upper", fontsize="small")
    buffer = BytesIO()
    with mpl.rc_context({"svg.hashsalt": "surefoot"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


class CountBar(Protocol):
    """Opens a bar that counts. Entering it gives a function to call after each item."""

    def __call__(
        self, title: str, *, total: int, done: int, of: str = "runs"
    ) -> AbstractContextManager[Callable[[], None]]:
        """Open the bar.

        Args:
            title: name of the work.
            total: number of all items.
            done: number of items done before now.
            of: name of the items.
        """


@contextmanager
def no_bar(
    title: str, *, total: int, done: int, of: str = "runs"
) -> Iterator[Callable[[], None]]:
    """Provide a bar that shows nothing: the default throughout the library."""
    del title, total, done, of
    yield lambda: None
