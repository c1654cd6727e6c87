"""DYSTURBANCE's page: margins over frequency, energy and impedance."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from surefoot.bench.bench_page import Figure, Section, styles, svg_of, write_page
from surefoot.bench.push_cells import SINES
from surefoot.bench.push_results import PushResult, push_tables
from surefoot.bench.subject import Subject

_INTRO = (
    "A rod strikes the robot, swings it, or slowly leads it off; by a given way or by "
    "a given force. The margin is the largest push that was stood, found by halving to "
    "within 2 %: of a strike its peak force, of a sine from its lowest to its highest, "
    "of a slow push what it goes to within three seconds and holds for four.",
    "As for a person: divided by the robot's measures over those of a person of 81 kg "
    "(weight times base over height for forces, the energy to tip for energies, height "
    "of the centre of mass for ways), so that robots of any size compare.",
)
_TEXTS = {
    "Stability margins": (
        "Energy taken up: of a strike and of a slow push in all, of a sine in a "
        "period, in the largest push that was stood; negative where the robot gave "
        "energy back.",
    ),
    "Equivalent impedance": (
        "Mass, damper and spring that would answer the sines alike, at the largest "
        "that were stood, by least squares over all frequencies.",
    ),
}
_SOURCES = (
    "Monteleone et al.: A method to benchmark the balance resilience of robots, "
    "Frontiers in Robotics and AI 2022, 10.3389/frobt.2022.817870 (pushes, indicators, "
    "normalisation)",
)


def write_push_page(
    folder: Path, results: Sequence[PushResult], *, robot: str, subject: Subject
) -> None:
    """Write index.html.

    Args:
        folder: that gets it.
        results: of all pushes.
        robot: as it was given.
        subject: its measures.
    """
    drawn = {"Stability margins": _drawings(results)}
    write_page(
        folder,
        title="DYSTURBANCE: pushes that a robot stands",
        robot=robot,
        subject=subject,
        intro=_INTRO,
        sections=[
            Section(t.title, _TEXTS[t.title], drawn.get(t.title, ()), [t])
            for t in push_tables(results)
        ],
        sources=_SOURCES,
    )


def _drawings(results: Sequence[PushResult]) -> list[Figure]:
    """A drawing for each direction with more than one frequency."""
    directions = dict.fromkeys(r.disturbance.direction_deg for r in results)
    figures = []
    for direction in directions:
        there = [
            result
            for result in results
            if result.disturbance.direction_deg == direction
            and result.disturbance.kind in SINES
        ]
        if len({result.disturbance.frequency_hz for result in there}) > 1:
            title = f"margins of sines, {direction:g} deg"
            figures.append(Figure(draw_margins(title, there), title))
    return figures


def draw_margins(title: str, results: Sequence[PushResult]) -> bytes:
    """Draw margins over frequency: of forces, and of ways.

    Args:
        title: of the drawing.
        results: of sines in one direction.

    Returns:
        SVG.
    """
    from matplotlib.figure import Figure as Canvas

    figure = Canvas(figsize=(9.6, 3.6), layout="constrained")
    figure.suptitle(title)
    panels: Any = figure.subplots(1, 2)
    looks = styles([result.under for result in results])
    for axes, kind in zip(panels, SINES, strict=True):
        for under, look in looks.items():
            there = [
                r for r in results if r.under == under and r.disturbance.kind == kind
            ]
            scale = 1e3 if kind == "sine-displacement" else 1.0
            axes.plot(
                [r.disturbance.frequency_hz for r in there],
                [scale * r.margin for r in there],
                marker="o",
                ms=3,
                label=under.label if kind == SINES[0] else None,
                **look,
            )
        unit = "way [mm]" if kind == "sine-displacement" else "force [N]"
        axes.set(xscale="log", yscale="log", xlabel="frequency [Hz]")
        axes.set(ylabel=f"{unit}, lowest to highest")
        axes.grid(alpha=0.3, which="both")
    figure.legend(loc="outside right upper", fontsize="small")
    return svg_of(figure)
