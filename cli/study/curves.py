"""Success against what was varied, with confidence intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO

from cli.study.statistics import success_limit
from cli.study.tables import Summaries


@dataclass(frozen=True)
class Curve:
    """Success of one controller over one value.

    Attributes:
        label: controller and servo profile.
        levels: the value, rising.
        rates: success rate at each.
        low: lower end of its interval.
        high: upper end.
    """

    label: str
    levels: Sequence[float]
    rates: Sequence[float]
    low: Sequence[float]
    high: Sequence[float]

    @property
    def limit(self) -> float | None:
        """Where half the runs fall; None when beyond what was tried."""
        return success_limit(self.levels, self.rates)


def curves_over(summaries: Summaries, *, scenario: str, name: str) -> list[Curve]:
    """Curves of a scenario over one varied value, all else equal."""
    found: dict[str, list[tuple[float, float, float, float]]] = {}
    for group, summary in summaries.items():
        values = dict(group.values)
        if group.scenario != scenario or name not in values:
            continue
        others = [f"{k} {v:g}" for k, v in values.items() if k != name]
        label = ", ".join([group.variant, group.servo_profile, *others])
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
    """Draws success curves.

    Args:
        curves: one line each.
        xlabel: of what was varied.
        title: of the plot.
        mark: a level to point out, and its name.

    Returns:
        SVG.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 3.4), layout="constrained")
    axes = figure.add_subplot()
    for index, curve in enumerate(curves):
        # Curves on top of each other stay visible: later ones are drawn smaller.
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
    axes.grid(alpha=0.3)
    # Beside the plot: inside it would cover curves that lie at 0 or 1.
    figure.legend(loc="outside right upper", fontsize="small")
    buffer = BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()
