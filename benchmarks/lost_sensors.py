"""Effect of the loss of an ankle sensor: ``degrade`` against ``hold``.

    python -m benchmarks.lost_sensors [--only left "NaN"] [--count 1] [--out FOLDER]

A line is a sensor and its fault, which lasts to the end. The scenarios are shipped ones
that are cut short. The k-th run has noise seed k. Writes Markdown: the largest error of
the centre of mass, or the fall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import msgspec

from benchmarks.lines import LineRun, pivot, run_all, study_options
from surefoot import load_scenario
from surefoot.run_plan import RunPlan
from surefoot.schemas.scenario import Scenario, SensorFault
from surefoot.studies.cell import Row


class Ground(NamedTuple):
    """A scenario, its duration, and the time at which the sensor fails [s]."""

    scenario: str
    duration_s: float
    start_s: float


GROUNDS = (
    Ground("standing", 9.0, 4.0),
    Ground("moving-platform-slow", 12.0, 4.0),
    Ground("falling-platform-80", 7.0, 3.0),
)
FAULTS: dict[str, dict[str, Any]] = {
    "missing": {"kind": "drop"},
    "frozen": {"kind": "freeze"},
    "NaN": {"kind": "nan"},
    "jumps by 2500 N": {"kind": "jump", "size": 2500.0},
    "biased by 100 N": {"kind": "jump", "size": 100.0},
    "biased by 300 N": {"kind": "jump", "size": 300.0},
}
LINES = {
    f"{side} {fault}": (side, fault) for fault in FAULTS for side in ("left", "right")
}
POLICIES = ("degrade", "hold")


@dataclass(frozen=True)
class LossRun(LineRun):
    """One run in which a sensor fails."""

    ground: Ground
    policy: str

    figures = ("degraded_ticks",)

    @property
    def key(self) -> str:
        """Unique in a study, and readable."""
        return f"{super().key}|{self.ground.scenario}|{self.policy}"

    def scenario(self) -> Scenario:
        """Return the shipped one, cut short, with the fault."""
        side, fault = LINES[self.line]
        fails = SensorFault(
            sensor=f"{side}_ankle_ft",
            start_s=self.ground.start_s,
            duration_s=3600.0,
            **FAULTS[fault],
        )
        return msgspec.structs.replace(
            load_scenario(self.ground.scenario),
            duration_s=self.ground.duration_s,
            fault=[fails],
        )

    def plan(self, *, robot: str, overrides: tuple[str, ...]) -> RunPlan:
        """Return its plan; see the base class."""
        policy = f'safety.ft_lost="{self.policy}"'
        return super().plan(robot=robot, overrides=(*overrides, policy))


def cell(rows: Sequence[Row]) -> str:
    """Return outcome and largest error of runs that differ only by their seed."""
    falls = [row["fell_at_s"] for row in rows if row["fell"]]
    if falls:
        share = "" if len(falls) == len(rows) else f" {len(falls)} of {len(rows)}"
        return f"**fell**{share} at {min(falls):.1f} s"
    x, y, z = (max(row["com_error_max_mm"][i] for row in rows) for i in range(3))
    noticed = all(row["degraded_ticks"] for row in rows)
    return f"{x:.0f}, {y:.0f}, {z:.0f}" + ("" if noticed else " (unnoticed)")


def main() -> int:
    """Read the command line, run and print."""
    options = study_options(__doc__, count=1).parse_args()
    lines = [n for n in LINES if any(word in n for word in options.only)]
    numbers = range(options.first, options.first + options.count)
    runs = [
        LossRun(line, number, controller, "ideal", ground, policy)
        for line, ground, policy, controller, number in product(
            lines, GROUNDS, POLICIES, options.controllers, numbers
        )
    ]
    cells: dict[tuple[str, str], list[Row]] = {}
    for run, row in zip(runs, run_all(runs, options, title="losses"), strict=True):
        others = () if run.controller == "whole-body" else (run.controller,)
        column = ", ".join((run.ground.scenario, run.policy, *others))
        cells.setdefault((run.line, column), []).append(row)
    print(pivot("sensor", cells, cell), end="")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
