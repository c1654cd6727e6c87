"""A run of a trial: a study's, with figures that only a search asks for."""

from __future__ import annotations

from dataclasses import dataclass

from surefoot.run_plan import RunPlan
from surefoot.studies.cell import Cell, Row

EFFORT = "effort_w"
"""Mean over the run of the joints' power, be it done or taken up [W]."""


@dataclass(frozen=True)
class TuneCell(Cell):
    """What is run, with which seed, and whether the joints' power is looked at."""

    with_effort: bool = False

    def run(self, plan: RunPlan) -> Row:
        """Run its plan; what was run, and the figures."""
        from surefoot.runs import run_inline

        run = run_inline(plan, record=self.with_effort)
        row = self.row(run.result)
        if self.with_effort:
            power = abs(run.signals["effort"] * run.signals["dq"]).sum(axis=1)
            row[EFFORT] = float(power.mean())
        return row
