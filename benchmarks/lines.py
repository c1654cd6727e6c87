"""Studies by lines: a line is a kind of run that is done with many numbers.

The number of a run is the seed of its random draws and of its sensor noise. Shares of
runs that stood or walked come with Wilson's 95 % interval.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import msgspec

from surefoot.presentation import markdown
from surefoot.run_plan import RunPlan
from surefoot.runs import run_inline
from surefoot.schemas.scenario import Scenario
from surefoot.studies.cell import Row, figures_of, is_up, plan_in
from surefoot.studies.execute import execute
from surefoot.studies.store import StudyStore
from surefoot.studies.summaries import success_interval


@dataclass(frozen=True)
class LineRun:
    """One run of a line; each study defines its lines in a subclass."""

    line: str
    number: int
    controller: str
    servo_profile: str

    figures: ClassVar[tuple[str, ...]] = ()
    """Figures of a result that are kept in addition to those of all studies."""

    def scenario(self) -> Scenario:
        """Return the scenario of the run."""
        raise NotImplementedError

    @property
    def key(self) -> str:
        """Unique in a study, and readable."""
        return "|".join(
            (self.line, self.controller, self.servo_profile, str(self.number))
        )

    @property
    def case(self) -> str:
        """Line and number, in words."""
        return f"{self.line}, run {self.number}"

    @property
    def group(self) -> str:
        """Each run is its own group: its draws are its own."""
        return self.key

    def plan(self, *, robot: str, overrides: tuple[str, ...]) -> RunPlan:
        """Return the plan of the run."""
        return plan_in(
            self.scenario(),
            None,
            variant=self.controller,
            servo_profile=self.servo_profile,
            seed=self.number,
            robot=robot,
            overrides=overrides,
        )

    def run(self, plan: RunPlan) -> Row:
        """Run the plan; return the row: case and figures."""
        result = run_inline(plan, record=False).result
        figures = msgspec.to_builtins(result)
        return {
            "line": self.line,
            "seed": self.number,
            "variant": self.controller,
            "servo_profile": self.servo_profile,
            **figures_of(result),
            **{name: figures[name] for name in self.figures},
        }


def study_options(about: str | None, *, count: int) -> argparse.ArgumentParser:
    """Return the options common to these studies; each study adds its own."""
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", default=[""], help="parts of lines' names")
    parser.add_argument("--first", type=int, default=0, help="number of the first run")
    parser.add_argument("--count", type=int, default=count, help="runs of each line")
    parser.add_argument("--controllers", nargs="+", default=["whole-body"])
    parser.add_argument("--set", action="append", default=[], help="section.name=value")
    parser.add_argument("--jobs", type=int, default=0, help="processes; 0: all cores")
    parser.add_argument("--out", type=Path, help="folder that keeps finished runs")
    return parser


def run_all(
    runs: Sequence[LineRun], options: argparse.Namespace, *, title: str
) -> list[Row]:
    """Do the runs that are not stored yet; return all rows, and print the falls."""
    about = {title: sorted(options.set)}
    place = nullcontext(options.out) if options.out else tempfile.TemporaryDirectory()
    with place as folder, StudyStore(Path(folder), about=about) as store:
        rows = execute(
            runs,
            store,
            robot="walker",
            overrides=tuple(options.set),
            jobs=options.jobs,
            title=title,
        )
    for run, row in zip(runs, rows, strict=True):
        if not is_up(row):
            print(f"{run.key}: {row['outcome']} {row['outcome_detail']}")
    return rows


def share_in_words(rows: Sequence[Row]) -> str:
    """Return the number of runs that were up at the end, and the share's interval."""
    up = sum(map(is_up, rows))
    low, high = success_interval(up, len(rows))
    return f"{up} of {len(rows)} ({100 * low:.0f} to {100 * high:.0f} %)"


def pivot(
    corner: str,
    cells: dict[tuple[str, str], list[Row]],
    words: Callable[[list[Row]], str],
) -> str:
    """Return a Markdown table, with rows and columns in the order of their first cells.

    Args:
        corner: heading of the first column.
        cells: by row and column; a missing one has no runs.
        words: gives the text of a cell.
    """
    columns = list(dict.fromkeys(column for _, column in cells))
    rows = [
        (row, *(words(cells.get((row, column), [])) for column in columns))
        for row in dict.fromkeys(row for row, _ in cells)
    ]
    return markdown((corner, *columns), rows)
