"""A worker of a search: ``python -m surefoot.tuning.worker JOURNAL --trials N``.

It takes trials from the journal until there are none. Whoever started it learns from
its standard output, one line a trial, how many it has finished.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from surefoot.errors import ERROR_PREFIX, exit_code_of
from surefoot.processes.child import begin_as_child
from surefoot.schemas.errors import FileFormatError
from surefoot.studies.cell import Row, Task
from surefoot.studies.execute import run_tasks
from surefoot.tuning.objectives import BEYOND, is_beaten, is_up, mean_figures
from surefoot.tuning.trials import Trials

ROWS, STOPPED, DOWN = "rows", "stopped", "down"
"""What a trial keeps: its runs, why it has not all of them, and its constraint."""
REFUSED = 2.0
"""Of the constraint, for values that contradict each other: worse than any fall."""


def work(
    trials: Trials,
    *,
    count: int,
    scheduler: str | None,
    on_trial: Callable[[], None],
) -> None:
    """Do trials until there are none.

    Args:
        trials: of the search.
        count: how many there are to be, with those of others.
        scheduler: of the Dask cluster that runs them; None to run them here.
        on_trial: called after each.
    """
    finished: list[list[Row]] = []
    with trials.worker() as name:
        while (claimed := trials.claim(name, count=count)) is not None:
            trial, values = claimed
            finished = [
                done.user_attrs[ROWS]
                for done in trials.finished()
                if not done.user_attrs[STOPPED]
            ]
            rows, why, down = evaluate(trials, values, finished, scheduler=scheduler)
            figures = trials.spec.figures
            trial.set_user_attr(ROWS, rows)
            trial.set_user_attr(STOPPED, why)
            trial.set_constraint(DOWN, down)
            means = mean_figures(rows, figures) if rows else [BEYOND] * len(figures)
            # From this one line on the trial is finished, whatever happens.
            trials.study.tell(trial, means)
            on_trial()


def evaluate(
    trials: Trials,
    values: dict[str, Any],
    finished: Sequence[Sequence[Row]],
    *,
    scheduler: str | None,
) -> tuple[list[Row], str, float]:
    """Run a trial, seed by seed, as long as it is worth it.

    Args:
        trials: of the search.
        values: of this trial.
        finished: runs of the trials that were run to the end and stood.
        scheduler: see :func:`work`.

    Returns:
        Its runs; why they are not all, empty when they are; and by how much it breaks
        the constraint: the share of runs that it did not stand, up to 1.
    """
    spec = trials.spec
    rounds = spec.rounds()
    count = sum(map(len, rounds))
    rows: list[Row] = []
    for number, cells in enumerate(rounds, start=1):
        try:
            tasks = [spec.task(cell, values) for cell in cells]
        except FileFormatError as error:
            return rows, f"refused: {error}", REFUSED
        for row in _in_order(tasks, scheduler=scheduler):
            rows.append(row)
            if not is_up(row):
                why = f"{row['scenario']}, seed {row['seed']}: {row['outcome']}"
                return rows, why, (count - len(rows) + 1) / count
        beaten = any(is_beaten(rows, other, spec.figures) for other in finished)
        if beaten and number < len(rounds):
            return rows, "worse in each run than another trial", 0.0
    return rows, "", 0.0


def _in_order(tasks: list[Task], *, scheduler: str | None) -> Iterable[Row]:
    """Rows in the order of their tasks; here each is run when it is asked for."""
    if scheduler is None:
        return map(Task.run, tasks)
    order = {task.cell.key: index for index, task in enumerate(tasks)}
    rows = run_tasks(tasks, scheduler=scheduler)
    return sorted(rows, key=lambda row: order[row["key"]])


def main() -> int:
    """Work on a journal until nothing is left to be done."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("journal", type=Path)
    parser.add_argument("--trials", type=int, required=True)
    parser.add_argument("--scheduler")
    parser.add_argument("--child", action="store_true")
    arguments = parser.parse_args()
    if arguments.child:
        begin_as_child()
    done = 0

    def tell() -> None:
        nonlocal done
        done += 1
        print(done, flush=True)

    try:
        work(
            Trials(arguments.journal),
            count=arguments.trials,
            scheduler=arguments.scheduler,
            on_trial=tell,
        )
    except Exception as error:
        code = exit_code_of(error)
        if code is None:
            raise
        print(f"{ERROR_PREFIX} {error}", file=sys.stderr)
        return code
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
