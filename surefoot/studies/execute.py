"""Runs what is missing in a study, in parallel processes."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Sequence

from surefoot.progress import CountBar, no_bar
from surefoot.studies.cell import Work, run_cell
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
    jobs: int,
    title: str,
    bar: CountBar = no_bar,
) -> None:
    """Do every run that the store does not have yet, and keep each when done.

    Args:
        cells: all runs of the study.
        store: open for writing.
        robot: shipped robot or a robot file.
        overrides: settings for all, ``section.name=value``.
        jobs: processes.
        title: for the progress bar.
        bar: shows how many runs are done.

    Raises:
        FileFormatError: a value does not fit its scenario; nothing has been run.
        UsageError: kept runs are of another scenario, robot or settings.
    """
    from joblib import Parallel, delayed, parallel_config

    inputs = {
        group: inputs_fingerprint(cell.plan(robot=robot, overrides=overrides))
        for group, cell in {cell.group: cell for cell in cells}.items()
    }
    for cell in cells:
        store.check(cell, inputs[cell.group])
    missing = [cell for cell in cells if cell.key not in store.rows]
    workers = parallel_config(
        backend="loky",
        idle_worker_timeout=IDLE_S,
        initializer=end_with,
        initargs=(os.getpid(),),
    )
    with (
        workers,
        bar(title, total=len(cells), done=len(cells) - len(missing)) as tell,
    ):
        work = Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)
        for row in work(
            delayed(run_cell)(
                cell, robot=robot, overrides=overrides, inputs=inputs[cell.group]
            )
            for cell in missing
        ):
            store.add(row)
            tell()
