"""Runs of a benchmark: in parallel, kept, each done once."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from surefoot.bench.bench_cell import BenchCell, Under
from surefoot.progress import CountBar
from surefoot.studies.cell import Row, find_variant
from surefoot.studies.execute import execute
from surefoot.studies.fingerprint import code_fingerprint
from surefoot.studies.store import StudyStore

CONTROLLERS = ("whole-body", "zmp-tuned", "zmp-stock")
QUICK_CONTROLLERS = CONTROLLERS[:2]


@dataclass(frozen=True)
class BenchRuns:
    """Does the runs that a folder does not hold yet.

    Attributes:
        store: of finished runs, open for writing.
        robot: shipped name or path of a robot file.
        overrides: settings for all runs, texts ``section.name=value``.
        jobs: processes; 0 for one per processor.
        scheduler: address of a Dask scheduler, whose workers do the runs instead.
        bar: shows how many runs are done.
    """

    store: StudyStore
    robot: str
    overrides: tuple[str, ...]
    jobs: int
    scheduler: str | None
    bar: CountBar

    def rows(self, cells: Sequence[BenchCell], *, title: str) -> list[Row]:
        """Return the row of each cell, in their order.

        Args:
            cells: to be run, or found among those that were.
            title: for the progress bar.
        """
        execute(
            cells,
            self.store,
            robot=self.robot,
            overrides=self.overrides,
            jobs=self.jobs,
            scheduler=self.scheduler,
            title=title,
            bar=self.bar,
        )
        return [self.store.rows[cell.key] for cell in cells]


@contextmanager
def bench_runs(
    name: str,
    *,
    seen_by: str,
    robot: str,
    settings: Mapping[str, Any] | None,
    jobs: int,
    scheduler: str | None,
    out: str | Path | None,
    bar: CountBar,
) -> Iterator[BenchRuns]:
    """Open the folder of a benchmark.

    Args:
        name: of the benchmark.
        seen_by: the module whose probes look at the runs.
        robot: shipped name or path of a robot file.
        settings: for all runs, such as ``{"tsid.base_kp": 120.0}``.
        jobs: processes; 0 for one per processor.
        scheduler: address of a Dask scheduler, whose workers do the runs instead.
        out: keeps finished runs, so that a benchmark that was ended goes on where it
            was; None keeps nothing on disk.
        bar: shows how many runs are done.

    Raises:
        UsageError: the folder holds something else.
    """
    overrides = tuple(f"{k}={json.dumps(v)}" for k, v in (settings or {}).items())
    about = {
        "study": name,
        "robot": robot,
        "set": list(overrides),
        "probe": code_fingerprint(seen_by),
    }
    with tempfile.TemporaryDirectory(prefix="surefoot-") as spare:
        folder = Path(spare) / "runs" if out is None else Path(out)
        with StudyStore(folder, about=about) as store:
            yield BenchRuns(store, robot, overrides, jobs, scheduler, bar)


def everyone(
    robot: str,
    controllers: Sequence[str] | None,
    servo_profiles: Sequence[str] | None,
    *,
    quick: bool,
) -> list[Under]:
    """Return all who are measured.

    Args:
        robot: shipped name or path of a robot file.
        controllers: names as for :func:`surefoot.study`; None for the usual ones.
        servo_profiles: of the robot file; None for all it has.
        quick: fewer controllers, and the robot's own profile alone, where they are
            not given.

    Raises:
        UsageError: there is no such controller.
        RobotFileError: no such robot.
    """
    from surefoot.robot_io.robot import load_robot

    servo = load_robot(robot).file.servo
    names = controllers or (QUICK_CONTROLLERS if quick else CONTROLLERS)
    profiles = servo_profiles or ([servo.profile] if quick else list(servo.profiles))
    variants = [find_variant(name).name for name in names]
    return [Under(v, p) for p in profiles for v in variants]
