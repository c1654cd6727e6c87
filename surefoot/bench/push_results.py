"""What the runs of DYSTURBANCE amount to, and as tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from surefoot.bench.bench_cell import Under
from surefoot.bench.impedance import Impedance, fit_impedance
from surefoot.bench.margin_search import MarginSearch
from surefoot.bench.push_cells import (
    SINES,
    STRIKER_SHARE,
    UNITS,
    Disturbance,
    PushKind,
)
from surefoot.bench.subject import Subject, proportion
from surefoot.bench.text_table import TextTable, text
from surefoot.studies.cell import Row


@dataclass(frozen=True)
class PushResult:
    """The largest push of a kind that was stood, and what was seen in that run.

    Attributes:
        disturbance: what was done.
        under: controller and servo profile.
        subject: measures of the robot.
        stood: largest size that was stood; 0 when none was.
        fell: smallest that was not; None when all that were tried were stood.
        runs: how many were tried.
        row: of the run at ``stood``; None when there is none.
    """

    disturbance: Disturbance
    under: Under
    subject: Subject
    stood: float
    fell: float | None
    runs: int
    row: Row | None

    @property
    def seen(self) -> dict[str, Any]:
        """What the probe saw in the largest push that was stood."""
        found: dict[str, Any] = {} if self.row is None else self.row["seen"]
        return found

    @property
    def margin(self) -> float:
        """Stability margin in the unit of :attr:`unit`.

        As the benchmark has it: of a strike the peak force, of a sine from its lowest
        to its highest, of a slow push what it went to.
        """
        if self.disturbance.kind == "impulse":
            return float(self.seen.get("peak_n", 0.0))
        return 2.0 * self.stood if self.disturbance.kind in SINES else self.stood

    @property
    def unit(self) -> str:
        """N or m."""
        kind = self.disturbance.kind
        return "N" if kind == "impulse" else UNITS[kind]

    @property
    def normalised(self) -> float:
        """The margin as it would be for a person, see :func:`proportion`."""
        of = proportion(self.subject, direction_deg=self.disturbance.direction_deg)
        return self.margin / (of.way if self.unit == "m" else of.force)

    @property
    def energy_j(self) -> float | None:
        """That the robot took up: of a strike in all, of a sine in a period [J]."""
        name = "work_per_period_j" if self.disturbance.kind in SINES else "work_j"
        energy: float | None = self.seen.get(name)
        return energy

    @property
    def normalised_energy_j(self) -> float | None:
        """The same as it would be for a person [J]."""
        of = proportion(self.subject, direction_deg=self.disturbance.direction_deg)
        return None if self.energy_j is None else self.energy_j / of.energy

    @property
    def absorbed(self) -> float | None:
        """Share of the striker's energy that it did not get back [1]."""
        if self.disturbance.kind != "impulse" or not self.seen:
            return None
        striker_kg = STRIKER_SHARE * self.subject.mass_kg
        return float(self.seen["work_j"]) / (0.5 * striker_kg * self.stood**2)

    def as_dict(self) -> dict[str, Any]:
        """Return it as built-in types, for JSON."""
        return {
            "kind": self.disturbance.kind,
            "direction_deg": self.disturbance.direction_deg,
            "frequency_hz": self.disturbance.frequency_hz or None,
            "controller": self.under.variant,
            "servo_profile": self.under.servo_profile,
            "margin": self.margin,
            "unit": self.unit,
            "margin_normalised": self.normalised,
            "size_stood": self.stood,
            "size_fell": self.fell,
            "size_unit": UNITS[self.disturbance.kind],
            "runs": self.runs,
            "energy_j": self.energy_j,
            "energy_normalised_j": self.normalised_energy_j,
            "absorbed_share": self.absorbed,
            "at_margin": self.seen,
        }


@dataclass(frozen=True)
class ImpedanceResult:
    """Equivalent impedance from the sines of one kind and direction.

    Attributes:
        kind: of the sines.
        direction_deg: of the sines.
        under: controller and servo profile.
        impedance: fitted; None for fewer than two frequencies.
        at_hz: frequencies behind it [Hz].
        force_over_way: at each, real and imaginary part [N/m].
    """

    kind: PushKind
    direction_deg: float
    under: Under
    impedance: Impedance | None
    at_hz: list[float]
    force_over_way: list[tuple[float, float]]

    def as_dict(self) -> dict[str, Any]:
        """Return it as built-in types, for JSON."""
        return {
            "kind": self.kind,
            "direction_deg": self.direction_deg,
            "controller": self.under.variant,
            "servo_profile": self.under.servo_profile,
            "impedance": self.impedance and self.impedance._asdict(),
            "frequency_hz": self.at_hz,
            "force_over_way": self.force_over_way,
        }


def push_result(
    search: MarginSearch,
    disturbance: Disturbance,
    under: Under,
    *,
    subject: Subject,
    row: Row | None,
) -> PushResult:
    """Close a search."""
    return PushResult(
        disturbance, under, subject, search.stood, search.fell, search.tried, row
    )


def impedances(results: Sequence[PushResult]) -> list[ImpedanceResult]:
    """Fit the sines of each kind, direction and controller."""
    together: dict[tuple[PushKind, float, Under], list[PushResult]] = {}
    for result in results:
        kind, direction = result.disturbance.kind, result.disturbance.direction_deg
        if kind in SINES and result.seen:
            together.setdefault((kind, direction, result.under), []).append(result)
    found = []
    for (kind, direction, under), there in together.items():
        at = [r.disturbance.frequency_hz for r in there]
        parts = [(*r.seen["force_over_way"],) for r in there]
        fitted = fit_impedance(at, [complex(*part) for part in parts])
        found.append(ImpedanceResult(kind, direction, under, fitted, at, parts))
    return found


def push_tables(results: Sequence[PushResult]) -> list[TextTable]:
    """Return the table of margins, and that of impedances if there are any."""
    margins = TextTable(
        "Stability margins",
        (
            *("push", "controller", "servo", "stood", "as for a person"),
            *("energy taken up [J]", "as for a person [J]", "share of the strike's"),
        ),
        [
            (
                result.disturbance.words,
                *result.under,
                _margin(result, result.margin),
                _margin(result, result.normalised),
                text(result.energy_j, ".2f"),
                text(result.normalised_energy_j, ".2f"),
                text(result.absorbed, ".2f"),
            )
            for result in results
        ],
    )
    fitted = [found for found in impedances(results) if found.impedance is not None]
    rows = [
        (
            f"{found.kind} {found.direction_deg:g} deg",
            *found.under,
            *(f"{value:.0f}" for value in found.impedance or ()),
        )
        for found in fitted
    ]
    columns = ("inertia [kg]", "damping [N s/m]", "stiffness [N/m]")
    named = ("sines", "controller", "servo", *columns)
    return [margins, TextTable("Equivalent impedance", named, rows)][: 1 + bool(rows)]


def _margin(result: PushResult, value: float) -> str:
    words = f"{1e3 * value:.0f} mm" if result.unit == "m" else f"{value:.0f} N"
    return f"{words} or more" if result.fell is None else words
