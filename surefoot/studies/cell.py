"""One run of a study, its unique key, and the variants of controllers.

Studies, searches and the paper's evaluation are made of such runs.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import msgspec

from surefoot.errors import UsageError
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.run_plan import check_on_disk, resolve_settings
from surefoot.schemas.reasons import Outcome
from surefoot.schemas.settings import ControllerSettings, setting_names
from surefoot.schemas.toml_file import override_texts, plain
from surefoot.schemas.validation import nearest
from surefoot.stabilizer.controller import CONTROLLERS
from surefoot.stabilizer.factory import find_controller
from surefoot.stabilizer.foreign import list_controllers

if TYPE_CHECKING:
    from surefoot.run_plan import RunPlan
    from surefoot.schemas.result import RunResult
    from surefoot.schemas.scenario import Scenario

Row = dict[str, Any]
FIGURES = (
    "outcome",
    "outcome_detail",
    "fell",
    "fell_at_s",
    "duration_s",
    "com_error_rms_mm",
    "com_error_max_mm",
    "base_tilt_max_deg",
    "force_error_rms_n",
    "force_deviation_rms_n",
    "force_peak_n",
    "contact_lost_s",
    "contact_gap_s",
    "qp_failures",
    "steps_done",
    "steps_planned",
    "distance_m",
    "dcm_error_rms_mm",
    "dcm_error_max_mm",
    "placement_error_max_mm",
    "touchdown_peak_n",
    "log_sha256",
)


class Group(NamedTuple):
    """Runs that differ only by their seed."""

    scenario: str
    values: tuple[tuple[str, Any], ...]
    variant: str
    servo_profile: str

    @property
    def case(self) -> str:
        """Scenario and varied values, in words."""
        words = ", ".join(f"{name} {in_words(value)}" for name, value in self.values)
        return f"{self.scenario} ({words})" if words else self.scenario


def is_up(row: Row) -> bool:
    """Whether the robot of a run stayed up."""
    return Outcome(row["outcome"]).is_up


def in_words(value: Any) -> str:
    """Return a varied value as tables show it."""
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(in_words, value))}]"
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return f"{value:g}" if is_number else str(value)


def hashable(value: Any) -> Any:
    """Return a varied value with tuples for lists."""
    return tuple(map(hashable, value)) if isinstance(value, (list, tuple)) else value


class Work(Protocol):
    """One run of a study: a :class:`Cell`, or a benchmark's."""

    @property
    def key(self) -> str:
        """Unique in a study, and readable."""

    @property
    def case(self) -> str:
        """The case that is run, in words."""

    @property
    def group(self) -> Hashable:
        """Equal for runs that differ only by their seed."""

    def plan(self, *, robot: str, overrides: tuple[str, ...]) -> RunPlan:
        """Return the plan of the run."""

    def run(self, plan: RunPlan) -> Row:
        """Run the plan; return the row: case and figures."""


@dataclass(frozen=True)
class Cell:
    """A group and a seed: one run.

    Attributes:
        group: scenario, varied values of scenario and settings, controller and servo
            profile.
        seed: of the sensor noise.
    """

    group: Group
    seed: int

    @property
    def key(self) -> str:
        """Unique in a study, and readable."""
        group = self.group
        values = ",".join(f"{name}={value!r}" for name, value in group.values)
        parts = (group.scenario, values, group.variant, group.servo_profile)
        return "|".join((*parts, str(self.seed)))

    @property
    def case(self) -> str:
        """The case that is run, in words."""
        return self.group.case

    def plan(self, *, robot: str, overrides: tuple[str, ...]) -> RunPlan:
        """Return the run's plan, as ``surefoot run --inline`` would make it.

        Raises:
            FileFormatError: a value does not fit the scenario, or settings contradict
                each other, the robot or the scenario.
        """
        from surefoot.schemas.scenario import load_scenario
        from surefoot.schemas.scenario_paths import override_scenario
        from surefoot.sim_robot.catalogue import find_scenario

        group = self.group
        path = find_scenario(group.scenario)
        varied = dict(group.values)
        settings = {
            name: varied.pop(name) for name in list(varied) if name in setting_names()
        }
        return plan_in(
            override_scenario(load_scenario(path), varied),
            path,
            variant=group.variant,
            servo_profile=group.servo_profile,
            seed=self.seed,
            robot=robot,
            overrides=(*overrides, *override_texts(settings)),
        )

    def run(self, plan: RunPlan) -> Row:
        """Run the plan; return the row: case and figures."""
        from surefoot.runs import run_inline

        return self.row(run_inline(plan, goes_on=True).result)

    def row(self, result: RunResult) -> Row:
        """Return the row of a result: case and figures."""
        group = self.group
        return {
            "scenario": group.scenario,
            "values": dict(group.values),
            "variant": group.variant,
            "servo_profile": group.servo_profile,
            "seed": self.seed,
            **figures_of(result),
        }


def figures_of(result: RunResult) -> Row:
    """Return those figures of a run that studies keep, as built-in types."""
    figures = msgspec.to_builtins(result)
    return {name: figures[name] for name in FIGURES}


@dataclass(frozen=True)
class Variant:
    """A controller with settings.

    Attributes:
        name: shown in tables and plots.
        controller: name of the controller, as on the command line.
        settings: name or path of a settings file; None without one.
        settings_of: settings files for single servo profiles, by profile.
        overrides: texts ``section.name=value``.
        about: its settings in words.
    """

    name: str
    controller: str
    settings: str | None = None
    settings_of: Mapping[str, str] = field(default_factory=dict)
    overrides: tuple[str, ...] = ()
    about: str = ""

    def resolve(
        self, servo_profile: str, *, extra: tuple[str, ...] = ()
    ) -> ControllerSettings:
        """Resolve all settings.

        Args:
            servo_profile: servo profile of the robot.
            extra: further texts ``section.name=value``.

        Raises:
            FileFormatError: a file or an override is malformed.
        """
        name = self.settings_of.get(servo_profile, self.settings)
        return resolve_settings(name, overrides=[*self.overrides, *extra])


_KNOWN = (
    Variant("whole-body", "whole-body", about="default settings"),
    Variant(
        "paper",
        "whole-body",
        overrides=("whole_body.preset=paper",),
        about="the published law alone: nothing fed forward",
    ),
    Variant(
        "person",
        "whole-body",
        "person",
        about="sways with ground that tilts, as people do",
    ),
    Variant(
        "zmp-tuned",
        "zmp",
        "zmp-tuned",
        {"harmonic": "zmp-tuned-harmonic"},
        about="best of a search on other scenarios, one for each servo profile",
    ),
    Variant("zmp-stock", "zmp", "zmp-stock", about="published gains and clamps"),
)
VARIANTS = {variant.name: variant for variant in _KNOWN}


def name_of(given: Any, what: str, *, example: str = "mine.toml") -> str:
    """Return a name or a path as a text, as it is sent to other processes.

    Args:
        given: by the user; also a robot that is what its file holds.
        what: it names.
        example: of a path.

    Raises:
        UsageError: it is another object, or a robot that was changed.
    """
    if isinstance(given, Robot):
        check_on_disk(given)
        given = given.path
    if isinstance(given, (str, Path)):
        return str(given)
    is_class = isinstance(given, type)
    got = given.__name__ if is_class else f"a {type(given).__name__}"
    raise UsageError(
        f"{what}: got {got}, expected a name or a path, such as {example}: runs are "
        f"made in other processes, which load the {what} by it; write yours to a file"
    )


def names_of(given: Any, what: str) -> list[str]:
    """Return names or paths as texts, one alone too; see :func:`name_of`."""
    is_one = isinstance(given, (str, Path)) or not isinstance(given, Iterable)
    return [name_of(each, what) for each in ([given] if is_one else given)]


def seeds_of(given: int | Iterable[int]) -> Sequence[int]:
    """Return seeds, given their number, from 0 on, or themselves."""
    seeds = given if isinstance(given, range) else plain(given)
    return range(seeds) if isinstance(seeds, int) else seeds


def find_variant(name: str) -> Variant:
    """Find a variant by name; a controller's name gives it with default settings.

    Raises:
        UsageError: no such variant, the message lists all; or an installed controller
            has its name, too; or it is no name.
        ControllerError: an external controller cannot be found.
    """
    name = name_of(name, "controller", example="path/to/file.py:Class")
    installed = list_controllers()
    if name in VARIANTS:
        if name in installed and name not in CONTROLLERS:
            raise UsageError(
                f"controller {name!r}: surefoot and an installed package both have one "
                "of this name. Name the package's as package.module:Class; for that of "
                "surefoot, remove the package or rename its entry point"
            )
        return VARIANTS[name]
    names = [*dict.fromkeys([*VARIANTS, *installed])]
    if name not in names and ":" not in name:
        raise UsageError(
            f"no controller {name!r}{nearest(name, names)}; expected one of "
            f"{', '.join(names)}, package.module:Class or path/to/file.py:Class"
        )
    find_controller(name)
    return Variant(name, name, about="default settings")


def plan_in(
    scenario: Scenario,
    path: Path | None,
    *,
    variant: str,
    servo_profile: str,
    seed: int,
    robot: str,
    overrides: tuple[str, ...],
) -> RunPlan:
    """Return the plan of a run in a scenario.

    Args:
        scenario: the scenario with all varied values.
        path: path of its file; None if it was built in Python.
        variant: see :func:`find_variant`.
        servo_profile: of the robot file.
        seed: of the sensor noise.
        robot: shipped robot or a robot file.
        overrides: settings, texts ``section.name=value``.

    Raises:
        FileFormatError: settings contradict each other, the robot or the scenario, or
            a scenario built in Python has a value out of range.
    """
    from surefoot.run_plan import RunPlan
    from surefoot.schemas.scenario import scenario_from_table
    from surefoot.schemas.toml_file import struct_table
    from surefoot.stabilizer.factory import check_settings

    if path is None:
        scenario = scenario_from_table(struct_table(scenario), source=scenario.name)
    found = find_variant(variant)
    model = load_robot(robot, servo_profile=servo_profile)
    settings = found.resolve(servo_profile, extra=overrides)
    check_settings(settings, model, duration_s=scenario.duration_s)
    return RunPlan(
        scenario=scenario,
        scenario_name=scenario.name if path is None else path.stem,
        scenario_path=path,
        robot=model,
        robot_name=robot,
        controller=found.controller,
        settings=settings,
        seed=seed,
        mode="inline",
    )


def group_of(row: Row) -> Group:
    """Return the group of a row."""
    values = tuple((name, hashable(value)) for name, value in row["values"].items())
    return Group(row["scenario"], values, row["variant"], row["servo_profile"])
