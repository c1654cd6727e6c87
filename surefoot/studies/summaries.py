"""Summaries of a study's runs: figures by group, as tables and as success curves."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from surefoot.installation import lacking
from surefoot.out_folder import write_json, write_whole
from surefoot.presentation import canvas, markdown, split_unit, svg_of, write_rows
from surefoot.schemas.reasons import NONE, given
from surefoot.studies.cell import Group, Row, group_of, in_words, is_up

_LOG = logging.getLogger("surefoot")

CONFIDENCE = 0.95
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


def success_interval(successes: int, runs: int) -> tuple[float, float]:
    """Return Wilson's 95 % confidence interval of a success rate.

    Args:
        successes: at most ``runs``.
        runs: number of runs; the interval of 0 runs is (0, 1).

    Returns:
        Lower and upper end, within [0, 1].
    """
    from scipy.stats import binomtest

    if runs == 0:
        return 0.0, 1.0
    interval = binomtest(successes, runs).proportion_ci(CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)


@dataclass(frozen=True)
class GroupSummary:
    """Figures of a group; means and worst cases are over the runs that stayed up.

    Attributes:
        runs: number of runs.
        up: number of runs that stayed up.
        up_from: lower end of the 95 % interval of the success rate, in which runs that
            are equal to the last bit count once.
        up_to: its upper end.
        com_rms_mm: rms CoM error, mean over seeds, x y z.
        com_rms_worst_mm: rms CoM error of the worst seed.
        com_max_mm: largest CoM error of the worst seed, x y z.
        tilt_max_deg: largest tilt of the worst seed.
        force_deviation_n: rms force deviation of both feet, mean over seeds.
        force_peak_n: largest force of the worst seed, either foot.
        contact_gap_s: longest contact gap of the worst seed, either foot.
    """

    runs: int
    up: int
    up_from: float
    up_to: float
    com_rms_mm: list[float] | None = None
    com_rms_worst_mm: list[float] | None = None
    com_max_mm: list[float] | None = None
    tilt_max_deg: float | None = None
    force_deviation_n: float | None = None
    force_peak_n: float | None = None
    contact_gap_s: float | None = None

    @property
    def horizontal_mm(self) -> float | None:
        """Horizontal CoM error: rms of x and y together."""
        return None if self.com_rms_mm is None else math.hypot(*self.com_rms_mm[:2])

    def as_dict(self) -> dict[str, Any]:
        """Return the figures as built-in types, for JSON."""
        return asdict(self)


Summaries = dict[Group, GroupSummary]


def summarise(rows: Iterable[Row]) -> Summaries:
    """Return summaries by group, in the order of the groups' first rows."""
    groups: dict[Group, list[Row]] = {}
    for row in rows:
        groups.setdefault(group_of(row), []).append(row)
    return {group: _summary(rows) for group, rows in groups.items()}


def _summary(rows: list[Row]) -> GroupSummary:
    standing = [row for row in rows if is_up(row)]
    # Without noise each seed gives the same run: one sample, however often it is made.
    samples = {row["log_sha256"]: is_up(row) for row in rows}
    low, high = success_interval(sum(samples.values()), len(samples))
    if not standing:
        return GroupSummary(runs=len(rows), up=0, up_from=low, up_to=high)
    deviations = [
        math.sqrt(_mean([v * v for v in pair]))
        for row in standing
        if (pair := row["force_deviation_rms_n"]) is not None
    ]
    return GroupSummary(
        runs=len(rows),
        up=len(standing),
        up_from=low,
        up_to=high,
        com_rms_mm=_over(standing, "com_error_rms_mm", _mean),
        com_rms_worst_mm=_over(standing, "com_error_rms_mm", max),
        com_max_mm=_over(standing, "com_error_max_mm", max),
        tilt_max_deg=max(row["base_tilt_max_deg"] for row in standing),
        force_deviation_n=_mean(deviations) if deviations else None,
        force_peak_n=_largest(standing, "force_peak_n"),
        contact_gap_s=max(max(row["contact_gap_s"]) for row in standing),
    )


def _largest(rows: list[Row], name: str) -> float | None:
    """Largest value of both feet over the runs that have one."""
    values = [max(row[name]) for row in rows if row[name] is not None]
    return max(values, default=None)


def _over(rows: list[Row], name: str, what: Any) -> list[float] | None:
    """Combine axis by axis over the runs that have values."""
    values = [row[name] for row in rows if row[name] is not None]
    if not values:
        return None
    return [float(what(column)) for column in zip(*values, strict=True)]


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


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
    named = [split_unit(part) for part in path.split(".")]
    *places, name = (bare for bare, _ in named)
    units = [unit for _, unit in named if unit not in ("", "1")]
    if units:
        name = f"{name} [{units[-1].replace('^2', '²')}]"
    where = " ".join("all" if place == "*" else place for place in places)
    return f"{where}: {name}".removeprefix(": ").replace("_", " ")


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def curves_over(summaries: Summaries, *, scenario: str, name: str) -> list[Curve]:
    """Return a scenario's curves over one varied value; all else is equal."""
    found: dict[str, list[tuple[float, float, float, float]]] = {}
    variants = short_names(group.variant for group in summaries)
    for group, summary in summaries.items():
        values = dict(group.values)
        if group.scenario != scenario or not _is_number(values.get(name)):
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
    axes.set(
        xlabel=xlabel,
        ylabel="stayed up, with 95 % band",
        title=title,
        ylim=(-0.03, 1.03),
    )
    return svg_of(figure)


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


def write_csv(path: Path, summaries: Summaries) -> None:
    """Write one row per group and one number per column."""
    rows = [_flat(*each) for each in summaries.items()]
    write_rows(path, (*rows[:1], *(row.values() for row in rows)))


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
        if _is_number(value)
    }
    if varied and (words := lacking("drawing", "matplotlib", extra="report")):
        _LOG.warning("no success curves: %s", words)
        return
    titles = short_names(scenario for scenario, _ in varied)
    for scenario, name in sorted(varied):
        curves = curves_over(summaries, scenario=scenario, name=name)
        title = titles[scenario]
        svg = draw_curves(curves, xlabel=value_in_words(name), title=title, mark=None)
        stem = title.removesuffix(".toml").strip("/").replace("/", "-")
        write_whole(folder / f"success-{stem}-{name.replace('*', 'all')}.svg", svg)
