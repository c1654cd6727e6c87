"""DYSTURBANCE: the largest pushes that a robot stands, and its impedance.

The protocols are those of 10.3389/frobt.2022.817870: strikes, sines of displacement and
of force, slow displacements and slow forces.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from surefoot.bench.bench_files import (
    Findings,
    TextTable,
    write_scalar,
    write_vector,
)
from surefoot.bench.bench_runs import (
    bench_runs,
    check_positive,
    check_used,
    everyone,
    known_names,
    plain,
    subject_of,
)
from surefoot.bench.push_cells import (
    KINDS,
    SINES,
    Disturbance,
    MarginSearch,
    PushCell,
    first_guess,
    push_cell,
)
from surefoot.bench.push_results import (
    PushResult,
    impedances,
    push_result,
    push_tables,
    write_push_page,
)
from surefoot.errors import UsageError
from surefoot.presentation import CountBar, no_bar
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.scenario import scenario_from_table
from surefoot.schemas.toml_file import struct_table
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.studies.cell import Row, is_up

DIRECTIONS_DEG = (0.0, 180.0, 90.0)
QUICK_DIRECTIONS_DEG = DIRECTIONS_DEG[:1]
FREQUENCIES_HZ = (0.5, 1.0, 2.0, 4.0)
QUICK_FREQUENCIES_HZ = (1.0,)


class Dysturbance(Findings[PushResult]):
    """Results of DYSTURBANCE: one per push, direction, frequency and controller."""

    NAME = "dysturbance"

    def tables(self) -> list[TextTable]:
        """Return the tables of margins and impedances."""
        return push_tables(self.results)

    def as_dict(self) -> dict[str, Any]:
        """Return everything as built-in types, for JSON."""
        found = [impedance.as_dict() for impedance in impedances(self.results)]
        return {**super().as_dict(), "impedances": found}

    def _write_page(self, folder: Path) -> None:
        write_push_page(folder, self.results, robot=self.who, subject=self.subject)

    def _write_yaml(self, folder: Path) -> None:
        for result in self.results:
            unit = result.unit
            place = folder / plain(result.under.label) / plain(result.disturbance.words)
            write_vector(
                place / "stability_margin.yaml",
                [result.margin, result.normalised],
                labels=[
                    f"stability margin [{unit}]",
                    f"normalised stability margin [{unit}]",
                ],
            )
            write_vector(
                place / "absorbed_energy.yaml",
                [result.energy_j, result.normalised_energy_j],
                labels=["absorbed energy [J]", "normalised absorbed energy [J]"],
            )
            if result.absorbed is not None:
                words = "absorbed share of the energy [1]"
                write_scalar(
                    place / "absorbed_share.yaml", result.absorbed, label=words
                )
        for found in impedances(self.results):
            if found.impedance is not None:
                words = f"{found.kind} {found.direction_deg:g} deg"
                place = folder / plain(found.under.label) / plain(words)
                write_vector(
                    place / "equivalent_impedance.yaml",
                    found.impedance,
                    labels=["inertia [kg]", "damping [N s/m]", "stiffness [N/m]"],
                )


def dysturbance(
    robot: str = "walker",
    *,
    quick: bool = False,
    controllers: Sequence[str] | None = None,
    servo_profiles: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
    directions_deg: Sequence[float] | None = None,
    frequencies_hz: Sequence[float] | None = None,
    body: str | None = None,
    settings: Mapping[str, Any] | None = None,
    jobs: int = 0,
    scheduler: str | None = None,
    out: str | Path | None = None,
    bar: CountBar = no_bar,
) -> Dysturbance:
    """Find the largest pushes that a robot stands, with DYSTURBANCE's five kinds.

    Each margin is found by bisection, to within 2 %. Energy and impedance are those of
    the largest push that the robot stood.

    Args:
        robot: shipped name or path of a robot file.
        quick: a part that takes some minutes: ahead only, one frequency, two
            controllers and the robot's own servo profile, unless these are given.
        controllers: ``whole-body``, ``zmp-tuned``, ``zmp-stock`` or any name as on the
            command line.
        servo_profiles: of the robot file; None for all it has.
        kinds: ``impulse``, ``sine-displacement``, ``sine-force``,
            ``slow-displacement``, ``slow-force``; all when None.
        directions_deg: 0 ahead, 90 to the left, 180 back.
        frequencies_hz: of the sines.
        body: link that is pushed at its centre of mass; None for the base link.
        settings: for all runs, such as ``{"tsid.base_kp": 120.0}``.
        jobs: processes; 0 for one per processor.
        scheduler: address of a Dask scheduler, whose workers do the runs instead.
        out: a folder that keeps runs, page and YAML files; None keeps nothing.
        bar: shows how many runs are done.

    Raises:
        UsageError: a name is unknown or a number out of range, the robot has no such
            link, or the folder holds other files.
    """
    from surefoot.robot_io.robot import load_robot

    directions = directions_deg or (QUICK_DIRECTIONS_DEG if quick else DIRECTIONS_DEG)
    sines = frequencies_hz or (QUICK_FREQUENCIES_HZ if quick else FREQUENCIES_HZ)
    asked = known_names(kinds or KINDS, KINDS, what="--kinds")
    swings = next((kind for kind in asked if kind in SINES), SINES[0])
    check_used(frequencies_hz is not None, swings, asked, what="--frequencies")
    check_positive(sines, what="--frequencies")
    for direction in directions:
        if not math.isfinite(direction):
            raise UsageError(f"--directions: got {direction:g}, expected degrees")
    under = everyone(robot, controllers, servo_profiles, quick=quick)
    subject = subject_of(robot)
    pushed = body or load_robot(robot).file.base_link
    disturbances = [
        Disturbance(kind, direction, frequency)
        for kind, direction in product(asked, directions)
        for frequency in (sines if kind in SINES else (0.0,))
    ]
    searches = {
        (what, who): MarginSearch(first_guess(what, subject))
        for what in disturbances
        for who in under
    }

    def cell_of(key: Any, size: float) -> PushCell:
        return push_cell(key[0], size, key[1], subject=subject, body=pushed)

    _check(robot, [cell_of(key, search.size) for key, search in searches.items()])
    with bench_runs(
        "dysturbance",
        seen_by=push_cell.__module__,
        robot=robot,
        settings=settings,
        jobs=jobs,
        scheduler=scheduler,
        out=out,
        bar=bar,
    ) as run:
        rows = _search(run, searches, cell_of)
    results = [
        push_result(
            search,
            *key,
            subject=subject,
            row=rows[cell_of(key, search.stood).key] if search.stood else None,
        )
        for key, search in searches.items()
    ]
    place = None if out is None else Path(out)
    made_with = {"settings": dict(settings or {}), "body": pushed}
    found = Dysturbance(robot, subject, results, place, made_with)
    found.write()
    return found


def _check(robot: str, cells: Sequence[PushCell]) -> None:
    """Refuse a push that cannot be made, before any folder or run.

    Raises:
        UsageError: the robot has no such link, or a sine is too fast or too slow.
    """
    from surefoot.robot_io.robot import load_robot
    from surefoot.sim_robot.plant import Plant

    longest = max(cells, key=lambda cell: cell.scenario.duration_s).scenario
    rods = [rod for cell in cells for rod in cell.scenario.rod]
    together = replace(longest, name="pushes", rod=rods)
    try:
        scenario_from_table(struct_table(together), source="pushes")
        Plant(load_robot(robot), together, seed=0)
    except (FileFormatError, ScenarioError) as error:
        key = error.field.rpartition(".")[2]
        option = {"body": "--body", "frequency_hz": "--frequencies"}.get(key)
        told = str(error).rpartition(f"{error.field}: ")[2]
        if key == "duration_s":
            option, told = "--frequencies", f"a sine is too slow; for its run {told} s"
        raise UsageError(f"{option or error.field}: {told}") from error


def _search(
    run: Callable[..., list[Row]], searches: Mapping[Any, MarginSearch], cell_of: Any
) -> dict[str, Row]:
    """Advance all searches together, round by round; return the rows by key."""
    found: dict[str, Row] = {}
    count = 0
    while open_ones := {k: s for k, s in searches.items() if not s.is_done}:
        count += 1
        cells = [cell_of(key, search.size) for key, search in open_ones.items()]
        rows = run(cells, title=f"round {count}")
        found.update(zip((cell.key for cell in cells), rows, strict=True))
        for search, row in zip(open_ones.values(), rows, strict=True):
            search.tell(stood=is_up(row))
    return found
