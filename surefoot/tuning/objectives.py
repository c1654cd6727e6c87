"""What a search makes small: figures of runs, each with its unit."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from surefoot.errors import UsageError
from surefoot.schemas.key_names import nearest
from surefoot.schemas.reasons import Outcome
from surefoot.studies.cell import Row
from surefoot.tuning.runs import EFFORT, SCORE, SENSITIVITY

BEYOND = 1e3
"""For a trial without a figure, since its runs ended before it counted: worse than any
that stands, in each unit."""


class Objective(NamedTuple):
    """A figure of a run.

    Attributes:
        name: as on the command line.
        unit: of the figure.
        about: what it is.
        of: takes it from a row; None for a run that ended before it counted, or that
            has no such figure.
        extra: what a run has to look for besides, if it has to.
    """

    name: str
    unit: str
    about: str
    of: Callable[[Row], float | None]
    extra: str = ""


def _norm(name: str, *, mean: bool = False) -> Callable[[Row], float | None]:
    def of(row: Row) -> float | None:
        values = row[name]
        if values is None:
            return None
        return math.hypot(*values) / (math.sqrt(len(values)) if mean else 1.0)

    return of


def _largest(name: str) -> Callable[[Row], float | None]:
    return lambda row: None if row[name] is None else float(max(row[name]))


def _extra(name: str) -> Callable[[Row], float | None]:
    return lambda row: row.get(name)


_ALL = (
    Objective("com", "mm", "CoM error, rms of its length", _norm("com_error_rms_mm")),
    Objective("com-max", "mm", "largest CoM error", _norm("com_error_max_mm")),
    Objective(
        "force",
        "N",
        "force deviation, rms of both feet",
        _norm("force_deviation_rms_n", mean=True),
    ),
    Objective("peak", "N", "largest force on a foot", _largest("force_peak_n")),
    Objective("tilt", "deg", "largest tilt", lambda row: row["base_tilt_max_deg"]),
    Objective("effort", "W", "mean power of the joints", _extra(EFFORT), EFFORT),
    Objective("score", "", "D of COMTEST against people", _extra(SCORE), SCORE),
    Objective(
        "margin",
        "",
        "two over the loop's disk margin, 1 is best",
        _extra(SENSITIVITY),
        SENSITIVITY,
    ),
)
OBJECTIVES = {objective.name: objective for objective in _ALL}


def find_objectives(names: Sequence[str]) -> list[Objective]:
    """Return objectives by name.

    Raises:
        UsageError: there is no such objective, or one is named twice.
    """
    for name in names:
        if name not in OBJECTIVES or names.count(name) > 1:
            raise UsageError(
                f"--objectives {','.join(names)}: got {name!r}"
                f"{nearest(name, list(OBJECTIVES))}; expected some of "
                f"{', '.join(OBJECTIVES)}, each once"
            )
    return [OBJECTIVES[name] for name in names]


def is_up(row: Row) -> bool:
    """Whether the robot was up at the end."""
    return Outcome(row["outcome"]).is_up


def mean_figures(rows: Sequence[Row], objectives: Sequence[Objective]) -> list[float]:
    """Return each objective's mean over the runs that have it."""

    def mean(objective: Objective) -> float:
        found = [value for row in rows if (value := objective.of(row)) is not None]
        return sum(found) / len(found) if found else BEYOND

    return [mean(objective) for objective in objectives]


def is_beaten(
    rows: Sequence[Row], by: Sequence[Row], objectives: Sequence[Objective]
) -> bool:
    """Whether one trial was worse than another in every run and every objective.

    Args:
        rows: runs of the one, so far.
        by: runs of the other, of the same cases in the same order.
        objectives: what counts.
    """
    pairs = [
        (objective.of(row), objective.of(other))
        for row, other in zip(rows, by, strict=False)
        for objective in objectives
    ]
    both = [(a, b) for a, b in pairs if a is not None and b is not None]
    return bool(both) and all(a > b for a, b in both)
