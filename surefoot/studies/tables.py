"""Tables of a study: for the terminal, as CSV, as Markdown."""

from __future__ import annotations

import csv
import io
import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from surefoot.out_folder import write_json, write_whole
from surefoot.schemas.reasons import NONE, given
from surefoot.studies.cell import Group, in_words

if TYPE_CHECKING:
    from surefoot.studies.study import GroupSummary, Summaries

_LOG = logging.getLogger("surefoot")

COLUMNS = (
    "case",
    "controller",
    "servo",
    "up",
    "up, 95 %",
    "CoM rms x, y, z [mm]",
    "force deviation [N]",
    "force peak [N]",
    "longest without ground [s]",
)


def success_limit(levels: Sequence[float], rates: Sequence[float]) -> float | None:
    """Find the level at which the success rate first falls below one half.

    It is interpolated linearly.

    Args:
        levels: varied value, rising.
        rates: success rate at each level.

    Returns:
        None if the rate never falls below: the limit is beyond the levels tried.
        The first level if the rate is below one half there.
    """
    for i, (level, rate) in enumerate(zip(levels, rates, strict=True)):
        if rate >= 0.5:
            continue
        if i == 0:
            return level
        before, good = levels[i - 1], rates[i - 1]
        return before + (level - before) * (good - 0.5) / (good - rate)
    return None


@dataclass(frozen=True)
class Curve:
    """Success of one controller over one value.

    Attributes:
        label: controller and servo profile.
        levels: the value, rising.
        rates: success rate at each level.
        low: lower end of the rate's interval.
        high: upper end of the rate's interval.
    """

    label: str
    levels: Sequence[float]
    rates: Sequence[float]
    low: Sequence[float]
    high: Sequence[float]

    @property
    def limit(self) -> float | None:
        """Level at which half the runs fall; None if it is beyond the levels tried."""
        return success_limit(self.levels, self.rates)


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


def short_name(name: str) -> str:
    """Return a scenario's or controller's name for plots, without its folder."""
    path, colon, law = name.partition(":")
    return law if colon else Path(path).name.removesuffix(".toml")


def short_names(names: Iterable[str]) -> dict[str, str]:
    """Return names for plots; those that only their folders tell apart keep these."""
    short = {name: short_name(name) for name in names}
    taken = list(short.values())
    return {n: s if taken.count(s) == 1 else n for n, s in short.items()}


def value_in_words(path: str) -> str:
    """Return the value at a scenario's path in words, with its unit.

    Args:
        path: such as ``platform.0.motion.1.amplitude_deg``.
    """
    *places, name = path.split(".")
    bare, unit = split_unit(name)
    if unit not in ("", "1"):
        name = f"{bare} [{unit.replace('^2', '²')}]"
    where = " ".join("all" if place == "*" else place for place in places)
    return f"{where}: {name}".removeprefix(": ").replace("_", " ")


def curves_over(summaries: Summaries, *, scenario: str, name: str) -> list[Curve]:
    """Return a scenario's curves over one varied value; all else is equal."""
    found: dict[str, list[tuple[float, float, float, float]]] = {}
    variants = short_names(group.variant for group in summaries)
    for group, summary in summaries.items():
        values = dict(group.values)
        if group.scenario != scenario or name not in values:
            continue
        others = [f"{k} {in_words(v)}" for k, v in values.items() if k != name]
        label = ", ".join([variants[group.variant], group.servo_profile, *others])
        rate = summary.up / summary.runs
        point = (float(values[name]), rate, summary.up_from, summary.up_to)
        found.setdefault(label, []).append(point)
    return [
        Curve(label, *zip(*sorted(points), strict=True))
        for label, points in found.items()
    ]


def draw_curves(
    curves: list[Curve], *, xlabel: str, title: str, mark: tuple[float, str] | None
) -> bytes:
    """Draw success curves.

    Args:
        curves: one line each.
        xlabel: name of the varied value.
        title: of the plot.
        mark: a level to mark, and its name.

    Returns:
        SVG.
    """
    figure, axes = canvas(7.2, 3.4)
    for index, curve in enumerate(curves):
        # Later curves have smaller markers: curves on top of each other stay visible.
        size = 10.0 - 8.0 * index / len(curves)
        (line,) = axes.plot(
            curve.levels, curve.rates, marker="o", markersize=size, label=curve.label
        )
        axes.fill_between(
            curve.levels, curve.low, curve.high, color=line.get_color(), alpha=0.15
        )
    if mark is not None:
        axes.axvline(mark[0], color="gray", linestyle="--", linewidth=1.0)
        axes.annotate(
            mark[1], (mark[0], 0.03), xytext=(4, 0), textcoords="offset points"
        )
    axes.set(xlabel=xlabel, ylabel="stayed up", title=title, ylim=(-0.03, 1.03))
    return svg_of(figure)


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


def cells_of(group: Group, summary: GroupSummary) -> list[str]:
    """Return the cells of a group's row, as text."""
    com = summary.com_rms_mm
    return [
        group.case,
        group.variant,
        group.servo_profile,
        f"{summary.up} of {summary.runs}",
        f"{summary.up_from:.2f} to {summary.up_to:.2f}",
        NONE if com is None else ", ".join(f"{value:.1f}" for value in com),
        given(summary.force_deviation_n, ".0f"),
        given(summary.force_peak_n, ".0f"),
        given(summary.contact_gap_s, ".3f"),
    ]


def markdown_table(summaries: Summaries) -> str:
    """Return the summaries as a Markdown table."""
    return markdown(COLUMNS, [cells_of(*each) for each in summaries.items()])


def markdown(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return texts as a Markdown table."""
    head, *lines = (f"| {' | '.join(line)} |\n" for line in (columns, *rows))
    return "".join((head, f"|{'---|' * len(columns)}\n", *lines))


def write_csv(path: Path, summaries: Summaries) -> None:
    """Write one row per group and one number per column."""
    rows = [_flat(*each) for each in summaries.items()]
    write_rows(path, (*rows[:1], *(row.values() for row in rows)))


def write_rows(path: Path, rows: Iterable[Iterable[object]]) -> None:
    """Write a CSV file, headings first, completely or not at all."""
    text = io.StringIO(newline="")
    csv.writer(text).writerows(rows)
    write_whole(path, text.getvalue().encode())


def _flat(group: Group, summary: GroupSummary) -> dict[str, object]:
    nothing: list[float | None] = [None] * 3
    com = summary.com_rms_mm or nothing
    largest = summary.com_max_mm or nothing
    return {
        "scenario": group.scenario,
        "values": "; ".join(f"{name}={value}" for name, value in group.values),
        "controller": group.variant,
        "servo_profile": group.servo_profile,
        "runs": summary.runs,
        "up": summary.up,
        "up_from": summary.up_from,
        "up_to": summary.up_to,
        **{f"com_rms_{a}_mm": v for a, v in zip("xyz", com, strict=True)},
        **{f"com_max_{a}_mm": v for a, v in zip("xyz", largest, strict=True)},
        "tilt_max_deg": summary.tilt_max_deg,
        "force_deviation_n": summary.force_deviation_n,
        "force_peak_n": summary.force_peak_n,
        "contact_gap_s": summary.contact_gap_s,
    }


def summary_rows(summaries: Summaries) -> list[dict[str, object]]:
    """Return the content of summary.json: one row per group."""
    return [
        {
            "scenario": group.scenario,
            "values": dict(group.values),
            "controller": group.variant,
            "servo_profile": group.servo_profile,
            **summary.as_dict(),
        }
        for group, summary in summaries.items()
    ]


def write_summary(folder: Path, summaries: Summaries) -> None:
    """Write summary.csv, summary.json and a success curve per varied value.

    Curves need matplotlib, which comes with the extra ``report``. Without it they are
    left out, and a log message tells so.
    """
    write_csv(folder / "summary.csv", summaries)
    write_json(folder / "summary.json", summary_rows(summaries))
    varied = {
        (group.scenario, name)
        for group in summaries
        for name, value in group.values
        if isinstance(value, (int, float)) and not isinstance(value, bool)
    }
    if varied and find_spec("matplotlib") is None:
        _LOG.warning("no success curves: matplotlib is missing; the extra `report`")
        return
    titles = short_names(scenario for scenario, _ in varied)
    for scenario, name in sorted(varied):
        curves = curves_over(summaries, scenario=scenario, name=name)
        title = titles[scenario]
        svg = draw_curves(curves, xlabel=value_in_words(name), title=title, mark=None)
        stem = title.removesuffix(".toml").strip("/").replace("/", "-")
        write_whole(folder / f"success-{stem}-{name.replace('*', 'all')}.svg", svg)
