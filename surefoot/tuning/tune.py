"""A search of settings as one call, with its outcome in a folder.

``surefoot tune`` and notebooks use it.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory

from surefoot.errors import EnvironmentFailedError, TuneInterrupted, UsageError
from surefoot.installation import install_command
from surefoot.out_folder import make_out_folder, undone_on_error
from surefoot.presentation import CountBar, no_bar
from surefoot.processes.child import Child, Event, Exit, Progress, failure
from surefoot.robot_io.robot import Robot
from surefoot.run_plan import Settings
from surefoot.studies.cell import Row, name_of, names_of, seeds_of
from surefoot.studies.execute import check_address, run_tasks

try:
    from surefoot.tuning.ask import Params, Sampler, Spec, held_out_cells, make_spec
    from surefoot.tuning.objectives import TuneCell
    from surefoot.tuning.outcome import Candidate, Tuned, choose, compare
    from surefoot.tuning.page import OUTCOME, read_spec, write_outcome
    from surefoot.tuning.trials import (
        MOST_LOSSES,
        PLACE,
        ROWS,
        STOPPED,
        Trials,
        workers_folder,
    )
except ModuleNotFoundError as missing:
    if missing.name != "optuna":
        raise
    raise EnvironmentFailedError(
        f"tune needs Optuna: {install_command('tune')}"
    ) from missing

_LOG = logging.getLogger("surefoot.tune")
JOURNAL = "trials.journal"


def tune(
    scenarios: str | Path | Sequence[str | Path],
    params: Params,
    *,
    trials: int = 100,
    workers: int = 0,
    storage: str | Path | None = None,
    out: str | Path = "out/tune",
    objectives: Sequence[str] = ("com", "force"),
    seeds: int | Iterable[int] = 1,
    held_out: Sequence[str | Path] = (),
    held_out_seeds: Iterable[int] | None = None,
    controller: str = "whole-body",
    settings: Settings = None,
    overrides: Sequence[str] = (),
    robot: str | Path | Robot = "walker",
    servo_profile: str | None = None,
    sampler: Sampler = "tpe",
    sampler_seed: int = 0,
    scheduler: str | None = None,
    bar: CountBar = no_bar,
) -> Tuned:
    """Search settings that keep the robot up and minimise figures of its runs.

    Workers are separate processes that take trials from one journal. Workers and this
    process may be killed: another call resumes the search. Two calls at the same time
    with the same arguments share the work.

    Args:
        scenarios: shipped names or paths of the scenarios of all trials.
        params: parameters to search; see :data:`Params`.
        trials: number of trials, including those of former calls.
        workers: processes; 0 for one per processor.
        storage: the journal; ``trials.journal`` in ``out`` when None.
        out: folder for settings, page and figures.
        objectives: of ``com``, ``com-max``, ``force``, ``peak``, ``tilt``, ``dcm``,
            ``effort``, ``score``, ``margin``.
        seeds: number of seeds of the sensor noise, from 0 on, or a list of seeds.
        held_out: scenarios only for start and chosen trial, run at the end; those of
            the search with other seeds if none is given.
        held_out_seeds: their seeds; None: as many as ``seeds``, the next ones.
        controller: name or variant, as for :func:`surefoot.study`.
        settings: settings at the start; the controller's own when None.
        overrides: further settings as texts ``section.name=value``.
        robot: shipped name or path of a robot file, or a robot loaded from one.
        servo_profile: of the robot file; its own choice when None.
        sampler: ``tpe`` or ``nsga2``.
        sampler_seed: with one worker, the same seed makes the same search.
        scheduler: address of a Dask scheduler whose workers do the runs.
        bar: shows how many trials are done.

    Raises:
        TuneInterrupted: Ctrl-C; folder and error hold the outcome so far.
        UsageError: a name, a range or a folder cannot be used.
        FileFormatError: a file or a setting is malformed.
        ChildFailedError: a worker failed; killed workers do not count.
    """
    folder = Path(out)
    journal = folder / JOURNAL if storage is None else Path(storage)
    if trials < 1 or workers < 0:
        raise UsageError(
            f"got {trials} trials and {workers} workers, expected 1 or more trials, "
            "and 0 workers (one per processor) or more"
        )
    if scheduler is not None:
        check_address(scheduler)
    place = name_of(robot, "robot")
    if isinstance(robot, Robot) and servo_profile is None:
        servo_profile = robot.file.servo.profile
    spec = make_spec(
        names_of(scenarios, "scenario"),
        params,
        objectives=list(objectives),
        seeds=list(seeds_of(seeds)),
        controller=controller,
        settings=settings,
        overrides=overrides,
        robot=place,
        servo_profile=servo_profile,
        sampler=sampler,
        sampler_seed=sampler_seed,
    )
    unseen = held_out_cells(spec, names_of(held_out, "scenario"), held_out_seeds)
    with undone_on_error() as making:
        making(folder)
        making(workers_folder(journal))
        _claim(folder, journal, spec)
        tries = Trials(journal, spec)
    processes = workers or os.cpu_count() or 1
    runs: tuple[list[Row], list[Row]] = ([], [])
    interrupt: KeyboardInterrupt | None = None
    try:
        run_workers(
            journal, processes, tries, total=trials, scheduler=scheduler, bar=bar
        )
        while missing := tries.missing(trials):
            _LOG.warning(
                "another command has %d of the trials under way; waiting for it",
                len(missing),
            )
            tries.wait_for_others(trials)
            run_workers(
                journal, processes, tries, total=trials, scheduler=scheduler, bar=bar
            )
        best = _conclude(tries)
        if best is not None:
            runs = _held_out_runs(
                best, unseen, jobs=processes, scheduler=scheduler, bar=bar
            )
    except KeyboardInterrupt as error:
        interrupt, runs = error, ([], [])
    tuned = _conclude(tries, *runs)
    if tuned is not None:
        write_outcome(folder, tuned, tries.study)
    if interrupt is not None:
        raise TuneInterrupted(tuned) from interrupt
    assert tuned is not None
    return tuned


def run_workers(
    journal: Path,
    count: int,
    trials: Trials,
    *,
    total: int,
    scheduler: str | None,
    bar: CountBar,
) -> None:
    """Run workers until the journal is done; replace killed ones.

    Raises:
        ChildFailedError: one failed; the others are ended, and the next call begins
            their trials anew.
    """
    events: SimpleQueue[Event] = SimpleQueue()
    missing = len(trials.missing(total))
    arguments = [str(journal.resolve()), "--trials", str(total)]
    if scheduler is not None:
        arguments += ["--scheduler", scheduler]
    with (
        TemporaryDirectory(prefix="surefoot-") as logs,
        bar("search", total=total, done=total - missing, of="trials") as tell,
    ):

        def start(number: int) -> Child:
            return Child(
                f"worker {number}",
                arguments,
                log=Path(logs) / f"{number}.log",
                events=events,
                module="surefoot.tuning.trials",
            )

        alive = [start(number) for number in range(1, min(count, missing) + 1)]
        losses = 0
        try:
            while alive:
                event = events.get()
                if isinstance(event, Progress):
                    tell()
                    losses = 0
                if not isinstance(event, Exit):
                    continue
                child, code = event.child, event.code
                alive.remove(child)
                child.stop()
                losses += code < 0
                if code > 0 or losses > MOST_LOSSES * count:
                    raise failure(child, code)
                if code < 0:
                    _LOG.warning(
                        "%s was ended by signal %d; its trial begins anew",
                        child.name,
                        -code,
                    )
                    alive.append(start(int(child.name.split()[1])))
        finally:
            for child in alive:
                child.ask_to_end()
            for child in alive:
                child.stop()


def _held_out_runs(
    best: Tuned,
    cells: Sequence[TuneCell],
    *,
    jobs: int,
    scheduler: str | None,
    bar: CountBar,
) -> tuple[list[Row], list[Row]]:
    """Run start and chosen trial on the held-out cases."""
    spec = best.spec
    sides = [best.start.values, best.chosen.values]
    tasks = [spec.task(cell, values) for values in sides for cell in cells]
    if best.chosen is best.start:
        tasks = tasks[: len(cells)]
    rows: list[Row] = []
    with bar("held-out", total=len(tasks), done=0) as tell:
        for row in run_tasks(tasks, jobs=jobs, scheduler=scheduler):
            rows.append(row)
            tell()
    of_start = {task.inputs for task in tasks[: len(cells)]}
    before = [row for row in rows if row["inputs"] in of_start]
    after = [row for row in rows if row["inputs"] not in of_start]
    return before, after or before


def _conclude(
    trials: Trials, before: Sequence[Row] = (), after: Sequence[Row] = ()
) -> Tuned | None:
    """Summarise the finished trials; None while the start is not among them."""
    spec = trials.spec
    found = [
        Candidate(
            place=int(trial.user_attrs[PLACE]),
            values=spec.used(trial.params),
            rows=trial.user_attrs[ROWS],
            stopped=trial.user_attrs[STOPPED],
            figures=list(trial.values),
        )
        for trial in trials.finished()
    ]
    if not found or found[0].place != 0:
        return None
    front, chosen = choose(spec, found)
    start = found[0]
    trained = {row["log_sha256"] for row in (*start.rows, *chosen.rows)}
    found_again = [r for r in (*before, *after) if r["log_sha256"] in trained]
    seen = list(dict.fromkeys(str(row["scenario"]) for row in found_again))
    old, new = (
        [r for r in rows if r["scenario"] not in seen] for rows in (before, after)
    )
    return Tuned(
        spec=spec,
        candidates=found,
        front=front,
        start=start,
        chosen=chosen,
        training=compare(start.rows, chosen.rows, spec.figures),
        held_out=compare(old, new, spec.figures),
        seen=seen,
    )


def _claim(folder: Path, journal: Path, spec: Spec) -> None:
    """Check that the folder is new, or that of the same search."""
    is_journal_in_it = journal.parent == folder and journal.is_file()
    known = (folder / OUTCOME).is_file() or is_journal_in_it
    if folder.is_dir() and any(folder.iterdir()) and not known:
        raise UsageError(f"--out {folder}: holds something else; name another folder")
    if (former := read_spec(folder)) is not None:
        former.check_same(spec, place=f"--out {folder}")
    make_out_folder(folder, out=folder)
    make_out_folder(journal.parent, out=journal, option="--storage")
