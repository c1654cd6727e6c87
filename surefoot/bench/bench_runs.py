"""Subjects of a benchmark and its runs: how they are made, stored and found again."""

from __future__ import annotations

import math
import re
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

from surefoot.errors import UsageError
from surefoot.presentation import CountBar
from surefoot.run_plan import RunPlan
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.scenario_robot import Sensors
from surefoot.schemas.toml_file import override_texts
from surefoot.schemas.validation import nearest
from surefoot.simulation import Simulation
from surefoot.studies.cell import Row, figures_of, find_variant, is_up, plan_in
from surefoot.studies.execute import execute, tasks_of
from surefoot.studies.store import StudyStore, code_fingerprint

Name = TypeVar("Name", bound=str)
CONTROLLERS = ("whole-body", "zmp-tuned", "zmp-stock")


def known_names(
    names: Sequence[str], valid: Sequence[Name], *, what: str
) -> list[Name]:
    """Return the names asked for, after a check.

    Args:
        names: names asked for.
        valid: all valid names.
        what: what they name, in one word.

    Raises:
        UsageError: a name is not valid, or is named twice.
    """
    check_each_once(names, what=what)
    known = {str(name): name for name in valid}
    for name in names:
        if name not in known:
            raise UsageError(
                f"{what}: got {name!r}{nearest(name, valid)}; expected one of "
                f"{', '.join(valid)}"
            )
    return [known[name] for name in names]


def check_each_once(values: Sequence[object], *, what: str) -> None:
    """Refuse repeated values: their runs would count twice.

    Raises:
        UsageError: a value is repeated.
    """
    twice = next((value for value in values if values.count(value) > 1), None)
    if twice is not None:
        raise UsageError(f"{what}: {twice} is named twice; name it once")


def check_positive(values: Sequence[float], *, what: str) -> None:
    """Check that numbers are positive and finite.

    Raises:
        UsageError: a number is not.
    """
    for value in values:
        if not 0.0 < value < math.inf:
            raise UsageError(f"{what}: got {value:g}, expected a number above 0")


def check_used(given: bool, by: str, asked: Sequence[str], *, what: str) -> None:
    """Refuse an option, ``what``, that only ``by`` reads when that is not asked for.

    Raises:
        UsageError: it is given, and nothing that runs reads it.
    """
    if given and by not in asked:
        raise UsageError(
            f"{what}: got a value, but only {by} reads it, and only "
            f"{', '.join(asked)} would run; leave it out, or name {by}, too"
        )


def plain(words: str) -> str:
    """Return words as a file name; other letters or numbers give another name."""
    signed = re.sub(r"(?<![^\s,])-(?=[\d.])", "minus ", words.lower())
    return re.sub(r"[^\w.]+", "_", signed).strip("_")


@dataclass(frozen=True)
class Subject:
    """Measures of a standing robot or person.

    Attributes:
        mass_kg: total mass [kg].
        com_height_m: height of the centre of mass over the soles [m].
        base_depth_m: horizontal distance from the centre of mass to the nearer tipping
            edge ahead or behind [m].
        base_width_m: the same to the side [m].
    """

    mass_kg: float
    com_height_m: float
    base_depth_m: float
    base_width_m: float

    def base_m(self, direction_deg: float) -> float:
        """Return the distance to the nearer tipping edge for a push [m].

        Args:
            direction_deg: 0 and 180 ahead and back, 90 and 270 to the sides.
        """
        angle = math.radians(direction_deg)
        depth, width = abs(math.cos(angle)), abs(math.sin(angle))
        least = 1e-9
        return min(
            self.base_depth_m / max(depth, least), self.base_width_m / max(width, least)
        )


def subject_of(robot: str) -> Subject:
    """Measure a robot in its nominal stance.

    Args:
        robot: shipped name or path of a robot file.

    Raises:
        RobotFileError: no such robot, or its files contradict each other.
    """
    from surefoot.robot_io.robot import load_robot
    from surefoot.sim_robot.plant import Plant

    model = load_robot(robot)
    plant = Plant(model, Scenario(name="stance", duration_s=1.0), seed=0)
    x, y, height = plant.com_reference.tolist()
    soles = plant.view.sole_left, plant.view.sole_right
    feet = list(zip(soles, (model.left, model.right), strict=True))
    middle = 0.5 * (soles[0] + soles[1])
    front = max(p[0] + foot.half_length_m for p, foot in feet) - middle[0]
    back = min(p[0] - foot.half_length_m for p, foot in feet) - middle[0]
    left = max(p[1] + foot.half_width_m for p, foot in feet) - middle[1]
    right = min(p[1] - foot.half_width_m for p, foot in feet) - middle[1]
    return Subject(
        mass_kg=plant.world.weight / -plant.world.model.opt.gravity.item(2),
        com_height_m=height,
        base_depth_m=float(min(front - x, x - back)),
        base_width_m=float(min(left - y, y - right)),
    )


PERSON = Subject(
    mass_kg=81.4, com_height_m=1.003, base_depth_m=0.111, base_width_m=0.1665
)
"""Person of medium size to which DYSTURBANCE compares robots; mass and centre of mass
come from the body parts in its published program."""


@dataclass(frozen=True)
class Proportion:
    """Ratios of a robot's measures to a person's, to normalise pushes.

    Attributes:
        force: ratio of the tipping forces: weight times base over height.
        energy: ratio of the energies that lift the centre of mass over the edge.
        way: ratio of the centre of mass' heights.
    """

    force: float
    energy: float
    way: float


def proportion(subject: Subject, *, direction_deg: float) -> Proportion:
    """Return the ratios of a robot's measures to those of :data:`PERSON`.

    Implements the normalisation of DYSTURBANCE (10.3389/frobt.2022.817870): a figure
    over its ratio is the equivalent for a person, which makes robots comparable.
    """
    ours, theirs = (_tipping(who, direction_deg) for who in (subject, PERSON))
    return Proportion(
        force=ours[0] / theirs[0],
        energy=ours[1] / theirs[1],
        way=subject.com_height_m / PERSON.com_height_m,
    )


def _tipping(who: Subject, direction_deg: float) -> tuple[float, float]:
    """Force and energy of tipping, both divided by gravity [kg, kg m]."""
    base, height = who.base_m(direction_deg), who.com_height_m
    force = who.mass_kg * base / height
    return force, who.mass_kg * (math.hypot(base, height) - height)


NOISE = Sensors(
    force_noise_n=2.0,
    moment_noise_nm=0.1,
    gyro_noise_rad_s=0.002,
    accel_noise_m_s2=0.05,
)
"""Sensor noise of the shipped scenarios; benchmarks use the same."""


class Under(NamedTuple):
    """Controller and servo profile that are measured."""

    variant: str
    servo_profile: str

    @property
    def label(self) -> str:
        """Name in tables and plots."""
        return f"{self.variant}, {self.servo_profile}"


class Probe(Protocol):
    """Measures a run at each tick."""

    def look(self, sim: Simulation) -> None:
        """Take in the present tick."""

    def figures(self) -> dict[str, Any]:
        """Return its figures, as built-in types."""


@dataclass(frozen=True, kw_only=True)
class BenchCell(ABC):
    """A run of a benchmark.

    Attributes:
        case: name of the test; unique among the cases of a study.
        scenario: the scenario of the test.
        under: controller and servo profile.
        seed: of the sensor noise.
    """

    case: str
    scenario: Scenario
    under: Under
    seed: int = 0

    @property
    def variant(self) -> str:
        """Name of the controller or variant."""
        return self.under.variant

    @property
    def group(self) -> tuple[str, Under]:
        """Equal for runs that differ only by their seed."""
        return self.case, self.under

    @property
    def key(self) -> str:
        """Unique in a study, and readable."""
        return "|".join((self.case, *self.under, str(self.seed)))

    @abstractmethod
    def probe(self) -> Probe:
        """Return a new probe for a run."""

    def plan(self, *, robot: str, overrides: tuple[str, ...]) -> RunPlan:
        """Return the run's plan."""
        return plan_in(
            self.scenario,
            None,
            variant=self.under.variant,
            servo_profile=self.under.servo_profile,
            seed=self.seed,
            robot=robot,
            overrides=overrides,
        )

    def run(self, plan: RunPlan) -> Row:
        """Run the plan; return the row: case, figures and the probe's figures."""
        from surefoot.stabilizer.factory import make_controller

        sim = Simulation.of_plan(plan)
        sim.goes_on = True
        probe = self.probe()
        controller = make_controller(plan.controller, plan.robot, plan.settings)
        sim.run(controller, on_tick=lambda tick: probe.look(sim))
        row = figures_of(sim.result())
        return {
            "case": self.case,
            "variant": self.under.variant,
            "servo_profile": self.under.servo_profile,
            "seed": self.seed,
            **row,
            # After a fall or a hold the probe's figures have no meaning.
            "seen": probe.figures() if is_up(row) else {},
        }


QUICK_CONTROLLERS = CONTROLLERS[:2]


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
) -> Iterator[Callable[..., list[Row]]]:
    """Open a benchmark's folder; yield a function that runs cells under a title.

    Args:
        name: of the benchmark.
        seen_by: module of the probes.
        robot: shipped name or path of a robot file.
        settings: for all runs, such as ``{"tsid.base_kp": 120.0}``.
        jobs: processes; 0 for one per processor.
        scheduler: address of a Dask scheduler, whose workers do the runs instead.
        out: folder that keeps finished runs, from which an interrupted benchmark is
            resumed; None keeps nothing on disk.
        bar: shows how many runs are done.

    Raises:
        UsageError: the folder holds other files; or robot or controller changed
            between two calls.
    """
    overrides = tuple(override_texts(settings or {}))
    about = {
        "study": name,
        "robot": robot,
        "set": list(overrides),
        "probe": code_fingerprint(seen_by),
    }
    with tempfile.TemporaryDirectory(prefix="surefoot-") as spare:
        folder = Path(spare) / "runs" if out is None else Path(out)
        with StudyStore(folder, about=about) as store:
            firsts: dict[Under, BenchCell] = {}

            def run(cells: Sequence[BenchCell], *, title: str) -> list[Row]:
                for cell in cells:
                    firsts.setdefault(cell.under, cell)
                rows = execute(
                    cells,
                    store,
                    robot=robot,
                    overrides=overrides,
                    jobs=jobs,
                    scheduler=scheduler,
                    title=title,
                    bar=bar,
                )
                # Robot or controller may have changed since the first call.
                tasks = tasks_of([*firsts.values()], robot=robot, overrides=overrides)
                for task in tasks:
                    store.check(task)
                return rows

            yield run


def everyone(
    robot: str,
    controllers: Sequence[str] | None,
    servo_profiles: Sequence[str] | None,
    *,
    quick: bool,
) -> list[Under]:
    """Return all pairs of controller and servo profile that are measured.

    Args:
        robot: shipped name or path of a robot file.
        controllers: names as for :func:`surefoot.study`; None for the usual ones.
        servo_profiles: of the robot file; None for all it has.
        quick: fewer controllers, and only the robot's own profile, unless these are
            given.

    Raises:
        UsageError: there is no such controller.
        RobotFileError: no such robot.
        FileFormatError: it has no such servo profile.
    """
    from surefoot.robot_io.robot import load_robot, with_servo_profile

    model = load_robot(robot)
    servo = model.file.servo
    names = controllers or (QUICK_CONTROLLERS if quick else CONTROLLERS)
    profiles = servo_profiles or ([servo.profile] if quick else list(servo.profiles))
    for profile in profiles:
        with_servo_profile(model.file, profile, path=model.path)
    variants = [find_variant(name).name for name in names]
    return [Under(v, p) for p in profiles for v in variants]
