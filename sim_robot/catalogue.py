"""Scenarios: shipped ones by name, others by path, and their errors."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from surefoot.schemas import scenario as scenario_file
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.toml_file import find_toml

SCENARIOS_DIR = Path(__file__).parent / "scenarios"


class SimulationError(RuntimeError):
    """The simulated robot cannot do what was requested."""


class ScenarioError(SimulationError, ValueError):
    """A scenario requests something that this robot or simulation cannot do.

    Attributes:
        field: path of the offending key, such as ``push[0].body``.
    """

    def __init__(self, message: str, *, field: str = "") -> None:
        """Keep the path of the offending key beside the message."""
        super().__init__(message)
        self.field = field


@contextmanager
def within(path: str) -> Iterator[None]:
    """Put a path before the key of a :class:`ScenarioError` raised inside."""
    try:
        yield
    except ScenarioError as error:
        raise ScenarioError(f"{path}.{error}", field=f"{path}.{error.field}") from error


def list_scenarios() -> list[str]:
    """Return the names of the shipped scenarios, sorted."""
    return sorted(path.stem for path in SCENARIOS_DIR.glob("*.toml"))


def find_scenario(name_or_path: str) -> Path:
    """Return the path of a scenario file, given a shipped name or a path.

    Raises:
        ScenarioError: there is no such scenario; the message lists the shipped ones.
    """
    shipped = {name: SCENARIOS_DIR / f"{name}.toml" for name in list_scenarios()}
    return find_toml(name_or_path, shipped, what="scenario", error=ScenarioError)


def load_scenario(name_or_path: str | Path) -> Scenario:
    """Load a scenario by shipped name or path.

    Args:
        name_or_path: ``moving-platform-slow`` or ``path/to/scenario.toml``.

    Raises:
        ScenarioError: no such scenario.
        FileFormatError: the file is malformed.
    """
    return scenario_file.load_scenario(find_scenario(str(name_or_path)))


@contextmanager
def naming_scenario(path: Path) -> Iterator[None]:
    """Add the path of the file to a :class:`ScenarioError` raised inside.

    Bodies, ticks and ranges are checked where robot and scenario meet; that code knows
    nothing of files.
    """
    try:
        yield
    except ScenarioError as error:
        if not error.field:
            raise
        raise ScenarioError(f"{path}: {error}", field=error.field) from error
