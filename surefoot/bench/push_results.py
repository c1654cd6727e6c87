"""Results of DYSTURBANCE from its pushes, and their page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from surefoot.bench.bench_files import (
    Figure,
    Section,
    TextTable,
    styles,
    write_page,
)
from surefoot.bench.bench_runs import Subject, Under, proportion
from surefoot.bench.push_cells import (
    SINES,
    STRIKER_SHARE,
    UNITS,
    Disturbance,
    Impedance,
    MarginSearch,
    PushKind,
    fit_impedance,
)
from surefoot.presentation import canvas, svg_of, write_out
from surefoot.schemas.reasons import given
from surefoot.studies.cell import Row

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


@dataclass(frozen=True)
class PushResult:
    """The largest push of a kind that the robot stood, and the figures of that run.

    Attributes:
        disturbance: the push.
        under: controller and servo profile.
        subject: measures of the robot.
        stood: largest size that the robot stood; 0 if none.
        fell: smallest size that it did not stand; None if it stood all.
        runs: number of sizes tried.
        row: row of the run at ``stood``; None if there is none.
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
        """The probe's figures of the largest push that the robot stood."""
        found: dict[str, Any] = {} if self.row is None else self.row["seen"]
        return found

    @property
    def margin(self) -> float:
        """Stability margin in the unit of :attr:`unit`.

        The benchmark's definition: peak force of a strike, peak-to-peak size of a sine,
        final size of a slow push.
        """
        if self.disturbance.kind == "impulse":
            return float(self.seen.get("peak_n", 0.0))
        return 2.0 * self.stood if self.disturbance.kind in SINES else self.stood

    @property
    def unit(self) -> str:
        """Unit of the margin: N or m."""
        kind = self.disturbance.kind
        return "N" if kind == "impulse" else UNITS[kind]

    @property
    def normalised(self) -> float:
        """The equivalent margin of a person, see :func:`proportion`."""
        of = proportion(self.subject, direction_deg=self.disturbance.direction_deg)
        return self.margin / (of.way if self.unit == "m" else of.force)

    @property
    def energy_j(self) -> float | None:
        """Energy absorbed by the robot: in a strike, or in a period of a sine [J]."""
        name = "work_per_period_j" if self.disturbance.kind in SINES else "work_j"
        energy: float | None = self.seen.get(name)
        return energy

    @property
    def normalised_energy_j(self) -> float | None:
        """The equivalent energy of a person [J]."""
        of = proportion(self.subject, direction_deg=self.disturbance.direction_deg)
        return None if self.energy_j is None else self.energy_j / of.energy

    @property
    def absorbed(self) -> float | None:
        """Share of its energy that the striker did not get back [1]."""
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
    """Equivalent impedance, fitted to the sines of one kind and direction.

    Attributes:
        kind: of the sines.
        direction_deg: of the sines.
        under: controller and servo profile.
        impedance: fitted; None for fewer than two frequencies.
        at_hz: frequencies of the fitted sines [Hz].
        force_over_way: force over displacement at each: real, imaginary part [N/m].
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
    """Return the result of a finished search."""
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
    """Return the table of margins, and the table of impedances if there are any."""
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
                given(result.energy_j, ".2f"),
                given(result.normalised_energy_j, ".2f"),
                given(result.absorbed, ".2f"),
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


def write_push_page(
    folder: Path, results: Sequence[PushResult], *, robot: str, subject: Subject
) -> None:
    """Write index.html."""
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
    """One drawing per direction with several frequencies that the robot stood."""
    figures = []
    for direction in dict.fromkeys(r.disturbance.direction_deg for r in results):
        there = [
            result
            for result in results
            if result.disturbance.direction_deg == direction
            and result.disturbance.kind in SINES
            and result.margin > 0.0  # not on a logarithmic axis
        ]
        if len({result.disturbance.frequency_hz for result in there}) > 1:
            title = f"margins of sines, {direction:g} deg"
            figures.append(Figure(draw_margins(title, there), title))
    return figures


def draw_margins(title: str, results: Sequence[PushResult]) -> bytes:
    """Draw margins over frequency: of forces, and of displacements.

    Args:
        title: of the drawing.
        results: sines in one direction that the robot stood.

    Returns:
        SVG.
    """
    kinds = [k for k in SINES if any(r.disturbance.kind == k for r in results)]
    figure, _ = canvas(9.6, 3.6, columns=len(kinds))
    figure.suptitle(title)
    looks = styles([result.under for result in results])
    frequencies = sorted({r.disturbance.frequency_hz for r in results})
    for axes, kind in zip(figure.axes, kinds, strict=True):
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
                label=under.label if kind == kinds[0] else None,
                **look,
            )
        unit = "way [mm]" if kind == "sine-displacement" else "force [N]"
        axes.set(xscale="log", yscale="log", xlabel="frequency [Hz]")
        write_out(axes.xaxis, frequencies)
        write_out(axes.yaxis)
        axes.set(ylabel=f"{unit}, lowest to highest")
        axes.grid(alpha=0.3, which="both")
    return svg_of(figure)
