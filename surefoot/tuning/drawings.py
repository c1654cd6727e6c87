"""Drawings of a search's outcome."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import TYPE_CHECKING, Any

from surefoot.tuning.outcome import Candidate, Tuned

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GREY, BLUE, ORANGE = "#9aa6b5", "#2a6fbb", "#d9730d"


def draw_front(tuned: Tuned) -> bytes:
    """Draw two objectives against each other, or one over the trials."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 4.2), layout="constrained")
    axes = figure.add_subplot()
    objectives = tuned.spec.figures
    stood = [c for c in tuned.candidates if not c.stopped]
    if len(objectives) == 1:
        axes.set(xlabel="trial", ylabel=_label(objectives[0]))
        _points(axes, [[c.place for c in stood], [c.figures[0] for c in stood]], GREY)
    else:
        axes.set(xlabel=_label(objectives[0]), ylabel=_label(objectives[1]))
        _points(axes, _two(stood), GREY, "trials that stood")
        lined = len(objectives) == 2
        _points(axes, _two(tuned.front), BLUE, "on the front", line=lined)
    for candidate, name, colour in (
        (tuned.start, "start", "black"),
        (tuned.chosen, "chosen", ORANGE),
    ):
        x, y = (
            (candidate.place, candidate.figures[0])
            if len(objectives) == 1
            else candidate.figures[:2]
        )
        axes.plot(x, y, "o", color=colour, markersize=10, fillstyle="none", label=name)
    axes.grid(alpha=0.3)
    figure.legend(loc="outside right upper", fontsize="small")
    return _svg(figure)


def _label(objective: Any) -> str:
    return f"{objective.about} [{objective.unit or 1}]"


def _two(candidates: Sequence[Candidate]) -> list[list[float]]:
    return [[c.figures[i] for c in candidates] for i in (0, 1)]


def _points(
    axes: Axes,
    xy: Sequence[Sequence[float]],
    colour: str,
    label: str | None = None,
    *,
    line: bool = False,
) -> None:
    style = "-" if line else ""
    axes.plot(*xy, linestyle=style, marker="o", markersize=4, color=colour, label=label)


def draw_importance(weights: dict[str, dict[str, float]]) -> bytes:
    """Draw the weight of each parameter for each objective."""
    from matplotlib.figure import Figure

    names = sorted({name for of in weights.values() for name in of}, reverse=True)
    figure = Figure(figsize=(7.2, 1.4 + 0.3 * len(names)), layout="constrained")
    axes = figure.add_subplot()
    height = 0.8 / len(weights)
    for index, (objective, of) in enumerate(weights.items()):
        places = [place - 0.4 + height * (index + 0.5) for place in range(len(names))]
        axes.barh(places, [of.get(n, 0.0) for n in names], height, label=objective)
    axes.set_yticks(range(len(names)), names)
    axes.set(xlabel="share in deciding whether a trial is among the best tenth")
    axes.grid(alpha=0.3, axis="x")
    figure.legend(loc="outside right upper", fontsize="small")
    return _svg(figure)


def _svg(figure: Figure) -> bytes:
    buffer = BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()
