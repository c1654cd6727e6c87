"""COMTEST's page: every controller's curve before the band of people."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.bench.bench_page import Figure, Section, styles, svg_of, write_page
from surefoot.bench.human_sway import human_sway
from surefoot.bench.subject import Subject
from surefoot.bench.sway_cells import TILTS, Stimulus
from surefoot.bench.sway_results import SwayResult, sway_tables

_LEAST_SHOWN = 1e-4
_INTRO = (
    "The ground steps, swings, or follows a pseudo-random ternary sequence; the answer "
    "is the lean of the centre of mass in space. Gains are in degrees of lean per "
    "degree of tilt: 0 stands upright in space, 1 goes with the ground. A translation "
    "is as large as a tilt when it goes as far as the tilt moves a stiff body's centre "
    "of mass; over the height of the centre of mass it is an angle, too.",
    "Grey: people on a platform that tilts about pitch, eyes closed, 113 trials. "
    "Steady and like a person are opposite ends: people sway more than the ground "
    "tilts. D is the distance from their mean response: half of them are below "
    "{half:.2f}, 95 % below {most:.2f}; to stand upright in space is {upright:.2f}, to "
    "go with the platform {rigid:.2f}. For roll the data of pitch are drawn, for lack "
    "of others.",
)


def write_sway_page(
    folder: Path, results: Sequence[SwayResult], *, robot: str, subject: Subject
) -> None:
    """Write index.html.

    Args:
        folder: that gets it.
        results: of the runs.
        robot: as it was given.
        subject: its measures.
    """
    human = human_sway()
    known = {
        "half": human.score_percentiles[50],
        "most": human.score_percentiles[95],
        "upright": human.score(np.zeros(11, dtype=np.complex128)),
        "rigid": human.score(np.ones(11, dtype=np.complex128)),
    }
    tables = {table.title: table for table in sway_tables(results)}
    drawn = {
        "Ternary sequence": _drawings(results, "prts", draw_responses),
        "Sines": _drawings(results, "sinus", _draw_sines),
        "Steps of one second": _drawings(results, "transient", _draw_steps),
    }
    write_page(
        folder,
        title="COMTEST: standing on moving ground",
        robot=robot,
        subject=subject,
        intro=[line.format(**known) for line in _INTRO],
        sections=[
            Section(title, _TEXTS[title], drawn[title], [table])
            for title, table in tables.items()
        ],
        sources=human.sources,
    )


_TEXTS = {
    "Ternary sequence": (
        "Gain, phase and coherence at the eleven frequencies; bars are 95 % bands. The "
        "first cycle is left out.",
    ),
    "Sines": ("Gain and phase at the frequency of the sine, over four periods.",),
    "Steps of one second": (
        "Sway should come back; settled is what stays within 2 % of the step. The "
        "answer is the body's way against the ground: delay to half of it, rise to "
        "90 %, overshoot beyond it.",
    ),
}


def _drawings(results: Sequence[SwayResult], protocol: str, draw: Any) -> list[Figure]:
    """A drawing for each ground, however many ran on it; sines of one size together."""
    grounds: dict[Stimulus, list[SwayResult]] = {}
    for result in results:
        if result.stimulus.protocol == protocol:
            ground = result.stimulus._replace(frequency_hz=0.0)
            grounds.setdefault(ground, []).append(result)
    figures = []
    for ground, there in grounds.items():
        if any(result.seen for result in there):
            case = ground._replace(protocol="transient").case.removeprefix("transient ")
            speed = "" if ground.speed == 1.0 else f", {ground.speed:g} times as fast"
            title = f"{case}{speed}"
            figures.append(Figure(draw(title, there), f"{protocol}, {title}"))
    return figures


def draw_responses(title: str, results: Sequence[SwayResult]) -> bytes:
    """Draw gain, phase and coherence over frequency.

    Args:
        title: of the drawing.
        results: of ternary sequences on the same ground.

    Returns:
        SVG.
    """
    figure, (gain, phase, coherence) = _panels(title, rows=3, height=7.6)
    stimulus = results[0].stimulus
    human = human_sway()
    frequencies = human.frequencies_hz * stimulus.speed
    if stimulus.axis in TILTS:
        _draw_people(gain, phase, frequencies)
    looks = styles([result.under for result in results])
    for result in results:
        response = result.response
        if response is None:
            continue
        look, label = looks[result.under], result.under.label
        if result.score is not None:
            label += f", D {result.score:.2f}"
        at = response.frequencies_hz
        shown = np.maximum(response.gain, _LEAST_SHOWN)
        band = np.nan_to_num(response.gain_band)
        low = np.minimum(band, shown - _LEAST_SHOWN)
        gain.errorbar(at, shown, [low, band], marker="o", ms=3, label=label, **look)
        bars = np.nan_to_num(response.phase_band_deg)
        phase.errorbar(at, response.phase_deg, bars, marker="o", ms=3, **look)
        coherence.plot(at, response.coherence, marker="o", ms=3, **look)
    gain.set(yscale="log", ylabel="gain [deg/deg]")
    phase.set(ylabel="phase [deg]")
    coherence.set(ylabel="coherence", ylim=(-0.03, 1.03))
    return _finish(figure, coherence)


def _draw_people(gain: Any, phase: Any, frequencies: Any) -> None:
    human = human_sway()
    p = human.gain_percentiles
    bands = ((p[5], p[95], 0.2, "90 % of people"), (p[25], p[75], 0.25, "half of them"))
    for low, high, alpha, label in bands:
        gain.fill_between(
            frequencies, low, high, color="0.5", lw=0, alpha=alpha, label=label
        )
    gain.plot(frequencies, p[50], color="0.35", lw=1.0)
    mean = human.mean[:11] + 1j * human.mean[11:]
    phase.plot(frequencies, np.degrees(np.unwrap(np.angle(mean))), color="0.35", lw=1.0)


def _draw_sines(title: str, results: Sequence[SwayResult]) -> bytes:
    figure, (gain, phase) = _panels(title, rows=2, height=5.2)
    if results[0].stimulus.axis in TILTS:
        _draw_people(gain, phase, human_sway().frequencies_hz)
    looks = styles([result.under for result in results])
    for under, look in looks.items():
        there = [r for r in results if r.under == under and r.seen]
        if there:
            at = [r.stimulus.frequency_hz for r in there]
            gains = [max(r.seen["gain"], _LEAST_SHOWN) for r in there]
            gain.plot(at, gains, marker="o", ms=3, label=under.label, **look)
            phase.plot(at, [r.seen["phase_deg"] for r in there], "o", ms=3, **look)
    gain.set(yscale="log", ylabel="gain [deg/deg]")
    phase.set(ylabel="phase [deg]")
    return _finish(figure, phase)


def _draw_steps(title: str, results: Sequence[SwayResult]) -> bytes:
    figure, (sway,) = _panels(title, rows=1, height=3.0)
    looks = styles([result.under for result in results])
    for result in results:
        if result.seen:
            curve = result.seen["curve"]
            look, label = looks[result.under], result.under.label
            sway.plot(curve["time_s"], curve["sway_deg"], label=label, lw=1.1, **look)
    sway.set(ylabel="sway [deg]", xlabel="time since the step began [s]")
    figure.legend(loc="outside right upper", fontsize="small")
    return svg_of(figure)


def _panels(title: str, *, rows: int, height: float) -> tuple[Any, Any]:
    from matplotlib.figure import Figure as Canvas

    figure = Canvas(figsize=(8.6, height), layout="constrained")
    figure.suptitle(title)
    panels = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    for axes in panels:
        axes.grid(alpha=0.3)
    return figure, panels


def _finish(figure: Any, lowest: Any) -> bytes:
    lowest.set(xscale="log", xlabel="frequency [Hz]")
    figure.legend(loc="outside right upper", fontsize="small")
    return svg_of(figure)
