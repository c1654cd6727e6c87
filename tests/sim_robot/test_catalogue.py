from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.sim_robot.catalogue import (
    ScenarioError,
    find_scenario,
    list_scenarios,
    load_scenario,
)

SHIPPED = ["moving-platform-fast", "moving-platform-slow", "standing"]


def test_shipped_scenarios_are_there() -> None:
    assert set(SHIPPED) <= set(list_scenarios())


@pytest.mark.parametrize("name", list_scenarios())
def test_shipped_scenario_bears_the_name_of_its_file(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.description


@pytest.mark.parametrize("name", list_scenarios())
def test_shipped_scenario_fits_any_robot(name: str) -> None:
    """None of its parts names a link or a joint."""
    scenario = load_scenario(name)
    assert not [part for part in (*scenario.push, *scenario.rod) if part.body]
    assert not scenario.payload
    assert not isinstance(scenario.sensors.encoder_offset_rad, dict)


def test_path_is_a_scenario_too(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\nduration_s = 2.0\n')
    assert find_scenario(str(path)) == path
    assert load_scenario(str(path)).duration_s == 2.0


def test_unknown_name_lists_the_shipped_ones() -> None:
    with pytest.raises(ScenarioError, match="no scenario named 'stending'") as error:
        find_scenario("stending")
    for name in SHIPPED:
        assert name in str(error.value)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"gone\.toml: no such scenario file"):
        find_scenario(str(tmp_path / "gone.toml"))
