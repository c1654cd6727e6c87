"""Runs what is missing in a study, in parallel processes."""

from __future__ import annotations

import os
from collections.abc import Sequence

from cli.study.cell import Cell
from cli.study.run_cell import plan_of, run_cell
from cli.study.store import StudyStore
from cli.study.worker import end_with

IDLE_S = 10
"""A worker without work ends after so long [s]."""


def execute(
    cells: Sequence[Cell],
    store: StudyStore,
    *,
    robot: str,
    overrides: tuple[str, ...] = (),
    jobs: int,
    title: str,
) -> None:
    """Does every run that the store does not have yet, and keeps each when done.

    Args:
        cells: all runs of the study.
        store: open for writing.
        robot: shipped robot or a robot file.
        overrides: settings for all, ``section.name=value``.
        jobs: processes.
        title: for the progress bar.

    Raises:
        FileFormatError: a value does not fit its scenario; nothing has been run.
    """
    from joblib import Parallel, delayed, parallel_config

    from cli.console import count_bar

    missing = [cell for cell in cells if cell.key not in store.rows]
    for cell in {cell.group: cell for cell in missing}.values():
        plan_of(cell, robot=robot, overrides=overrides)
    workers = parallel_config(
        backend="loky",
        idle_worker_timeout=IDLE_S,
        initializer=end_with,
        initargs=(os.getpid(),),
    )
    with (
        workers,
        count_bar(title, total=len(cells), done=len(cells) - len(missing)) as tell,
    ):
        work = Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)
        for row in work(
            delayed(run_cell)(cell, robot=robot, overrides=overrides)
            for cell in missing
        ):
            store.add(row)
            tell()
