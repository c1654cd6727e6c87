"""Runs the cells of a study: in processes of this machine, or on a cluster.

Names and settings are sent to the workers; code and files are not. Each worker reports
its code, packages and files, and is refused by name if they differ from those here.
"""

from __future__ import annotations

import asyncio
import logging
import os
import re
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

from surefoot.errors import EnvironmentFailedError, SurefootError, UsageError
from surefoot.installation import lacking
from surefoot.presentation import CountBar, no_bar
from surefoot.stabilizer.factory import check_read
from surefoot.studies.cell import Row, Work
from surefoot.studies.store import (
    StudyStore,
    Task,
    about_code,
    code_fingerprint,
    inputs_fingerprint,
)

_ADDRESS = re.compile(r"(tcp|tls|wss?)://\S+:\d+")
_CONNECT_S = 10.0
"""Time for the scheduler, and then for its first worker, to answer [s]."""
IDLE_S = 10
"""Idle time after which a worker ends [s]."""
LOOK_S = 0.5


def run_on_cluster(tasks: Sequence[Task], scheduler: str) -> Iterator[Row]:
    """Run tasks on all workers, also on those that join later.

    If a worker is lost, another worker repeats its run from the beginning.

    Args:
        tasks: the runs.
        scheduler: its address, such as ``tcp://head:8786``.

    Yields:
        The row of each task, in the order in which they finish.

    Raises:
        EnvironmentFailedError: no scheduler or no worker answers, or the scheduler
            is lost.
        UsageError: a worker has other code, packages or files.
        SurefootError: one run ended every worker on which it was tried.
    """
    from distributed import as_completed
    from distributed.client import FutureCancelledError
    from distributed.scheduler import KilledWorker

    with _client(scheduler) as client:
        kinds = sorted({type(task.cell).__module__ for task in tasks})
        about = about_work(kinds)
        check_workers(client, kinds, about)
        futures = client.map(run_checked, tasks, about=about, pure=False, key="run")
        try:
            for future in as_completed(futures, loop=client.loop):
                yield future.result()
        except KilledWorker as error:
            raise SurefootError(
                f"--scheduler {scheduler}: a run ended each worker that it was tried "
                "on; look into the log of the worker named last, "
                f"{error.last_worker.address}, and at its memory"
            ) from error
        except FutureCancelledError as error:
            raise EnvironmentFailedError(
                f"--scheduler {scheduler}: the scheduler was lost; what was finished "
                "is kept. Start it again, then this command"
            ) from error
        finally:
            client.cancel(futures)


def about_work(kinds: Sequence[str]) -> dict[str, str]:
    """Return fingerprints and versions of the code and packages here, by name.

    Args:
        kinds: modules that implement each kind of run.
    """
    return {**about_code(), **{kind: code_fingerprint(kind) for kind in kinds}}


def check_workers(client: Any, kinds: Sequence[str], about: Mapping[str, str]) -> None:
    """Refuse workers with other code or packages, before anything is run.

    Raises:
        EnvironmentFailedError: there is no worker.
        UsageError: one has other code or packages, or lacks surefoot.
    """
    try:
        client.wait_for_workers(1, timeout=_CONNECT_S)
    except TimeoutError as error:
        raise EnvironmentFailedError(
            f"--scheduler {client.scheduler.address}: has no workers; start some: "
            f"dask worker {client.scheduler.address} --nthreads 1"
        ) from error
    answers: dict[str, Any] = client.run(about_work, kinds, on_error="return")
    for address, answer in answers.items():
        if isinstance(answer, BaseException):
            raise UsageError(
                f"worker {address}: cannot load surefoot ({answer}); install it there"
            )
        _compare(answer, about, address)


def run_checked(task: Task, *, about: Mapping[str, str]) -> Row:
    """Run a task on a worker, unless its code, packages or files are others.

    Raises:
        UsageError: the worker has other code, packages or files.
    """
    from distributed import get_worker

    here = about_work([type(task.cell).__module__])
    _compare(here, {name: about[name] for name in here}, get_worker().address)
    return task.run()


def _compare(there: Mapping[str, str], here: Mapping[str, str], address: str) -> None:
    differing = [
        f"{name} {_short(there.get(name, 'missing'))} instead of {_short(value)}"
        for name, value in here.items()
        if there.get(name) != value
    ]
    if differing:
        raise UsageError(
            f"worker {address}: has {', '.join(differing)}; its runs would not be "
            "those of this machine. Install the same there, and start it anew"
        )


def _short(value: str) -> str:
    """The beginning of a digest; enough to tell two apart."""
    return value[:12]


def check_address(scheduler: str) -> None:
    """Check the form of a scheduler's address.

    Raises:
        UsageError: it is not an address.
    """
    if not _ADDRESS.fullmatch(scheduler):
        raise UsageError(
            f"--scheduler {scheduler!r}: expected the address of a Dask scheduler, "
            "such as tcp://head:8786, as `dask scheduler` says it"
        )


@contextmanager
def _client(scheduler: str) -> Iterator[Any]:
    if words := lacking("--scheduler (Dask)", "distributed", extra="cluster"):
        raise EnvironmentFailedError(words)
    from distributed import Client

    check_address(scheduler)
    try:
        with ThreadPoolExecutor(1) as beside:  # a notebook's own loop is running here
            beside.submit(asyncio.run, _greet(scheduler)).result()
        client = Client(scheduler, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError, KeyError) as error:
        why = str(error) or f"nothing within {_CONNECT_S:g} s"
        raise EnvironmentFailedError(
            f"--scheduler {scheduler}: no Dask scheduler answers there ({why}); start "
            "one with `dask scheduler`, and give the address that it says, such as "
            "tcp://head:8786"
        ) from error
    # Its tracebacks add nothing to the errors above.
    log = logging.getLogger("distributed.client")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        with client:
            yield client
    finally:
        log.setLevel(level)


async def _greet(address: str) -> None:
    """Ask who answers: a client waits for ever for what is no scheduler.

    Raises:
        OSError: nobody answers in time.
        TypeError: the address needs certificates that Dask's configuration lacks.
        ValueError: what answers is no scheduler.
    """
    from distributed.core import rpc
    from distributed.security import Security

    certificates = Security().get_connection_args("client")
    async with rpc(address, connection_args=certificates) as remote:
        told = await asyncio.wait_for(remote.identity(), _CONNECT_S)
    if told["type"] != "Scheduler":
        raise ValueError(f"a Dask {told['type'].lower()} does")


def end_with(parent: int) -> None:
    """End this process once its parent is gone, even in the middle of a run.

    Its results would reach nobody. And a parent that dies with a lock of its workers
    would leave the waiting ones waiting forever.

    Args:
        parent: id of the parent process.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK_S)  # no event tells of a parent's death
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
) -> list[Row]:
    """Do every run that is not in the store yet, and store each when done.

    Args:
        cells: all runs of the study.
        store: store of the study; it is written once all cells are checked.
        robot: shipped robot or a robot file.
        overrides: settings for all, ``section.name=value``.
        jobs: processes; 0 for one per processor.
        scheduler: address of a Dask scheduler, whose workers run them instead.
        title: for the progress bar.
        bar: shows how many runs are done.

    Returns:
        The row of each cell, in their order.

    Raises:
        FileFormatError: a value does not fit its scenario, or no controller reads a
            setting; nothing has been run.
        UsageError: stored runs are of another scenario, robot or settings, or a run is
            given twice and would count as two.
    """
    _check_once(cells)
    if scheduler is not None:
        check_address(scheduler)
    tasks = tasks_of(cells, robot=robot, overrides=overrides)
    for task in tasks:
        store.check(task)
    store.begin()
    missing = [task for task in tasks if task.cell.key not in store.rows]
    with bar(title, total=len(cells), done=len(cells) - len(missing)) as tell:
        for row in run_tasks(missing, jobs=jobs, scheduler=scheduler):
            store.add(row)
            tell()
    return [store.rows[cell.key] for cell in cells]


def _check_once(cells: Sequence[Work]) -> None:
    seen: set[str] = set()
    for cell in cells:
        if cell.key in seen:
            raise UsageError(
                f"{cell.case}: the same run is asked for twice; name every scenario, "
                "value, controller, servo profile and seed once"
            )
        seen.add(cell.key)


def tasks_of(
    cells: Sequence[Work], *, robot: str, overrides: tuple[str, ...]
) -> list[Task]:
    """Check cells and return them with all inputs of their runs.

    Raises:
        FileFormatError: a value does not fit its scenario, or no controller reads a
            setting.
    """
    groups = {cell.group: cell for cell in cells}
    plans = {
        group: cell.plan(robot=robot, overrides=overrides)
        for group, cell in groups.items()
    }
    check_read(overrides, {plan.controller for plan in plans.values()})
    inputs = {group: inputs_fingerprint(plan) for group, plan in plans.items()}
    return [Task(cell, robot, overrides, inputs[cell.group]) for cell in cells]


def run_tasks(
    tasks: Sequence[Task], *, jobs: int = 0, scheduler: str | None = None
) -> Iterator[Row]:
    """Run tasks in parallel; yield each row when it is done.

    Args:
        tasks: the runs.
        jobs: processes; 0 for one per processor, 1 for this one.
        scheduler: address of a Dask scheduler, whose workers run them instead.
    """
    from joblib import Parallel, delayed, parallel_config

    if scheduler is not None:
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
