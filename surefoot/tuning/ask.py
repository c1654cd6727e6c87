"""Specification of a search, checked before anything is run.

``surefoot.tune`` makes it; workers read it from the journal.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec
import optuna

from surefoot.bench.bench_runs import check_each_once
from surefoot.errors import UsageError
from surefoot.robot_io.robot import load_robot
from surefoot.run_plan import Settings, resolve_settings
from surefoot.schemas.scenario import load_scenario
from surefoot.schemas.settings import ControllerSettings
from surefoot.schemas.toml_file import override_texts
from surefoot.sim_robot.catalogue import find_scenario
from surefoot.stabilizer.factory import check_read
from surefoot.studies.cell import Cell, Group, find_variant
from surefoot.studies.execute import tasks_of
from surefoot.studies.store import Task, about_code, inputs_fingerprint
from surefoot.tuning.objectives import (
    SCORE,
    SENSITIVITY,
    Objective,
    TuneCell,
    find_objectives,
    stimulus_of,
)
from surefoot.tuning.parameters import Parameter, Value, overrides_of, parse_parameter

Sampler = Literal["tpe", "nsga2"]
_STARTUP = 10
"""Number of trials drawn at random before the sampler uses results."""
_REDRAWN = 1_000_003
"""Distance of the seeds of a place's values from those that replace them."""
_SAMPLER_SEEDS = 2**32
"""Number of seeds that Optuna's samplers have."""
_POPULATION = 20
"""Population of NSGA-II: a search of gains has hundreds of trials, not thousands."""


class Spec(msgspec.Struct, frozen=True, kw_only=True):
    """Specification of a search; kept in its journal."""

    scenarios: list[str]
    """Scenarios of the search: shipped names, or absolute paths."""
    seeds: list[int]
    """Seeds of the sensor noise."""
    parameters: list[Parameter]
    """Parameters that are searched."""
    objectives: list[str]
    """Names of the figures that are minimised."""
    controller: str
    """Controller or variant, as for a sweep."""
    base: list[str]
    """Settings at the start, as texts ``section.name=value``."""
    start: dict[str, Value]
    """Value of each parameter at the start."""
    robot: str
    """Shipped name or absolute path."""
    servo_profile: str
    """Servo profile of the robot file."""
    sampler: Sampler
    """Algorithm that proposes values."""
    seed: int
    """Seed of the sampler."""
    inputs: list[str]
    """Fingerprint of each scenario's run at the start."""
    about: dict[str, str]
    """Fingerprint of the code, and versions of the packages."""

    @property
    def figures(self) -> list[Objective]:
        """The objectives."""
        return find_objectives(self.objectives)

    @property
    def settings(self) -> ControllerSettings:
        """All settings at the start."""
        return resolve_settings(None, overrides=self.base)

    def rounds(self) -> list[list[TuneCell]]:
        """Return the cases of each trial: those of one seed, then those of the next."""
        return [self.cells(self.scenarios, [seed]) for seed in self.seeds]

    def cells(self, scenarios: list[str], seeds: list[int]) -> list[TuneCell]:
        """Return the cases of some scenarios and seeds, seed by seed."""
        groups = [
            Group(name, (), self.controller, self.servo_profile) for name in scenarios
        ]
        extra = tuple(figure.extra for figure in self.figures if figure.extra)
        return [TuneCell(group, seed, extra) for seed in seeds for group in groups]

    def task(self, cell: TuneCell, values: dict[str, Value]) -> Task:
        """Return a case with the values of a trial.

        Raises:
            FileFormatError: the values contradict each other or the robot.
        """
        tuned = overrides_of(self.parameters, values, start=self.settings)
        overrides = (*self.base, *tuned)
        plan = cell.plan(robot=self.robot, overrides=overrides)
        return Task(cell, self.robot, overrides, inputs_fingerprint(plan))

    def propose(self, trial: optuna.Trial) -> dict[str, Value]:
        """Return the values that the sampler proposes for a trial."""
        return self.used({p.name: p.suggest(trial) for p in self.parameters})

    def used(self, proposed: Mapping[str, Value]) -> dict[str, Value]:
        """Return a trial's values, by parameter, as its runs have them."""
        return {
            p.name: p.used(proposed[p.name], start=self.start[p.name])
            for p in self.parameters
        }

    def check_unchanged(self) -> None:
        """Check that scenarios, robot, controller and code have not changed since.

        Raises:
            UsageError: one was changed; old and new runs would be mixed.
        """
        now = inputs_of(
            self.scenarios,
            controller=self.controller,
            servo_profile=self.servo_profile,
            robot=self.robot,
            base=self.base,
        )
        changed = [
            name
            for name, then, here in zip(self.scenarios, self.inputs, now, strict=True)
            if then != here
        ]
        if changed or self.about != about_code():
            what = ", ".join(changed) or "the code"
            raise UsageError(
                f"{what}: scenario, robot, controller or code changed since the search "
                "began, and trials of both would be mixed; put them back, or begin a "
                "new search in another folder"
            )

    def make_sampler(self, place: int, redrawn: int) -> optuna.samplers.BaseSampler:
        """Make the sampler of one trial.

        Args:
            place: of the trial in the search, from 0.
            redrawn: how often values of this place were given up, since their trials
                were lost.
        """
        seed = (self.seed + place + _REDRAWN * redrawn) % _SAMPLER_SEEDS
        if self.sampler == "nsga2":
            return optuna.samplers.NSGAIISampler(seed=seed, population_size=_POPULATION)
        return optuna.samplers.TPESampler(
            seed=seed, n_startup_trials=_STARTUP, multivariate=True
        )

    def check_same(self, other: Spec, *, place: str) -> None:
        """Check that a search is resumed with the specification it was begun with.

        Args:
            other: what is asked for now.
            place: option and path of the journal or folder, for the error.

        Raises:
            UsageError: it belongs to another search; the message names the difference.
        """
        kept, asked = (_flat(spec) for spec in (self, other))
        differing = [name for name in kept if kept[name] != asked.get(name)]
        if differing:
            raise UsageError(
                f"{place}: holds another search (differing: {', '.join(differing)}); "
                "go on with the same, or name another place"
            )


def _flat(spec: Spec) -> dict[str, Any]:
    built: dict[str, Any] = msgspec.to_builtins(spec)
    return {**built.pop("about"), **built}


Params = Mapping[str, Any] | Sequence[str]
"""``{"tsid.com_kp": (10, 80), "zmp.dcm_bias": ["off", "bias"], "dik.com_gain": None}``:
a range, a choice, or the range the setting allows; or texts as on the command line."""


def make_spec(
    scenarios: list[str],
    params: Params,
    *,
    objectives: list[str],
    seeds: list[int],
    controller: str,
    settings: Settings,
    overrides: Sequence[str],
    robot: str,
    servo_profile: str | None,
    sampler: Sampler,
    sampler_seed: int,
) -> Spec:
    """Make and check a specification; see :func:`surefoot.tune` for the arguments.

    Raises:
        UsageError: a name or a range cannot be used.
    """
    if not 0 <= sampler_seed < _SAMPLER_SEEDS:
        raise UsageError(
            f"--sampler-seed {sampler_seed}: expected 0 to {_SAMPLER_SEEDS - 1}"
        )
    variant = find_variant(controller)
    model = load_robot(robot, servo_profile=servo_profile)
    profile = model.file.servo.profile
    if settings is None:
        start = variant.resolve(profile, extra=tuple(overrides))
    else:
        start = resolve_settings(settings, overrides=overrides)
    parameters = [parse_parameter(text, start=start) for text in _texts(params)]
    _check_once(parameters)
    check_read(overrides, [variant.controller])
    check_read(
        [parameter.setting for parameter in parameters],
        [variant.controller],
        option="--params",
    )
    for parameter in parameters:
        parameter.check_start(start)
    base = _differences(start)
    places = [_whole(name, find_scenario(name)) for name in scenarios]
    if not places or not seeds:
        raise UsageError("expected at least one scenario and one seed")
    check_each_once(places, what="scenario")
    check_each_once(seeds, what="--seeds")
    if not objectives:
        raise UsageError("--objectives: expected at least one, such as com")
    place = _whole(robot, model.path)
    inputs = inputs_of(
        places,
        controller=variant.controller,
        servo_profile=profile,
        robot=place,
        base=base,
    )
    spec = Spec(
        scenarios=places,
        seeds=seeds,
        parameters=parameters,
        objectives=objectives,
        controller=variant.controller,
        base=base,
        start={p.name: p.present(start) for p in parameters},
        robot=place,
        servo_profile=profile,
        sampler=sampler,
        seed=sampler_seed,
        inputs=inputs,
        about=about_code(),
    )
    _check_objectives(spec)
    return spec


def inputs_of(
    scenarios: Sequence[str],
    *,
    controller: str,
    servo_profile: str,
    robot: str,
    base: Sequence[str],
) -> list[str]:
    """Return the fingerprint of each scenario's run with the settings at the start."""
    groups = [Group(name, (), controller, servo_profile) for name in scenarios]
    cells = [Cell(group, 0) for group in groups]
    tasks = tasks_of(cells, robot=robot, overrides=tuple(base))
    return [str(task.inputs) for task in tasks]


def held_out_cells(
    spec: Spec, scenarios: Sequence[str], seeds: Iterable[int] | None
) -> list[TuneCell]:
    """Return cases that the search does not use.

    Raises:
        UsageError: the search uses some of them.
    """
    names = [_whole(name, find_scenario(name)) for name in scenarios]
    first = max(spec.seeds) + 1
    fresh = (
        list(range(first, first + len(spec.seeds))) if seeds is None else list(seeds)
    )
    shared = {*(names or spec.scenarios)} & {*spec.scenarios}
    if shared and {*fresh} & {*spec.seeds}:
        raise UsageError(
            f"--held-out-seeds {fresh}: the search sees some of them on "
            f"{', '.join(sorted(shared))}; name other seeds or other scenarios"
        )
    check_each_once(names, what="--held-out")
    check_each_once(fresh, what="--held-out-seeds")
    cells = spec.cells(names or spec.scenarios, fresh)
    tasks_of(cells, robot=spec.robot, overrides=tuple(spec.base))
    return cells


def _texts(params: Params) -> list[str]:
    if not isinstance(params, Mapping):
        return list(params)
    texts = []
    for name, values in params.items():
        if values is None:
            texts.append(name)
        elif isinstance(values, tuple):
            texts.append(f"{name}={':'.join(map(str, values))}")
        else:
            texts.append(f"{name}={','.join(map(str, values))}")
    return texts


def _check_objectives(spec: Spec) -> None:
    extra = [figure.extra for figure in spec.figures]
    if SENSITIVITY in extra and spec.controller != "whole-body":
        raise UsageError(
            f"--objectives margin: is of the whole-body controller's loop, got "
            f"{spec.controller}; leave it out"
        )
    scenarios = [load_scenario(find_scenario(name)) for name in spec.scenarios]
    if "dcm" in spec.objectives and not any(s.walk for s in scenarios):
        raise UsageError(
            "--objectives dcm: is of a walk, and none of the scenarios has a table "
            "[walk]; name one, such as walk-flat-slow"
        )
    if SCORE in extra and not any(map(stimulus_of, scenarios)):
        raise UsageError(
            "--objectives score: none of the scenarios is a tilt of COMTEST; name one "
            'whose ground has a single motion of kind "prts" about pitch or roll, '
            "from 1 s on, with three cycles or more"
        )


def _check_once(parameters: Sequence[Parameter]) -> None:
    if not parameters:
        raise UsageError("--params: expected at least one, such as tsid.com_kp=10:80")
    for parameter in parameters:
        same = [p for p in parameters if p.setting == parameter.setting]
        if len(same) > 1 and len({p.axis for p in same} - {None}) < len(same):
            raise UsageError(
                f"--params {parameter.name}: is searched twice; name it once, whole or "
                "by its axes"
            )


def _differences(settings: ControllerSettings) -> list[str]:
    """Return the settings that differ from the defaults, as texts."""
    plain = msgspec.to_builtins(ControllerSettings())
    return override_texts(
        {
            f"{section}.{name}": value
            for section, values in msgspec.to_builtins(settings).items()
            for name, value in values.items()
            if value != plain[section][name]
        }
    )


def _whole(name: str, path: Path) -> str:
    """A shipped name as it is; else the absolute path."""
    return name if path.stem == name else str(path.resolve())
