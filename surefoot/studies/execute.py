"""Runs what is missing in a study, in parallel processes."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator, Sequence

from surefoot.progress import CountBar, no_bar
from surefoot.studies.cell import Row, Task, Work
from surefoot.studies.fingerprint import inputs_fingerprint
from surefoot.studies.store import StudyStore

IDLE_S = 10
"""Idle time after which a worker ends [s]."""
LOOK_S = 0.5


def end_with(parent: int) -> None:
    """End this process once its parent was killed, whatever it does then.

    Nobody would get what it does; and a parent that dies while it holds a lock of its
    workers would leave those that wait for work waiting forever.

    Args:
        parent: id of the process that asks for the work.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK_S)  # nothing tells a process that its parent has died
        os._exit(1)

    threading.Thread(target=watch, name="parent-watch", daemon=True).start()


def execute(
    cells: Sequence[Work],
    store: StudyStore,
    *,
    robot: str,
    overrides: tuple[str, ...] = (),
    jobs: int = 0,
    scheduler: str | None = None,
    title: str,
    bar: CountBar = no_bar,
) -> None:
    """Do every run that the store does not have yet, and keep each when done.

    Args:
        cells: all runs of the study.
        store: of the study; written to once all cells have been checked.
        robot: shipped robot or a robot file.
        overrides: settings for all, ``section.name=value``.
        jobs: processes; 0 for one per processor.
        scheduler: address of a Dask scheduler, whose workers run them instead.
        title: for the progress bar.
        bar: shows how many runs are done.

    Raises:
        FileFormatError: a value does not fit its scenario; nothing has been run.
        UsageError: kept runs are of another scenario, robot or settings.
    """
    tasks = tasks_of(cells, robot=robot, overrides=overrides)
    for task in tasks:
        store.check(task)
    store.begin()
    missing = [task for task in tasks if task.cell.key not in store.rows]
    with bar(title, total=len(cells), done=len(cells) - len(missing)) as tell:
        for row in run_tasks(missing, jobs=jobs, scheduler=scheduler):
            store.add(row)
            tell()


def tasks_of(
    cells: Sequence[Work], *, robot: str, overrides: tuple[str, ...]
) -> list[Task]:
    """Check cells and return them with all that their runs need.

    Raises:
        FileFormatError: a value does not fit its scenario.
    """
    groups = {cell.group: cell for cell in cells}
    inputs = {
        group: inputs_fingerprint(cell.plan(robot=robot, overrides=overrides))
        for group, cell in groups.items()
    }
    return [Task(cell, robot, overrides, inputs[cell.group]) for cell in cells]


def run_tasks(
    tasks: Sequence[Task], *, jobs: int = 0, scheduler: str | None = None
) -> Iterator[Row]:
    """Run tasks in parallel; yields each row when it is done.

    Args:
        tasks: what to run.
        jobs: processes; 0 for one per processor, 1 for this one.
        scheduler: address of a Dask scheduler, whose workers run them instead.
    """
    from joblib import Parallel, delayed, parallel_config

    if scheduler is not None:
        from surefoot.studies.cluster import run_on_cluster

        yield from run_on_cluster(tasks, scheduler)
        return
    workers = parallel_config(
        backend="loky",
        idle_worker_timeout=IDLE_S,
        initializer=end_with,
        initargs=(os.getpid(),),
    )
    with workers:
        work = Parallel(
            n_jobs=jobs or os.cpu_count() or 1,
            return_as="generator_unordered",
            batch_size=1,
        )
        yield from work(delayed(Task.run)(task) for task in tasks)
