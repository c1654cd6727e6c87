"""Whom a bench measures, and the runs it takes: made, kept and found again."""

from __future__ import annotations

import json
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
from surefoot.progress import CountBar
from surefoot.run_plan import RunPlan
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.scenario_robot import Sensors
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
    """Return the names asked for, all of them valid.

    Args:
        names: asked for.
        valid: all there are.
        what: they are, in a word.

    Raises:
        UsageError: one is not; the message lists all.
    """
    known = {str(name): name for name in valid}
    for name in names:
        if name not in known:
            raise UsageError(
                f"{what}: got {name!r}{nearest(name, valid)}; expected one of "
                f"{', '.join(valid)}"
            )
        if list(names).count(name) > 1:
            raise UsageError(f"{what}: {name} is named twice")
    return [known[name] for name in names]


def check_positive(values: Sequence[float], *, what: str) -> None:
    """See that numbers can be sizes.

    Raises:
        UsageError: one is not above zero, or is not finite.
    """
    for value in values:
        if not 0.0 < value < math.inf:
            raise UsageError(f"{what}: got {value:g}, expected a number above 0")


def plain(words: str) -> str:
    """Return words as the name of a file; other numbers and letters, other names."""
    signed = re.sub(r"(?<![^\s,])-(?=[\d.])", "minus ", words.lower())
    return re.sub(r"[^\w.]+", "_", signed).strip("_")


@dataclass(frozen=True)
class Subject:
    """A robot, or a person, that stands.

    Attributes:
        mass_kg: of all of it [kg].
        com_height_m: centre of mass over the soles [m].
        base_depth_m: from below the centre of mass to the nearer edge ahead or behind,
            over which it tips [m].
        base_width_m: the same to the side [m].
    """

    mass_kg: float
    com_height_m: float
    base_depth_m: float
    base_width_m: float

    def base_m(self, direction_deg: float) -> float:
        """Distance to the edge of tipping, the nearer one, for a push [m].

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
"""The person of medium size that DYSTURBANCE puts robots in proportion to; mass and
centre of mass from the body parts in its published program."""


@dataclass(frozen=True)
class Proportion:
    """A robot's measures over a person's, in the combinations that pushes scale with.

    Attributes:
        force: of what a body bears before it tips: weight times base over height.
        energy: of lifting the centre of mass over the edge of the base.
        way: of the centre of mass' height.
    """

    force: float
    energy: float
    way: float


def proportion(subject: Subject, *, direction_deg: float) -> Proportion:
    """Return a robot's measures over those of :data:`PERSON`.

    Implements the normalisation of DYSTURBANCE (10.3389/frobt.2022.817870): a figure
    divided by its factor is what it would be for a person, so that robots compare.
    """
    ours, theirs = (_tipping(who, direction_deg) for who in (subject, PERSON))
    return Proportion(
        force=ours[0] / theirs[0],
        energy=ours[1] / theirs[1],
        way=subject.com_height_m / PERSON.com_height_m,
    )


def _tipping(who: Subject, direction_deg: float) -> tuple[float, float]:
    """Force and energy of tipping, both over gravity [kg, kg m]."""
    base, height = who.base_m(direction_deg), who.com_height_m
    force = who.mass_kg * base / height
    return force, who.mass_kg * (math.hypot(base, height) - height)


NOISE = Sensors(
    force_noise_n=2.0,
    moment_noise_nm=0.1,
    gyro_noise_rad_s=0.002,
    accel_noise_m_s2=0.05,
)
"""Of the shipped scenarios, for a benchmark's too."""


class Under(NamedTuple):
    """Who is measured."""

    variant: str
    servo_profile: str

    @property
    def label(self) -> str:
        """As in tables and plots."""
        return f"{self.variant}, {self.servo_profile}"


class Probe(Protocol):
    """Looks at a run while it goes."""

    def look(self, sim: Simulation) -> None:
        """Take in the present tick."""

    def figures(self) -> dict[str, Any]:
        """What it saw, as built-in types."""


@dataclass(frozen=True, kw_only=True)
class BenchCell(ABC):
    """A run of a benchmark.

    Attributes:
        case: what is done to the robot; unique among the cases of a study.
        scenario: the same as a scenario.
        under: controller and servo profile.
        seed: of the sensor noise.
    """

    case: str
    scenario: Scenario
    under: Under
    seed: int = 0

    @property
    def variant(self) -> str:
        """Who is run."""
        return self.under.variant

    @property
    def group(self) -> tuple[str, Under]:
        """The same for runs that differ by their seed only."""
        return self.case, self.under

    @property
    def key(self) -> str:
        """Unique in a study, and readable."""
        return "|".join((self.case, *self.under, str(self.seed)))

    @abstractmethod
    def probe(self) -> Probe:
        """A fresh probe for a run."""

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
        """Run its plan; what was run, the figures, and what the probe saw."""
        from surefoot.stabilizer.factory import make_controller

        sim = Simulation.of_plan(plan)
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
            # Of a robot that fell, or was held at last, they would tell nothing.
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
    """Open the folder of a benchmark; gives what does its runs, with cells and title.

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
        UsageError: the folder holds something else; a robot or controller was changed
            between two calls.
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
                # Robot or controller may have changed since the first of the calls.
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
