"""A study as one call: scenarios varied over seeds, controllers and servo profiles."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from surefoot.progress import CountBar, no_bar
from surefoot.studies.cell import Cell, Group, Row, find_variant
from surefoot.studies.execute import execute
from surefoot.studies.store import StudyStore
from surefoot.studies.summary import GroupSummary, summarise
from surefoot.studies.tables import markdown_table, write_summary

Values = tuple[tuple[str, Any], ...]


@dataclass(frozen=True)
class Study:
    """Finished runs and what they amount to.

    Attributes:
        rows: one a run: what was run, and its figures.
        summaries: one a group of runs that differ by their seed only.
    """

    rows: list[Row]
    summaries: dict[Group, GroupSummary]

    def table(self) -> str:
        """Return the summaries as a Markdown table."""
        return markdown_table(self.summaries)


def study(
    scenarios: str | Path | Sequence[str | Path],
    *,
    vary: Mapping[str, Sequence[Any]] | None = None,
    controllers: Sequence[str] = ("whole-body",),
    servo_profiles: Sequence[str] = ("ideal",),
    seeds: int | Iterable[int] = 1,
    robot: str | Path = "walker",
    settings: Mapping[str, Any] | None = None,
    jobs: int = 0,
    scheduler: str | None = None,
    out: str | Path | None = None,
    bar: CountBar = no_bar,
) -> Study:
    """Run every combination in parallel processes.

    Args:
        scenarios: shipped names or paths.
        vary: values of scenario keys by path, such as ``{"friction": [0.4, 0.7]}``.
        controllers: ``whole-body``, ``person``, ``paper``, ``zmp-tuned``,
            ``zmp-stock`` or any name as on the command line.
        servo_profiles: of the robot file.
        seeds: how many, from 0 on, or which.
        robot: shipped name or path of a robot file.
        settings: for all runs, such as ``{"tsid.base_kp": 120.0}``.
        jobs: processes; 0 for one per processor.
        scheduler: address of a Dask scheduler, such as ``tcp://head:8786``, whose
            workers run them instead.
        out: a folder that keeps finished runs, so that a study that was ended goes on
            where it was; None keeps nothing on disk.
        bar: shows how many runs are done.

    Raises:
        UsageError: a name is unknown, or the folder holds another study.
        FileFormatError: a value does not fit its scenario; nothing has been run.
    """
    several = [scenarios] if isinstance(scenarios, (str, Path)) else scenarios
    names = [str(scenario) for scenario in several]
    cells = make_cells(
        names,
        combinations=list(
            product(*([(k, v) for v in vs] for k, vs in (vary or {}).items()))
        ),
        controllers=controllers,
        servo_profiles=servo_profiles,
        seeds=range(seeds) if isinstance(seeds, int) else list(seeds),
    )
    overrides = tuple(f"{k}={json.dumps(v)}" for k, v in (settings or {}).items())
    place = (
        tempfile.TemporaryDirectory(prefix="surefoot-")
        if out is None
        else nullcontext(out)
    )
    with place as folder:
        return run_study(
            cells,
            Path(folder),
            robot=str(robot),
            overrides=overrides,
            jobs=jobs,
            scheduler=scheduler,
            bar=bar,
        )


def make_cells(
    scenarios: Sequence[str],
    *,
    combinations: Sequence[Values],
    controllers: Sequence[str],
    servo_profiles: Sequence[str],
    seeds: Sequence[int],
) -> list[Cell]:
    """Return every combination; a whole round of all cases before the next seed.

    Args:
        scenarios: shipped names or paths.
        combinations: values of scenario keys by path, one entry a combination.
        controllers: see :func:`study`.
        servo_profiles: of the robot file.
        seeds: of the sensor noise.

    Raises:
        UsageError: there is no such controller.
    """
    names = [find_variant(name).name for name in controllers]
    groups = [
        Group(scenario, values, variant, profile)
        for scenario in scenarios
        for values in combinations
        for profile in servo_profiles
        for variant in names
    ]
    return [Cell(group, seed) for seed in seeds for group in groups]


def run_study(
    cells: Sequence[Cell],
    folder: Path,
    *,
    robot: str,
    overrides: tuple[str, ...],
    jobs: int,
    scheduler: str | None = None,
    bar: CountBar = no_bar,
) -> Study:
    """Run what a folder does not hold yet, and write its summary.

    Args:
        cells: all runs.
        folder: of finished runs; made if need be.
        robot: shipped name or path of a robot file.
        overrides: settings for all runs, texts ``section.name=value``.
        jobs: processes; 0 for one per processor.
        scheduler: address of a Dask scheduler, such as ``tcp://head:8786``, whose
            workers run them instead.
        bar: shows how many runs are done.
    """
    with StudyStore(folder, about={"robot": robot, "set": list(overrides)}) as store:
        execute(
            cells,
            store,
            robot=robot,
            overrides=overrides,
            jobs=jobs,
            scheduler=scheduler,
            title="runs",
            bar=bar,
        )
        rows = [store.rows[cell.key] for cell in cells]
    made = Study(rows, summarise(rows))
    write_summary(folder, made.summaries)
    return made
