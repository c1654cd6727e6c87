"""What the runs of COMTEST amount to, and as tables."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from surefoot.bench.bench_cell import Under
from surefoot.bench.frequency_response import FrequencyResponse, frequency_response
from surefoot.bench.human_sway import human_sway
from surefoot.bench.sway_cells import TILTS, Stimulus, SwayCell
from surefoot.bench.text_table import NONE, TextTable, text
from surefoot.schemas.reasons import Outcome
from surefoot.studies.cell import Row

LEAST_PERCENTILE = 5


@dataclass(frozen=True)
class SwayResult:
    """A run and what was seen in it.

    Attributes:
        stimulus: what the ground did.
        under: controller and servo profile.
        height_m: of the centre of mass; a translation over it is an angle [m].
        row: the run's figures.
        response: of a ternary sequence; None for the others, and after a fall.
    """

    stimulus: Stimulus
    under: Under
    height_m: float
    row: Row
    response: FrequencyResponse | None = None

    @property
    def is_up(self) -> bool:
        """Whether the robot stood to the end."""
        return Outcome(self.row["outcome"]).is_up

    @property
    def seen(self) -> dict[str, Any]:
        """Figures of the protocol; empty after a fall."""
        found: dict[str, Any] = self.row["seen"]
        return found

    @property
    def score(self) -> float | None:
        """D against people; only of tilts at the speed people were measured at."""
        stimulus = self.stimulus
        if self.response is None or stimulus.axis not in TILTS or stimulus.speed != 1.0:
            return None
        return human_sway().score(self.response.response)

    @property
    def below_human(self) -> int | None:
        """At how many of the eleven frequencies the gain is under people's 5 %.

        At another speed it is compared at the same points of the sequence. None for
        translations, of which there are no data.
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
        spectra = [_complex(seen[name]) for name in ("stimulus", "response")]
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


_WHO = ("ground", "controller", "servo", "outcome")


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
        text(result.score, ".2f"),
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
        text(seen["settling_s"], ".2f"),
        text(seen["delay_s"], ".2f"),
        text(seen["rise_s"], ".2f"),
        text(seen["overshoot"] and 100.0 * seen["overshoot"], ".1f"),
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


def _complex(parts: list[Any]) -> Any:
    real, imaginary = (np.array(part) for part in parts)
    return real + 1j * imaginary
