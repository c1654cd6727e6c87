"""Outcome of a search: Pareto front, chosen trial, and its comparison with the start.

``surefoot.tune`` returns it; the page shows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from surefoot.run_plan import resolve_settings
from surefoot.schemas.settings import ControllerSettings
from surefoot.sim_robot.metrics import COM_FROM_S
from surefoot.studies.cell import Row
from surefoot.tuning.ask import Spec
from surefoot.tuning.objectives import Objective, mean_figures, succeeded
from surefoot.tuning.parameters import Value, overrides_of

_SEEN = (
    "Not held out: {}. With another seed these are the same runs, to the last bit, "
    "since they have no noise; name other scenarios with --held-out."
)
_UNMEASURED = (
    "No run has a figure for {}, so nothing was searched by it: CoM errors and force "
    f"deviations count from {COM_FROM_S:g} s on."
)
_ON_FRONT = "The start is on the front: nothing is better in every objective."
NOTICEABLE = 0.005
"""Relative change below which a value or a figure counts as the same."""


@dataclass(frozen=True)
class Candidate:
    """A finished trial.

    Attributes:
        place: its number among the trials; 0 is the start of the search.
        values: value of each parameter.
        rows: its runs.
        stopped: why some runs are missing; empty if none is, and all stood.
        figures: mean of each objective over its runs.
    """

    place: int
    values: dict[str, Value]
    rows: list[Row] = field(repr=False)
    stopped: str
    figures: list[float]


@dataclass(frozen=True)
class Comparison:
    """A case before and after.

    Attributes:
        case: scenario.
        runs: number of runs before, and after.
        up: number of runs that stood, before and after.
        before: mean of each objective over the runs that stood; None when none did.
        after: the same with the settings that were found.
    """

    case: str
    runs: int
    up: tuple[int, int]
    before: list[float] | None
    after: list[float] | None


@dataclass(frozen=True)
class Tuned:
    """Outcome of a search.

    Attributes:
        spec: specification of the search.
        candidates: all finished trials, by place.
        front: trials that no other trial dominates, sorted by the first objective.
        start: the trial with the settings at the start.
        chosen: trial of the front with the least mean of its objectives, each divided
            by the start's, or by the front's least if the start fell.
        training: before and after, on the scenarios of the search.
        held_out: the same on held-out scenarios; empty if the search was interrupted.
        seen: held-out scenarios whose runs equal those of the search bit for bit.
    """

    spec: Spec
    candidates: list[Candidate]
    front: list[Candidate]
    start: Candidate
    chosen: Candidate
    training: list[Comparison]
    held_out: list[Comparison]
    seen: list[str] = field(default_factory=list)

    @property
    def overrides(self) -> list[str]:
        """The settings found, as texts ``section.name=value`` over the defaults."""
        spec = self.spec
        tuned = overrides_of(spec.parameters, self.chosen.values, start=spec.settings)
        return [*spec.base, *tuned]

    @property
    def settings(self) -> ControllerSettings:
        """All settings, with the values found."""
        return resolve_settings(None, overrides=self.overrides)

    @property
    def unmeasured(self) -> list[str]:
        """Return the objectives for which no run of the start has a figure."""
        start = self.start
        return [
            objective.name
            for objective in self.spec.figures
            if start.rows and not start.stopped
            if all(objective.of(row) is None for row in start.rows)
        ]

    @property
    def words(self) -> list[str]:
        """Return the changes and their effect, in sentences."""
        seen = [_SEEN.format(", ".join(self.seen))] if self.seen else []
        if self.unmeasured:
            seen.insert(0, _UNMEASURED.format(", ".join(self.unmeasured)))
        if not self.front:
            return [
                f"None of {len(self.candidates)} trials stood; the start did not: "
                f"{self.start.stopped}. Search other parameters, or easier scenarios.",
                *seen,
            ]
        if self.chosen is self.start:
            return [
                f"Nothing better than the start was found in {len(self.candidates)} "
                "trials: no trial that stood has a lower mean of its objectives.",
                *([_ON_FRONT] if self.start in self.front else []),
                *seen,
            ]
        return [
            *(_change(self, parameter.name) for parameter in self.spec.parameters),
            f"Training: {_worth(self.training, self.spec.figures)}.",
            *(
                [f"Held out: {_worth(self.held_out, self.spec.figures)}."]
                if self.held_out
                else []
            ),
            *seen,
        ]


def choose(spec: Spec, candidates: Sequence[Candidate]) -> tuple[list[Any], Candidate]:
    """Return the front, and the trial chosen from it; the start if the front is empty.

    Args:
        spec: specification of the search.
        candidates: finished trials, the start first.
    """
    whole = [c for c in candidates if not c.stopped]
    front = [c for c in whole if not any(_dominates(o, c) for o in whole)]
    front.sort(key=lambda c: c.figures)
    start = candidates[0]
    if not front:
        return [], start
    against = front if start.stopped else [start]
    scale = [min(c.figures[i] for c in against) for i in range(len(spec.objectives))]

    def share(candidate: Candidate) -> tuple[float, int]:
        shares = [
            f / s if s else f for f, s in zip(candidate.figures, scale, strict=True)
        ]
        return sum(shares) / len(shares), candidate.place

    return front, min(front, key=share)


def compare(
    before: Sequence[Row], after: Sequence[Row], objectives: Sequence[Objective]
) -> list[Comparison]:
    """Compare runs by scenario.

    Args:
        before: runs with the settings of the start.
        after: runs of the same cases with other settings.
        objectives: figures to compare.
    """

    def means(rows: list[Row]) -> list[float] | None:
        standing = [row for row in rows if succeeded(row)]
        return mean_figures(standing, objectives) if standing else None

    made = []
    for case in dict.fromkeys(row["scenario"] for row in (*before, *after)):
        old, new = (
            [r for r in rows if r["scenario"] == case] for rows in (before, after)
        )
        up = (sum(map(succeeded, old)), sum(map(succeeded, new)))
        made.append(
            Comparison(case, max(len(old), len(new)), up, means(old), means(new))
        )
    return made


def _dominates(one: Candidate, other: Candidate) -> bool:
    pairs = list(zip(one.figures, other.figures, strict=True))
    return all(a <= b for a, b in pairs) and any(a < b for a, b in pairs)


def _change(tuned: Tuned, name: str) -> str:
    (parameter,) = (p for p in tuned.spec.parameters if p.name == name)
    old, new = tuned.start.values[name], tuned.chosen.values[name]
    about = f" ({parameter.about})" if parameter.about else ""
    said = f"{name} stays {value_text(old)}"
    if old != new:
        said = f"{name}: {value_text(old)} to {value_text(new)}"
    return f"{said} {parameter.unit}".rstrip() + f"{about}."


def value_text(value: Value) -> str:
    """Return a parameter's value, or a figure, as text with few digits."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _worth(comparisons: Sequence[Comparison], objectives: Sequence[Objective]) -> str:
    """In words: falls, and each objective's mean over the cases that stood twice."""
    runs = sum(c.runs for c in comparisons)
    up = [sum(c.up[i] for c in comparisons) for i in (0, 1)]
    words = [f"{up[0]} to {up[1]} of {runs} runs stood"]
    both = [(c.before, c.after) for c in comparisons if c.before and c.after]
    for index, objective in enumerate(objectives):
        if both:
            old = sum(before[index] for before, _ in both) / len(both)
            new = sum(after[index] for _, after in both) / len(both)
            words.append(
                f"{objective.about} {_figure_change(old, new, objective.unit)}"
            )
    return "; ".join(words)


def _figure_change(old: float, new: float, unit: str) -> str:
    share = (new - old) / old if old else 0.0
    told = f"{share:+.0%}" if abs(share) >= NOTICEABLE else "the same"
    return f"{old:.4g} to {new:.4g} {unit}".rstrip() + f" ({told})"
