"""The journal of a search, and a worker: ``python -m surefoot.tuning.trials JOURNAL``.

Several processes take trials from the journal, one each, and finish them. Every process
may be killed at any moment: complete lines stay, and the next writer removes an
incomplete one. An unfinished trial of a killed worker is begun anew with the same
values. To show that it lives, a worker holds a lock on its own file; the system frees
the lock with the process. Trials are places, numbered from 0 on; each is finished once.

A worker takes trials until there are none. It writes a line to its standard output for
each trial that it has finished.
"""

from __future__ import annotations

import argparse
import fcntl
import json
import os
import sys
import uuid
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import msgspec
import optuna
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, Trial, TrialState

from surefoot.errors import (
    ERROR_PREFIX,
    EnvironmentFailedError,
    UsageError,
    exit_code_of,
)
from surefoot.out_folder import make_out_folder
from surefoot.processes.child import begin_as_child
from surefoot.schemas.errors import FileFormatError
from surefoot.studies.cell import Row
from surefoot.studies.execute import run_tasks
from surefoot.studies.store import Task
from surefoot.tuning.ask import Spec
from surefoot.tuning.objectives import (
    BEYOND,
    UNWALKED,
    is_beaten,
    mean_figures,
    succeeded,
)

STUDY = "surefoot-tune"
SPEC, PLACE, WORKER = "spec", "place", "worker"
MOST_LOSSES = 3
"""Number of lost trials after which a place gets other values: the values may be what
ends the process."""
_TAIL_BYTES = 4096
ROWS, STOPPED, DOWN = "rows", "stopped", "down"
"""Attributes of a trial: its runs, why some are missing, and its constraint."""
REFUSED = 2.0
"""Constraint of values that contradict each other: worse than that of any fall."""


class JournalLock:
    """Lock of the journal; it ends with its process, even if that is killed."""

    def __init__(self, path: Path) -> None:
        """Name the file; the storage makes it."""
        self._path = path
        self._file = -1

    def acquire(self) -> bool:
        """Wait for the lock; then remove an incomplete last line."""
        self._file = os.open(self._path, os.O_RDWR)
        fcntl.flock(self._file, fcntl.LOCK_EX)
        end = whole = os.fstat(self._file).st_size
        while whole and os.pread(self._file, 1, whole - 1) != b"\n":
            begin = max(0, whole - _TAIL_BYTES)
            tail = os.pread(self._file, whole - begin, begin)
            whole = begin + tail.rfind(b"\n") + 1
        if whole != end:
            os.ftruncate(self._file, whole)
        return True

    def release(self) -> None:
        """Free the lock."""
        os.close(self._file)


def workers_folder(journal: Path) -> Path:
    """Return the folder of the workers' locks, beside a journal."""
    return journal.with_name(f"{journal.name}.workers")


class Trials:
    """A search's trials on disk.

    Attributes:
        spec: specification of the search.
        study: Optuna's view of the trials.
    """

    def __init__(self, path: Path, spec: Spec | None = None) -> None:
        """Open a journal, or begin one.

        Args:
            path: path of the journal; other processes of the search may have it open.
            spec: specification of the search; None: the journal's.

        Raises:
            UsageError: the file is not a journal, or that of another search.
            EnvironmentFailedError: the file cannot be read or written.
        """
        self._folder = workers_folder(path)
        if spec is None and not path.is_file():
            raise UsageError(f"--storage {path}: no such file")
        make_out_folder(self._folder, out=path, option="--storage")
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        warnings.filterwarnings("ignore", module="optuna")
        with _held(self._folder):
            self.study = _open(path, spec)
            told = self.study.user_attrs.get(SPEC)
            if spec is not None and told is None:
                self.study.set_user_attr(SPEC, msgspec.to_builtins(spec))
                told = msgspec.to_builtins(spec)
        if told is None:
            raise UsageError(f"--storage {path}: no search of surefoot; name another")
        try:
            self.spec = msgspec.convert(told, Spec)
        except msgspec.ValidationError as error:
            raise UsageError(
                f"--storage {path}: holds a search of another version of surefoot "
                f"({error}); name a new file"
            ) from error
        if spec is not None:
            self.spec.check_same(spec, place=f"--storage {path}")

    @contextmanager
    def worker(self) -> Iterator[str]:
        """Register as a worker; yield its name, which begins with the process id."""
        name = f"{os.getpid()}-{uuid.uuid4().hex[:8]}"
        file = self._folder / name
        with ExitStack() as stack:
            with _held(self._folder):
                stack.enter_context(_held(file))
            yield name
            file.unlink()

    def claim(self, worker: str, *, count: int) -> tuple[Trial, dict[str, Any]] | None:
        """Take the first free place.

        Args:
            worker: name of the worker that takes it.
            count: number of places.

        Returns:
            The trial, and its values by the parameters' names. None if no place is
            free.
        """
        with _held(self._folder):
            self._end_lost()
            trials = self._all()
            waiting = [t for t in trials if t.state is TrialState.WAITING]
            if waiting:
                place = int(waiting[0].user_attrs[PLACE])
            else:
                taken = {
                    t.user_attrs[PLACE]
                    for t in trials
                    if t.state is not TrialState.FAIL
                }
                free = next((p for p in range(count) if p not in taken), None)
                if free is None:
                    return None
                place = free
                self._enqueue(place)
            # Each place has its own random generator: several workers draw nothing
            # twice, and a search that was interrupted goes on as if it had not been.
            lost = sum(
                t.state is TrialState.FAIL and t.user_attrs[PLACE] == place
                for t in trials
            )
            self.study.sampler = self.spec.make_sampler(place, lost // MOST_LOSSES)
            trial = self.study.ask()
            trial.set_user_attr(WORKER, worker)
            return trial, self.spec.propose(trial)

    def finished(self) -> list[FrozenTrial]:
        """Return finished trials, by their place."""
        done = [t for t in self._all() if t.state is TrialState.COMPLETE]
        return sorted(done, key=lambda t: int(t.user_attrs[PLACE]))

    def missing(self, count: int) -> list[int]:
        """Return the unfinished places among the first ``count``."""
        done = {int(trial.user_attrs[PLACE]) for trial in self.finished()}
        return [place for place in range(count) if place not in done]

    def wait_for_others(self, count: int) -> None:
        """Wait for the end of the workers that hold any of the ``count`` places."""
        missing = self.missing(count)
        names = {
            str(trial.user_attrs.get(WORKER, ""))
            for trial in self._all()
            if trial.state is TrialState.RUNNING and trial.user_attrs[PLACE] in missing
        }
        for name in names - {""}:
            file = self._folder / name
            if file.is_file():  # else it has ended; a new file would do no harm
                with _held(file):
                    pass

    def _all(self) -> list[FrozenTrial]:
        return self.study.get_trials(deepcopy=False)

    def _end_lost(self) -> None:
        """Fail the trials of workers that are gone: this frees their places."""
        for file in self._folder.iterdir():
            with suppress(BlockingIOError), _held(file, wait=False):
                file.unlink()
        for trial in self._all():
            # Without a name: its process was killed before it could write it.
            name = trial.user_attrs.get(WORKER, "nobody")
            if (
                trial.state is TrialState.RUNNING
                and not (self._folder / name).is_file()
            ):
                self.study.tell(trial.number, state=TrialState.FAIL)

    def _enqueue(self, place: int) -> None:
        lost = [t for t in self._all() if t.user_attrs[PLACE] == place]
        values: dict[str, Any] = {}
        if lost and len(lost) % MOST_LOSSES:
            values = lost[-1].params or lost[-1].system_attrs["fixed_params"]
        elif place == 0 and not lost:
            values = dict(self.spec.start)
        self.study.enqueue_trial(values, user_attrs={PLACE: place})


def _open(path: Path, spec: Spec | None) -> optuna.Study:
    try:
        _check_journal(path)
        backend = JournalFileBackend(
            str(path),
            lock_obj=JournalLock(path),  # type: ignore[arg-type]
        )
        storage = optuna.storages.JournalStorage(backend)
        if spec is None:
            return optuna.load_study(study_name=STUDY, storage=storage)
        return optuna.create_study(
            storage=storage,
            study_name=STUDY,
            directions=["minimize"] * len(spec.objectives),
            load_if_exists=True,
        )
    except OSError as error:
        raise EnvironmentFailedError(
            f"--storage {path}: {error.strerror or error}; name a file in a folder "
            "that can be written to"
        ) from error
    except UsageError:
        raise
    except (ValueError, KeyError) as error:
        raise UsageError(
            f"--storage {path}: no journal of a search; name a new file"
        ) from error


def _check_journal(path: Path) -> None:
    """Check the lines: opening a file of another kind would write into it.

    Raises:
        ValueError: the first line is not that of a journal.
        UsageError: another complete line is damaged.
    """
    if not path.exists():
        return
    if not path.is_file():
        raise ValueError(path)
    with path.open("rb") as file:
        head = file.readline(_TAIL_BYTES)
        if head and msgspec.json.decode(head, type=_Head).study_name != STUDY:
            raise ValueError(path)
        for number, line in enumerate(file, start=2):
            try:
                json.loads(line)  # Optuna writes NaN, which msgspec does not read
            except ValueError as error:
                if line.endswith(b"\n"):
                    raise UsageError(
                        f"--storage {path}, line {number}: is damaged, and later lines "
                        "count on it; put the file back as it was, or name a new one"
                    ) from error


class _Head(msgspec.Struct):
    """Content of the first line of a journal."""

    study_name: str


@contextmanager
def _held(path: Path, *, wait: bool = True) -> Iterator[None]:
    """Hold the lock on a file or folder; it ends with this process at the latest.

    Raises:
        BlockingIOError: another process holds it, and ``wait`` is False.
    """
    flags = os.O_RDONLY if path.is_dir() else os.O_RDWR | os.O_CREAT
    file = os.open(path, flags)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        yield
    finally:
        os.close(file)


def work(
    trials: Trials,
    *,
    count: int,
    scheduler: str | None,
    on_trial: Callable[[], None],
) -> None:
    """Do trials until no place is free.

    Args:
        trials: trials of the search.
        count: number of trials of all workers together.
        scheduler: address of the Dask cluster that does the runs; None to do them here.
        on_trial: called after each trial.
    """
    finished: list[list[Row]] = []
    with trials.worker() as name:
        while (claimed := trials.claim(name, count=count)) is not None:
            trial, values = claimed
            trials.spec.check_unchanged()
            finished = [
                done.user_attrs[ROWS]
                for done in trials.finished()
                if not done.user_attrs[STOPPED]
            ]
            rows, why, down = evaluate(trials, values, finished, scheduler=scheduler)
            figures = trials.spec.figures
            trials.spec.check_unchanged()  # each run reads its scenario again
            trial.set_user_attr(ROWS, rows)
            trial.set_user_attr(STOPPED, why)
            trial.set_constraint(DOWN, down)
            means = mean_figures(rows, figures) if rows else [BEYOND] * len(figures)
            # Once this line is written the trial is finished, whatever happens.
            trials.study.tell(trial, means)
            on_trial()


def evaluate(
    trials: Trials,
    values: dict[str, Any],
    finished: Sequence[Sequence[Row]],
    *,
    scheduler: str | None,
) -> tuple[list[Row], str, float]:
    """Run a trial seed by seed, until one run fails or the trial is clearly worse.

    Args:
        trials: trials of the search.
        values: values of this trial.
        finished: runs of each trial that was run to the end and stood.
        scheduler: see :func:`work`.

    Returns:
        Its runs; why some are missing, or ""; and its constraint: 0 if none fell, the
        share of runs from the first fall on, or ``REFUSED`` for contradicting values.
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
            if not succeeded(row):
                what = row.get(UNWALKED, row["outcome"])
                why = f"{row['scenario']}, seed {row['seed']}: {what}"
                return rows, why, (count - len(rows) + 1) / count
        beaten = any(is_beaten(rows, other, spec.figures) for other in finished)
        if beaten and number < len(rounds):
            return rows, "worse in each run than another trial", 0.0
    return rows, "", 0.0


def _in_order(tasks: list[Task], *, scheduler: str | None) -> Iterable[Row]:
    """Rows in the order of their tasks; without a scheduler each is run on demand."""
    if scheduler is None:
        return map(Task.run, tasks)
    order = {task.cell.key: index for index, task in enumerate(tasks)}
    rows = run_tasks(tasks, scheduler=scheduler)
    return sorted(rows, key=lambda row: order[row["key"]])


def main() -> int:
    """Work on a journal until nothing is left to do."""
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
