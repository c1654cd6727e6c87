"""A robot, and plants built from a few lines of a scenario."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.schemas.result import NO_TIME, PlantResult
from surefoot.schemas.scenario import Scenario, scenario_from_table
from surefoot.sim_robot.plant import Plant
from surefoot.sim_robot.simulated_robot import SimulatedRobot

MakeScenario = Callable[..., Scenario]
"""Takes keys of a scenario as keywords."""
MakePlant = Callable[..., Plant]
"""Takes keys of a scenario as keywords, and ``seed`` and ``robot``."""


@pytest.fixture(scope="session")
def walker() -> Robot:
    return load_robot("walker")


@pytest.fixture(scope="session")
def make_scenario() -> MakeScenario:
    def make(**table: Any) -> Scenario:
        table.setdefault("duration_s", 5.0)
        return scenario_from_table({"name": "test", **table}, source="test")

    return make


@pytest.fixture(scope="session")
def make_plant(walker: Robot, make_scenario: MakeScenario) -> MakePlant:
    """Build a plant at tick 0; keywords are keys of a scenario."""

    def make(*, seed: int = 0, robot: Robot = walker, **table: Any) -> Plant:
        return Plant(robot, make_scenario(**table), seed=seed)

    return make


@pytest.fixture(scope="module")
def standing_plant(make_plant: MakePlant) -> Plant:
    """Return a plant at rest on firm ground, which tests must not step."""
    return make_plant()


def figures(simulated: SimulatedRobot) -> PlantResult:
    """Return the figures of a run with two missed deadlines and three late answers."""
    return simulated.result(
        real_time_factor=1.0,
        round_trip_ms=NO_TIME,
        period_jitter_ms=NO_TIME,
        deadline_misses=2,
        refused={"late": 3},
        clipped={},
    )
