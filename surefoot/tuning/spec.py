"""What is searched and how: all that every process of a search must agree on."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import msgspec
import optuna

from surefoot.errors import UsageError
from surefoot.run_plan import resolve_settings
from surefoot.schemas.settings import ControllerSettings
from surefoot.studies.cell import Group, Task
from surefoot.studies.store import inputs_fingerprint
from surefoot.tuning.objectives import Objective, TuneCell, find_objectives
from surefoot.tuning.parameters import Parameter, Value, overrides_of

Sampler = Literal["tpe", "nsga2"]
_STARTUP = 10
"""Trials drawn at random before the sampler has something to go by."""
_POPULATION = 20
"""Of NSGA-II: a search of gains has hundreds of trials, not thousands."""


class Spec(msgspec.Struct, frozen=True, kw_only=True):
    """A search; kept in its journal."""

    scenarios: list[str]
    """Those it is trained on: shipped names, or whole paths."""
    seeds: list[int]
    """Of the sensor noise."""
    parameters: list[Parameter]
    """What it may change."""
    objectives: list[str]
    """What it makes small."""
    controller: str
    """Controller or variant, as of a sweep."""
    base: list[str]
    """Settings at the start, as texts ``section.name=value``."""
    start: dict[str, Value]
    """Value of each parameter there."""
    robot: str
    """Shipped name or whole path."""
    servo_profile: str
    """Of the robot file."""
    sampler: Sampler
    """Which algorithm proposes."""
    seed: int
    """Of the sampler."""
    inputs: list[str]
    """Fingerprint of each scenario's run at the start."""
    about: dict[str, str]
    """Code and packages."""

    @property
    def figures(self) -> list[Objective]:
        """The objectives."""
        return find_objectives(self.objectives)

    @property
    def settings(self) -> ControllerSettings:
        """All settings at the start."""
        return resolve_settings(None, overrides=self.base)

    def rounds(self) -> list[list[TuneCell]]:
        """Cases to run for each trial: those of one seed, then those of the next."""
        return [self.cells(self.scenarios, [seed]) for seed in self.seeds]

    def cells(self, scenarios: list[str], seeds: list[int]) -> list[TuneCell]:
        """Cases of some scenarios and seeds, seed by seed."""
        groups = [
            Group(name, (), self.controller, self.servo_profile) for name in scenarios
        ]
        extra = tuple(figure.extra for figure in self.figures if figure.extra)
        return [TuneCell(group, seed, extra) for seed in seeds for group in groups]

    def task(self, cell: TuneCell, values: dict[str, Value]) -> Task:
        """A case with the values of a trial.

        Raises:
            FileFormatError: the values contradict each other or the robot.
        """
        tuned = overrides_of(self.parameters, values, start=self.settings)
        overrides = (*self.base, *tuned)
        plan = cell.plan(robot=self.robot, overrides=overrides)
        return Task(cell, self.robot, overrides, inputs_fingerprint(plan))

    def make_sampler(self, begun: int) -> optuna.samplers.BaseSampler:
        """Make what proposes values, for one trial.

        Args:
            begun: how many trials were begun before.
        """
        seed = self.seed + begun
        if self.sampler == "nsga2":
            return optuna.samplers.NSGAIISampler(seed=seed, population_size=_POPULATION)
        return optuna.samplers.TPESampler(
            seed=seed, n_startup_trials=_STARTUP, multivariate=True
        )

    def check_same(self, other: Spec, path: Path) -> None:
        """See that a journal is gone on with as it was begun.

        Raises:
            UsageError: it is that of another search; the message says what differs.
        """
        kept, asked = (_flat(spec) for spec in (self, other))
        differing = [name for name in kept if kept[name] != asked.get(name)]
        if differing:
            raise UsageError(
                f"--storage {path}: holds another search (differing: "
                f"{', '.join(differing)}); go on with the same, or name another file"
            )


def _flat(spec: Spec) -> dict[str, Any]:
    built: dict[str, Any] = msgspec.to_builtins(spec)
    return {**built.pop("about"), **built}
