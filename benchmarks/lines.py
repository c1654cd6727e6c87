"""Studies by lines: one kind of run each, done with many numbers.

What a line draws, it draws with the number of the run, which is also the seed of the
sensor noise. Shares of what stood or walked come with Wilson's 95 % interval.
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

from surefoot.run_plan import RunPlan
from surefoot.runs import run_inline
from surefoot.schemas.scenario import Scenario
from surefoot.studies.cell import Row, figures_of, is_up, plan_in
from surefoot.studies.execute import execute
from surefoot.studies.store import StudyStore
from surefoot.studies.study import success_interval
from surefoot.studies.tables import markdown


@dataclass(frozen=True)
class LineRun:
    """One run of a line; a study says what each of its lines is."""

    line: str
    number: int
    controller: str
    servo_profile: str

    figures: ClassVar[tuple[str, ...]] = ()
    """What is kept of a result, beside what studies keep."""

    def scenario(self) -> Scenario:
        """Return what happens in it."""
        raise NotImplementedError

    @property
    def key(self) -> str:
        """Unique in a study, and readable."""
        return "|".join(
            (self.line, self.controller, self.servo_profile, str(self.number))
        )

    @property
    def case(self) -> str:
        """What is run, in words."""
        return f"{self.line}, run {self.number}"

    @property
    def group(self) -> str:
        """A group of its own: what is drawn is."""
        return self.key

    def plan(self, *, robot: str, overrides: tuple[str, ...]) -> RunPlan:
        """Return its plan."""
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
        """Run its plan; what was run, and the figures."""
        result = run_inline(plan, record=False).result
        figures = msgspec.to_builtins(result)
        return {
            "line": self.line,
            "number": self.number,
            "controller": self.controller,
            "servo_profile": self.servo_profile,
            **figures_of(result),
            **{name: figures[name] for name in self.figures},
        }


def study_options(about: str | None, *, count: int) -> argparse.ArgumentParser:
    """Return the options of all such studies, to which one adds its own."""
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
    """Do the runs that are not kept yet; return the rows of all, and print who fell."""
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
    """Return how many were up at the end, and the interval of that share."""
    up = sum(map(is_up, rows))
    low, high = success_interval(up, len(rows))
    return f"{up} of {len(rows)} ({100 * low:.0f} to {100 * high:.0f} %)"


def pivot(
    corner: str,
    cells: dict[tuple[str, str], list[Row]],
    words: Callable[[list[Row]], str],
) -> str:
    """Return a Markdown table of cells in words, by row and column as they first come.

    Args:
        corner: heads the first column.
        cells: by row and column; one that is not there has no runs.
        words: what a cell says.
    """
    columns = list(dict.fromkeys(column for _, column in cells))
    rows = [
        (row, *(words(cells.get((row, column), [])) for column in columns))
        for row in dict.fromkeys(row for row, _ in cells)
    ]
    return markdown((corner, *columns), rows)
