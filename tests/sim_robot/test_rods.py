"""Rods on a free mass with a known motion, and on the robot."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surefoot.robot_io.robot import load_robot
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.scenario import Scenario, scenario_from_table
from surefoot.schemas.scenario_robot import DisplacementRod, ForceRod, Rod, StrikeRod
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.conventions import SIM_STEP_S
from surefoot.sim_robot.plant import Plant
from surefoot.sim_robot.pushes import RodAtWork

MASS = 20.0
PER_CENT = 0.01


class FreeMass:
    """A mass that only the rod moves, integrated as MuJoCo does."""

    def __init__(self, rod: Rod) -> None:
        self.rod = RodAtWork(rod, 1, mass=MASS)
        self.place, self.speed = 7.0, 0.0

    def run(self, duration_s: float) -> None:
        for step in range(round(duration_s / SIM_STEP_S)):
            self.speed += self.rod.step(self.place, step) / MASS * SIM_STEP_S
            self.place += self.speed * SIM_STEP_S

    @property
    def energy(self) -> float:
        return 0.5 * MASS * self.speed**2


@pytest.mark.parametrize("striker_kg", [2.0, 20.0, 60.0])
def test_a_strike_is_an_elastic_collision(striker_kg: float) -> None:
    rod = StrikeRod(body="torso", mass_kg=striker_kg, speed_m_s=1.5, start_s=0.1)
    mass = FreeMass(rod)
    mass.run(1.0)
    speed = 2.0 * striker_kg / (striker_kg + MASS) * 1.5
    assert mass.speed == pytest.approx(speed, rel=PER_CENT)
    assert mass.rod.state.impulse_n_s == pytest.approx(MASS * speed, rel=PER_CENT)
    assert mass.rod.state.work_j == pytest.approx(mass.energy, rel=PER_CENT)
    assert mass.rod.state.force_n == 0.0


def test_a_given_force_does_the_work_that_the_mass_takes_up() -> None:
    mass = FreeMass(ForceRod(body="torso", amplitude_n=30.0, rise_s=1.0))
    mass.run(3.0)
    assert mass.rod.state.force_n == pytest.approx(30.0)
    # Half of the rise's impulse, then the whole force for two seconds.
    assert mass.speed == pytest.approx(30.0 * 2.5 / MASS, rel=PER_CENT)
    assert mass.rod.state.work_j == pytest.approx(mass.energy, rel=PER_CENT)


def test_a_displacement_leads_the_mass_along_its_way() -> None:
    mass = FreeMass(DisplacementRod(body="torso", amplitude_m=0.05, rise_s=1.0))
    mass.run(2.0)
    assert mass.rod.state.position_m == pytest.approx(0.05, abs=1e-5)


def test_a_sine_of_force_moves_the_mass_as_newton_says() -> None:
    frequency_hz, size_n = 2.0, 40.0
    rod = ForceRod(body="torso", amplitude_n=size_n, frequency_hz=frequency_hz)
    mass = FreeMass(rod)
    speeds = []
    for step in range(3000):
        mass.speed += mass.rod.step(mass.place, step) / MASS * SIM_STEP_S
        mass.place += mass.speed * SIM_STEP_S
        speeds.append(mass.speed)
    steady = np.array(speeds[2000:])
    swing = 0.5 * (steady.max() - steady.min())
    assert swing == pytest.approx(
        size_n / (MASS * 2.0 * math.pi * frequency_hz), rel=PER_CENT
    )
    assert mass.rod.state.peak_n == pytest.approx(size_n, rel=PER_CENT)


def test_a_rod_needs_one_course() -> None:
    for course in ({}, {"rise_s": 1.0, "frequency_hz": 1.0}):
        rod = {"kind": "force", "body": "torso", "amplitude_n": 1.0, **course}
        table = {"name": "n", "duration_s": 1.0, "rod": [rod]}
        with pytest.raises(FileFormatError, match="either `frequency_hz` or `rise_s`"):
            scenario_from_table(table, source="here")


def test_a_rod_too_stiff_for_its_link_is_refused() -> None:
    rod = DisplacementRod(body="torso", amplitude_m=0.05, rise_s=1.0, stiffness_n_m=1e7)
    with pytest.raises(ScenarioError, match="lower stiffness_n_m"):
        RodAtWork(rod, 1, mass=MASS)


def test_a_rod_that_does_not_fit_is_named_by_its_place() -> None:
    fits = {"kind": "force", "body": "torso", "amplitude_n": 1.0, "rise_s": 1.0}
    stiff = {"kind": "strike", "body": "head", "mass_kg": 1.0, "speed_m_s": 1.0}
    rods = [fits, {**stiff, "stiffness_n_m": 1e8}]
    table = {"name": "n", "duration_s": 1.0, "rod": rods, "start": {"settle_s": 0.0}}
    scenario = scenario_from_table(table, source="here")
    with pytest.raises(ScenarioError, match=r"got 1e.08 N/m .* expected") as error:
        Plant(load_robot("walker"), scenario, seed=0)
    assert error.value.field == "rod[1].stiffness_n_m"


def test_the_robot_is_pushed_where_the_rod_points() -> None:
    robot = load_robot("walker")
    speeds = []
    for angle in (0.0, 90.0):
        rod = StrikeRod(body="torso", direction_deg=angle, mass_kg=5.0, speed_m_s=2.0)
        scenario = Scenario(name="struck", duration_s=1.0, rod=[rod])
        plant = Plant(robot, scenario, seed=0)
        for _ in range(100):
            plant.step(robot.nominal)
        speeds.append(plant.truth().com_velocity[:2])
        assert plant.rods[0].state.impulse_n_s > 5.0
    (forwards, left) = speeds
    assert forwards[0] > 10.0 * abs(forwards[1])
    assert left[1] > 10.0 * abs(left[0])
    assert math.hypot(*forwards) > 0.05


def test_a_rod_names_a_link_that_there_is() -> None:
    rod = ForceRod(body="tail", amplitude_n=1.0, rise_s=1.0)
    scenario = Scenario(name="tail", duration_s=1.0, rod=[rod])
    with pytest.raises(ScenarioError, match="tail"):
        Plant(load_robot("walker"), scenario, seed=0)
