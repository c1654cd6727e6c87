"""Results of COMTEST from its runs, and their page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.bench.bench_files import (
    Figure,
    Section,
    TextTable,
    styles,
    write_page,
)
from surefoot.bench.bench_runs import Subject, Under
from surefoot.bench.sway_cells import TILTS, Stimulus, SwayCell
from surefoot.bench.sway_response import (
    FrequencyResponse,
    frequency_response,
    human_sway,
)
from surefoot.presentation import canvas, svg_of
from surefoot.schemas.arrays import Array
from surefoot.schemas.reasons import NONE, given
from surefoot.studies.cell import Row, is_up

LEAST_PERCENTILE = 5
_WHO = ("ground", "controller", "servo", "outcome")
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
_TEXTS = {
    "Ternary sequence": (
        "Gain, phase and coherence at the eleven frequencies; bars are 95 % bands. The "
        "first cycle is left out.",
    ),
    "Sines": (
        "Gain and phase at the frequency of the sine, over four periods. Phases are "
        "drawn beside people's: they may be whole turns from those in the table.",
    ),
    "Steps of one second": (
        "Sway should come back; settled is what stays within 2 % of the step. The "
        "answer is the body's way against the ground: delay to half of it, rise to "
        "90 %, overshoot beyond it.",
    ),
}


@dataclass(frozen=True)
class SwayResult:
    """A run and its results.

    Attributes:
        stimulus: motion of the ground.
        under: controller and servo profile.
        height_m: height of the centre of mass; a translation over it is an angle [m].
        row: figures of the run.
        response: to a ternary sequence; None for other protocols, and after a fall.
    """

    stimulus: Stimulus
    under: Under
    height_m: float
    row: Row
    response: FrequencyResponse | None = None

    @property
    def is_up(self) -> bool:
        """Whether the robot stood to the end."""
        return is_up(self.row)

    @property
    def seen(self) -> dict[str, Any]:
        """Figures of the protocol; empty after a fall."""
        found: dict[str, Any] = self.row["seen"]
        return found

    @property
    def score(self) -> float | None:
        """Distance D from people; only of tilts at the speed of people's data."""
        stimulus = self.stimulus
        if self.response is None or stimulus.axis not in TILTS or stimulus.speed != 1.0:
            return None
        return human_sway().score(self.response.response)

    @property
    def below_human(self) -> int | None:
        """Number of the eleven frequencies at which the gain is below people's 5 %.

        At another speed the same harmonics of the sequence are compared. None for
        translations: there are no data of people.
        """
        if self.response is None or self.stimulus.axis not in TILTS:
            return None
        least = human_sway().gain_percentiles[LEAST_PERCENTILE]
        return int(np.count_nonzero(self.response.gain < least))

    def as_dict(self) -> dict[str, Any]:
        """Return it as built-in types, for JSON."""
        stimulus = self.stimulus
        found: dict[str, Any] = {
            "protocol": stimulus.protocol,
            "axis": stimulus.axis,
            "size_deg": stimulus.size_deg,
            "size_m": None
            if stimulus.axis in TILTS
            else self.height_m * float(np.radians(stimulus.size_deg)),
            "controller": self.under.variant,
            "servo_profile": self.under.servo_profile,
            "outcome": self.row["outcome"],
            "fell_at_s": self.row["fell_at_s"],
        }
        kept = {k: v for k, v in self.seen.items() if k not in ("stimulus", "response")}
        if stimulus.protocol == "sinus":
            found["frequency_hz"] = stimulus.frequency_hz
        if stimulus.protocol == "prts":
            found["speed"] = stimulus.speed
            found["frequency_response"] = self.response and self.response.as_dict()
            found["score"] = self.score
            found["below_human_5_percent"] = self.below_human
        return {**found, **kept}


def sway_result(cell: SwayCell, row: Row) -> SwayResult:
    """Join a run's cell and its row."""
    seen = row["seen"]
    response = None
    if cell.stimulus.protocol == "prts" and seen:
        parts = [np.array(seen[name]) for name in ("stimulus", "response")]
        spectra = [real + 1j * imaginary for real, imaginary in parts]
        response = frequency_response(*spectra, cycle_s=cell.stimulus.cycle_s)
    return SwayResult(cell.stimulus, cell.under, cell.height_m, row, response)


def sway_tables(results: Iterable[SwayResult]) -> list[TextTable]:
    """Return a table for each protocol that was run."""
    found = list(results)
    tables = []
    for protocol, make in _TABLES.items():
        chosen = [r for r in found if r.stimulus.protocol == protocol]
        if chosen:
            title, columns, cells = make
            rows = [(*_who(r), *cells(r)) for r in chosen]
            tables.append(TextTable(title, (*_WHO, *columns), rows))
    return tables


def _who(result: SwayResult) -> tuple[str, ...]:
    stimulus = result.stimulus
    size = f"{stimulus.size_deg:g} deg"
    if stimulus.axis not in TILTS:
        size = f"{1e3 * result.height_m * np.radians(stimulus.size_deg):.0f} mm"
    words = f"{stimulus.axis} {size}"
    if stimulus.protocol == "sinus":
        words += f", {stimulus.frequency_hz:g} Hz"
    if stimulus.speed != 1.0:
        words += f", {stimulus.speed:g} times as fast"
    return (
        words,
        result.under.variant,
        result.under.servo_profile,
        result.row["outcome"],
    )


def _prts_cells(result: SwayResult) -> tuple[str, ...]:
    response = result.response
    if response is None:
        return (NONE,) * 5
    gain, at = response.gain, int(np.argmax(response.gain))
    below = result.below_human
    return (
        f"{gain.min():.3f} to {gain.max():.3f}",
        f"{response.frequencies_hz[at]:g}",
        f"{response.coherence.min():.2f}",
        NONE if below is None else f"{below} of {len(gain)}",
        given(result.score, ".2f"),
    )


def _sinus_cells(result: SwayResult) -> tuple[str, ...]:
    seen = result.seen
    if not seen:
        return (NONE,) * 3
    return (
        f"{seen['gain']:.3f}",
        f"{seen['phase_deg']:.0f}",
        f"{seen['power_ratio']:.2f}",
    )


def _transient_cells(result: SwayResult) -> tuple[str, ...]:
    seen = result.seen
    if not seen:
        return (NONE,) * 6
    return (
        f"{seen['sway_peak']:.3f}",
        f"{seen['sway_peak_s']:.2f}",
        given(seen["settling_s"], ".2f"),
        given(seen["delay_s"], ".2f"),
        given(seen["rise_s"], ".2f"),
        given(seen["overshoot"] and 100.0 * seen["overshoot"], ".1f"),
    )


_TABLES = {
    "prts": (
        "Ternary sequence",
        (
            *("gain [deg/deg]", "largest at [Hz]", "least coherence"),
            *("under the human 5 %", "D"),
        ),
        _prts_cells,
    ),
    "sinus": ("Sines", ("gain [deg/deg]", "phase [deg]", "power ratio"), _sinus_cells),
    "transient": (
        "Steps of one second",
        (
            *("sway peak [deg/deg]", "at [s]", "settled [s]"),
            *("delay [s]", "rise [s]", "overshoot [%]"),
        ),
        _transient_cells,
    ),
}


def write_sway_page(
    folder: Path, results: Sequence[SwayResult], *, robot: str, subject: Subject
) -> None:
    """Write index.html."""
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


def _drawings(results: Sequence[SwayResult], protocol: str, draw: Any) -> list[Figure]:
    """One drawing per motion of the ground; all sines of one size share one."""
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
    figure, (gain, phase, coherence) = canvas(8.6, 7.6, rows=3)
    figure.suptitle(title)
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
    coherence.set(xscale="log", xlabel="frequency [Hz]")
    return svg_of(figure)


def _draw_people(gain: Any, phase: Any, frequencies: Any) -> None:
    human = human_sway()
    p = human.gain_percentiles
    bands = ((p[5], p[95], 0.2, "90 % of people"), (p[25], p[75], 0.25, "half of them"))
    for low, high, alpha, label in bands:
        gain.fill_between(
            frequencies, low, high, color="0.5", lw=0, alpha=alpha, label=label
        )
    gain.plot(frequencies, p[50], color="0.35", lw=1.0, label="median; phase: mean")
    phase.plot(frequencies, human.phase_deg, color="0.35", lw=1.0)


def beside_people(frequencies_hz: Sequence[float], phases_deg: Sequence[float]) -> Any:
    """Return phases without jumps, shifted by whole turns towards people's [deg].

    Args:
        frequencies_hz: (n,) rising [Hz].
        phases_deg: (n,) from -180 to 180 [deg].
    """
    human = human_sway()
    theirs = np.interp(frequencies_hz, human.frequencies_hz, human.phase_deg)
    ours = np.unwrap(phases_deg, period=360.0)
    return ours + 360.0 * round(float(np.mean(theirs - ours)) / 360.0)


def _draw_sines(title: str, results: Sequence[SwayResult]) -> bytes:
    figure, (gain, phase) = canvas(8.6, 5.2, rows=2)
    figure.suptitle(title)
    if results[0].stimulus.axis in TILTS:
        _draw_people(gain, phase, human_sway().frequencies_hz)
    looks = styles([result.under for result in results])
    for under, look in looks.items():
        there = [r for r in results if r.under == under and r.seen]
        there.sort(key=lambda r: r.stimulus.frequency_hz)
        if there:
            at = [r.stimulus.frequency_hz for r in there]
            gains = [max(r.seen["gain"], _LEAST_SHOWN) for r in there]
            phases = beside_people(at, [r.seen["phase_deg"] for r in there])
            gain.plot(at, gains, marker="o", ms=3, label=under.label, **look)
            phase.plot(at, phases, marker="o", ms=3, **look)
    gain.set(yscale="log", ylabel="gain [deg/deg]")
    phase.set(ylabel="phase [deg]", xscale="log", xlabel="frequency [Hz]")
    return svg_of(figure)


def sway_since(result: SwayResult) -> tuple[Array, Array]:
    """Return times [s] and sway [deg] from the beginning of a step on.

    Like the figures they count from there: the robot leans and settles before it.
    """
    curve = result.seen["curve"]
    time_s, sway_deg = np.array(curve["time_s"]), np.array(curve["sway_deg"])
    begun = time_s >= 0.0
    return time_s[begun], sway_deg[begun] - np.interp(0.0, time_s, sway_deg)


def _draw_steps(title: str, results: Sequence[SwayResult]) -> bytes:
    figure, sway = canvas(8.6, 3.0)
    figure.suptitle(title)
    looks = styles([result.under for result in results])
    for result in results:
        if result.seen:
            look, label = looks[result.under], result.under.label
            sway.plot(*sway_since(result), label=label, lw=1.1, **look)
    sway.set(ylabel="sway since then [deg]", xlabel="time since the step began [s]")
    return svg_of(figure)
