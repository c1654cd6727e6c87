"""A study as one call, and the summary of its runs.

Scenarios are run over seeds, controllers, servo profiles and varied values; ``surefoot
sweep`` and notebooks use it.
"""

from __future__ import annotations

import logging
import math
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import chain, product
from pathlib import Path
from typing import Any

from surefoot.errors import UsageError
from surefoot.presentation import CountBar, no_bar
from surefoot.robot_io.robot import Robot
from surefoot.run_plan import resolve_robot
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.settings import build_settings, setting_names
from surefoot.schemas.toml_file import override_texts, plain
from surefoot.schemas.validation import nearest
from surefoot.stabilizer.factory import check_read
from surefoot.studies.cell import (
    Cell,
    Group,
    Row,
    find_variant,
    group_of,
    hashable,
    in_words,
    name_of,
    names_of,
    seeds_of,
)
from surefoot.studies.execute import execute
from surefoot.studies.store import StudyStore
from surefoot.studies.summaries import (
    Summaries,
    markdown_table,
    summarise,
    write_summary,
)

_LOG = logging.getLogger(__name__)
SETTINGS_ONLY = {name.partition(".")[0] for name in setting_names()} - set(
    Scenario.__struct_fields__
)
"""Sections of settings; no scenario has sections of these names."""
MOST_RUNS = 1_000_000
"""Largest number of runs of a study: a year on one processor; cells fit in memory."""


@dataclass(frozen=True)
class Study:
    """Finished runs and their summaries.

    Attributes:
        rows: one per run: its case and figures.
        summaries: one per group of runs that differ only by their seed.
    """

    rows: list[Row]
    summaries: Summaries

    def __repr__(self) -> str:
        """Return the number of runs; ``table()`` shows their summaries."""
        return f"<Study of {len(self.rows)} runs in {len(self.summaries)} groups>"

    def table(self) -> str:
        """Return the summaries as a Markdown table."""
        return markdown_table(self.summaries)


def study(
    scenarios: str | Path | Sequence[str | Path],
    *,
    vary: Mapping[str, Sequence[Any]] | None = None,
    controllers: str | Sequence[str] = "whole-body",
    servo_profiles: str | Sequence[str] | None = None,
    seeds: int | Iterable[int] = 1,
    robot: str | Path | Robot = "walker",
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
        servo_profiles: of the robot file; its own choice when None.
        seeds: number of seeds, from 0 on, or a list of seeds.
        robot: shipped name or path of a robot file, or a robot loaded from one.
        settings: for all runs, such as ``{"tsid.base_kp": 120.0}``.
        jobs: processes; 0 for one per processor.
        scheduler: address of a Dask scheduler, such as ``tcp://head:8786``, whose
            workers run them instead.
        out: a folder that keeps finished runs, from which an interrupted study is
            resumed; None keeps nothing on disk.
        bar: shows how many runs are done.

    Raises:
        UsageError: a name is unknown or no name, the folder holds another study, or
            the robot's file does not hold the robot.
        FileFormatError: a value does not fit its scenario; nothing has been run.
    """
    place_of_robot = name_of(robot, "robot")
    cells = make_cells(
        names_of(scenarios, "scenario"),
        robot=robot,
        levels=[[(k, v) for v in plain(vs)] for k, vs in (vary or {}).items()],
        controllers=[controllers] if isinstance(controllers, str) else controllers,
        servo_profiles=(
            [servo_profiles] if isinstance(servo_profiles, str) else servo_profiles
        ),
        seeds=seeds_of(seeds),
    )
    overrides = tuple(override_texts(settings or {}))
    place = (
        tempfile.TemporaryDirectory(prefix="surefoot-")
        if out is None
        else nullcontext(out)
    )
    with place as folder:
        return run_study(
            cells,
            Path(folder),
            robot=place_of_robot,
            overrides=overrides,
            jobs=jobs,
            scheduler=scheduler,
            bar=bar,
        )


def make_cells(
    scenarios: Sequence[str],
    *,
    robot: str | Path | Robot,
    levels: Sequence[Sequence[tuple[str, Any]]],
    controllers: Sequence[str],
    servo_profiles: Sequence[str] | None,
    seeds: Sequence[int],
) -> list[Cell]:
    """Return every combination: all cases with one seed, then with the next.

    Args:
        scenarios: shipped names or paths.
        robot: its own servo profile is used unless others are given.
        levels: for each varied scenario key or setting, its path with each of its
            values.
        controllers: see :func:`study`.
        servo_profiles: of the robot file; its own choice when None.
        seeds: of the sensor noise.

    Raises:
        UsageError: there is no such controller, a key is varied twice or to the same
            value, or there are more than ``MOST_RUNS``.
        RobotFileError: there is no such robot.
        FileFormatError: none of the controllers reads a setting that is varied.
    """
    varied = [path for key in levels for path, _ in key[:1]]
    twice = next((path for path in varied if varied.count(path) > 1), None)
    if twice is not None:
        raise UsageError(
            f"{twice}: is varied twice; give all of its values at once, such as "
            f"--vary {twice}=A,B"
        )
    if servo_profiles is None:
        servo_profiles = [resolve_robot(robot, None).file.servo.profile]
    factors = (scenarios, *levels, servo_profiles, controllers, seeds)
    runs = math.prod(map(len, factors))
    if not 0 < runs <= MOST_RUNS:
        raise UsageError(
            f"{runs:.3g} runs: expected 1 to {MOST_RUNS}; give "
            + ("fewer" if runs else "some")
            + " scenarios, values, controllers and seeds"
        )
    given = set[tuple[str, Any]]()
    for path, value in chain.from_iterable(levels):
        level = path, hashable(value)
        try:
            is_given = level in given  # 1 and 1.0 would count as one case
        except TypeError as error:  # a table, or a list of some
            raise UsageError(
                f"--vary {path}: got {value}, expected numbers, texts or lists; vary "
                f"the table's keys, each as {path}.KEY"
            ) from error
        if is_given:
            raise UsageError(
                f"--vary {path}: {in_words(value)} is named twice; name it once"
            )
        given.add(level)
        section, _, name = path.partition(".")
        known = setting_names()
        if section in SETTINGS_ONLY and path not in known:
            raise UsageError(f"--vary {path}: no such setting{nearest(path, known)}")
        if path in known:
            try:
                build_settings({section: {name: value}}, overrides=[], source="--vary")
            except FileFormatError as error:
                if error.field.startswith(path):  # else other settings may allow it
                    raise
    variants = [find_variant(name) for name in controllers]
    check_read(varied, {variant.controller for variant in variants}, option="--vary")
    groups = [
        Group(scenario, hashable(values), variant.name, profile)
        for scenario in scenarios
        for values in product(*levels)
        for profile in servo_profiles
        for variant in variants
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
    """Do the runs that a folder does not hold yet, and write its summary.

    Args:
        cells: all runs.
        folder: folder of finished runs; it is made if missing.
        robot: shipped name or path of a robot file.
        overrides: settings for all runs, texts ``section.name=value``.
        jobs: processes; 0 for one per processor.
        scheduler: address of a Dask scheduler, such as ``tcp://head:8786``, whose
            workers run them instead.
        bar: shows how many runs are done.

    Raises:
        UsageError: a varied setting is among the overrides.
    """
    given = {text.partition("=")[0].strip() for text in overrides}
    twice = given & {name for cell in cells for name, _ in cell.group.values}
    if twice:
        raise UsageError(
            f"--vary {min(twice)}: --set gives it, too; leave one of them out"
        )
    with StudyStore(folder, about={"robot": robot, "set": list(overrides)}) as store:
        rows = execute(
            cells,
            store,
            robot=robot,
            overrides=overrides,
            jobs=jobs,
            scheduler=scheduler,
            title="runs",
            bar=bar,
        )
    made = Study(rows, summarise(rows))
    write_summary(folder, made.summaries)
    found: dict[Group, list[str]] = {}
    for row in rows:
        found.setdefault(group_of(row), []).append(row["log_sha256"])
    same = [group.case for group, runs in found.items() if len(runs) > len(set(runs))]
    if same:
        _LOG.warning(
            "%s%s: seeds give the same run, to the last bit, and count once in the "
            "interval: nothing there depends on a seed; one is enough, or add noise",
            *(same[0], f" and {len(same) - 1} more" if len(same) > 1 else ""),
        )
    return made
