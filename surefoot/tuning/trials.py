"""The journal of a search: trials that several processes take, one each, and finish.

Every process may be killed at any moment. What it wrote whole stands; half a line is
taken off by the next who writes. A trial that its worker did not finish is begun anew
with the same values: a worker holds a lock on a file of its own for as long as it
lives, which the system lets go of with the process. Trials are places, numbered from
0 on, of which each is finished once.
"""

from __future__ import annotations

import fcntl
import os
import uuid
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import msgspec
import optuna
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, Trial, TrialState

from surefoot.errors import EnvironmentFailedError, UsageError
from surefoot.out_folder import make_out_folder
from surefoot.tuning.ask import Spec

STUDY = "surefoot-tune"
SPEC, PLACE, WORKER = "spec", "place", "worker"
MOST_LOSSES = 3
"""Times a trial is begun anew; then its place gets other values: they may be what
ends the process."""
_TAIL_BYTES = 4096


class JournalLock:
    """Lock of the journal that a killed process cannot leave behind."""

    def __init__(self, path: Path) -> None:
        """Say which file; it is made by the storage."""
        self._path = path
        self._file = -1

    def acquire(self) -> bool:
        """Wait for the lock; then take off half a line that somebody left."""
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
        """Let go of it."""
        os.close(self._file)


class Trials:
    """A search's trials on disk.

    Attributes:
        spec: what is searched, and how.
        study: Optuna's view of them.
    """

    def __init__(self, path: Path, spec: Spec | None = None) -> None:
        """Open a journal, or begin one.

        Args:
            path: of the journal; others of the search may have it open.
            spec: what is to be searched; None for what the journal says.

        Raises:
            UsageError: it is no journal, or that of another search.
            EnvironmentFailedError: it cannot be read or written.
        """
        self._folder = path.with_name(f"{path.name}.workers")
        if spec is None and not path.is_file():
            raise UsageError(f"--storage {path}: no such file")
        make_out_folder(self._folder, out=path)
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
        self.spec = msgspec.convert(told, Spec)
        if spec is not None:
            self.spec.check_same(spec, path)

    @contextmanager
    def worker(self) -> Iterator[str]:
        """Be one of the workers; yields its name, which begins with the process id."""
        name = f"{os.getpid()}-{uuid.uuid4().hex[:8]}"
        file = self._folder / name
        with ExitStack() as stack:
            with _held(self._folder):
                stack.enter_context(_held(file))
            yield name
            file.unlink()

    def claim(self, worker: str, *, count: int) -> tuple[Trial, dict[str, Any]] | None:
        """Take the first place that nobody has.

        Args:
            worker: who takes it.
            count: how many places there are.

        Returns:
            The trial, and its values by the names of the parameters. None when all are
            taken.
        """
        with _held(self._folder):
            self._end_lost()
            trials = self._all()
            if all(t.state is not TrialState.WAITING for t in trials):
                taken = {t.user_attrs[PLACE] for t in trials if not _is_lost(t)}
                place = next((p for p in range(count) if p not in taken), None)
                if place is None:
                    return None
                self._enqueue(place)
            # Each trial has a random generator of its own, so that a search gone on
            # with, or by several workers, draws nothing twice.
            self.study.sampler = self.spec.make_sampler(len(trials))
            trial = self.study.ask()
            trial.set_user_attr(WORKER, worker)
            return trial, {p.name: p.suggest(trial) for p in self.spec.parameters}

    def finished(self) -> list[FrozenTrial]:
        """Return finished trials, by their place."""
        done = [t for t in self._all() if t.state is TrialState.COMPLETE]
        return sorted(done, key=lambda t: int(t.user_attrs[PLACE]))

    def _all(self) -> list[FrozenTrial]:
        return self.study.get_trials(deepcopy=False)

    def _end_lost(self) -> None:
        """End trials of workers that are gone; their places are free again."""
        for file in self._folder.iterdir():
            with suppress(BlockingIOError), _held(file, wait=False):
                file.unlink()
        for trial in self._all():
            # One without a worker was taken by a process killed before it could say so.
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


def _is_lost(trial: FrozenTrial) -> bool:
    return trial.state is TrialState.FAIL


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
    except (ValueError, KeyError) as error:
        raise UsageError(
            f"--storage {path}: no journal of a search; name a new file"
        ) from error


def _check_journal(path: Path) -> None:
    """Look at the first line, since opening another file would write into it.

    Raises:
        ValueError: it is not the one that begins a search.
    """
    if not path.is_file():
        return
    with path.open("rb") as file:
        head = file.readline(_TAIL_BYTES)
    if head and msgspec.json.decode(head, type=_Head).study_name != STUDY:
        raise ValueError(path)


class _Head(msgspec.Struct):
    """What the first line of a journal says."""

    study_name: str


@contextmanager
def _held(path: Path, *, wait: bool = True) -> Iterator[None]:
    """Hold the lock on a file or folder, which ends with this process at the latest.

    Raises:
        BlockingIOError: somebody else holds it, and there is no wait.
    """
    flags = os.O_RDONLY if path.is_dir() else os.O_RDWR | os.O_CREAT
    file = os.open(path, flags)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        yield
    finally:
        os.close(file)
