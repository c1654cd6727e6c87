"""Scenarios that come with the package, by name; others by path."""

from __future__ import annotations

from pathlib import Path

from schemas.scenario import Scenario, load_scenario
from sim_robot.errors import ScenarioError

SCENARIOS_DIR = Path(__file__).parent / "scenarios"


def list_scenarios() -> list[str]:
    """Names of the shipped scenarios, sorted."""
    return sorted(path.stem for path in SCENARIOS_DIR.glob("*.toml"))


def find_scenario(name_or_path: str) -> Path:
    """Path of a scenario file: a shipped name, or a path to a TOML.

    Raises:
        ScenarioError: there is no such scenario; the message lists the shipped ones.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml":
        if path.is_file():
            return path
        raise ScenarioError(f"{path}: no such scenario file")
    if name_or_path in list_scenarios():
        return SCENARIOS_DIR / f"{name_or_path}.toml"
    raise ScenarioError(
        f"no scenario named {name_or_path!r}; shipped are "
        f"{', '.join(list_scenarios())}, or give the path of a scenario file (.toml)"
    )


def open_scenario(name_or_path: str) -> Scenario:
    """Loads a scenario by shipped name or path.

    Raises:
        ScenarioError: no such scenario.
        FileFormatError: the file is malformed.
    """
    return load_scenario(find_scenario(name_or_path))
