"""Everything a run depends on, loaded and checked before anything starts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec

from surefoot.errors import UsageError
from surefoot.robot_io.relay.catalogue import find_plan
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.schemas.relay_plan import load_relay_plan
from surefoot.schemas.scenario import Scenario, load_scenario
from surefoot.schemas.settings import ControllerSettings, build_settings
from surefoot.schemas.toml_file import read_toml, toml_text
from surefoot.sim_robot.catalogue import find_scenario
from surefoot.stabilizer.factory import find_settings

Mode = Literal["lockstep", "realtime", "inline"]


@dataclass(frozen=True)
class RunPlan:
    """What is run.

    Attributes:
        scenario_path: the scenario's file.
        scenario: its content.
        robot_name: as given: a shipped name or a path.
        robot: its files.
        servo_profile: profile to use instead of the file's, if any.
        controller: name of the control law.
        settings: resolved: defaults, file and overrides.
        seed: of the sensor noise.
        mode: how the two sides are paced.
        relay_path: file of the relay's plan, if there is a relay between them.
    """

    scenario_path: Path
    scenario: Scenario
    robot_name: str
    robot: Robot
    servo_profile: str | None
    controller: str
    settings: ControllerSettings
    seed: int
    mode: Mode
    relay_path: Path | None = None

    @property
    def scenario_name(self) -> str:
        """Shipped name, or name of the file without its suffix."""
        return self.scenario_path.stem

    @property
    def total_ticks(self) -> int:
        """Ticks of the whole scenario."""
        return round(self.scenario.duration_s / self.robot.period_s)


def make_plan(
    scenario: str,
    *,
    robot: str,
    servo_profile: str | None,
    controller: str,
    settings_file: Path | None,
    overrides: list[str],
    seed: int,
    mode: Mode,
    relay: str | None = None,
) -> RunPlan:
    """Load all files a run depends on.

    Raises:
        UsageError: a relay in lockstep.
        ScenarioError: no such scenario.
        RobotFileError: no such robot, or its files contradict each other.
        FileFormatError: a file or an override is malformed.
    """
    path = find_scenario(scenario)
    return RunPlan(
        scenario_path=path,
        scenario=load_scenario(path),
        robot_name=robot,
        robot=load_robot(robot, servo_profile=servo_profile),
        servo_profile=servo_profile,
        controller=controller,
        settings=load_settings(settings_file, overrides=overrides),
        seed=seed,
        mode=mode,
        relay_path=None if relay is None else _find_relay_plan(relay, mode),
    )


def _find_relay_plan(relay: str, mode: Mode) -> Path:
    """Path of a relay plan that can be used, checked now rather than in a child."""
    if mode == "lockstep":
        raise UsageError(
            "--relay needs --realtime, or --inline in simulated time: in lockstep "
            "the robot's time stands still until a command comes, so that nothing is "
            "ever late, and what is lost stops it"
        )
    path = find_plan(relay)
    load_relay_plan(path)
    return path


def load_settings(file: Path | None, *, overrides: list[str]) -> ControllerSettings:
    """Join defaults, a settings file and overrides ``section.name=value``.

    Args:
        file: path, or name of shipped settings.
        overrides: texts ``section.name=value``.

    Raises:
        FileFormatError: an unknown key, a wrong type, a value out of range.
    """
    if file is None:
        return build_settings({}, overrides=overrides, source="--set")
    path = find_settings(file)
    return build_settings(read_toml(path), overrides=overrides, source=str(path))


def settings_text(settings: ControllerSettings) -> str:
    """Settings as a file that ``--settings`` reads back."""
    tables: dict[str, dict[str, Any]] = msgspec.to_builtins(settings)
    return toml_text(tables)
