"""The plan of a run: all its inputs, loaded and checked before anything starts.

Runs in one process and on the bus, studies and searches are made from plans.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from surefoot.errors import UsageError
from surefoot.robot_files.judge import warnings_of
from surefoot.robot_files.scenario_fit import scale_to_robot as fitted
from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.relay.relay import find_plan
from surefoot.robot_io.robot import (
    Robot,
    load_robot,
    make_robot,
    with_servo_profile,
)
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.relay_plan import RelayPlan, load_relay_plan
from surefoot.schemas.scenario import (
    Push,
    Scenario,
    load_scenario,
    recordings,
    scenario_from_table,
    with_recordings,
)
from surefoot.schemas.settings import ControllerSettings, build_settings
from surefoot.schemas.toml_file import plain, read_toml, struct_table, toml_text
from surefoot.schemas.walk_plan import WalkPlan
from surefoot.sim_robot.catalogue import find_scenario, naming_scenario
from surefoot.sim_robot.conventions import check_duration
from surefoot.sim_robot.recorded import recorded_ground
from surefoot.stabilizer.factory import (
    check_one_read,
    check_read,
    check_settings,
    find_settings,
)

Mode = Literal["lockstep", "realtime", "inline"]
Settings = ControllerSettings | Mapping[str, Any] | str | Path | None
"""Accepted forms of settings: resolved settings, ``{"tsid.base_kp": 120.0}``, the name
of shipped settings, a file, or None for the defaults."""

_log = logging.getLogger("surefoot.run")


@dataclass(frozen=True)
class RunPlan:
    """All inputs of a run.

    Attributes:
        scenario: ground, pushes and faults.
        scenario_name: shipped name, name of the file without its suffix, or the
            scenario's own name where it was built in Python.
        scenario_path: the scenario's file; None where it was built in Python.
        robot: the robot, with the servo profile in use.
        robot_name: a shipped name, or the whole path of its file.
        controller: name of the control law; see
            :func:`surefoot.stabilizer.factory.find_controller`.
        settings: resolved: defaults, file and overrides.
        seed: of the sensor noise.
        mode: how the two sides are paced.
        relay: faults of a relay between the two; None without a relay.
        relay_path: the file of these faults.
    """

    scenario: Scenario
    scenario_name: str
    scenario_path: Path | None
    robot: Robot
    robot_name: str
    controller: str
    settings: ControllerSettings
    seed: int
    mode: Mode
    relay: RelayPlan | None = None
    relay_path: Path | None = None

    @property
    def total_ticks(self) -> int:
        """Ticks of the whole scenario."""
        return round(self.scenario.duration_s / self.robot.period_s)

    @cached_property
    def walk(self) -> WalkPlan | None:
        """The steps of the scenario's walk; None when it has none."""
        if self.scenario.walk is None:
            return None
        return _steps(self.scenario, self.robot, self.settings)

    @property
    def recordings(self) -> dict[str, str]:
        """Files of recorded ground, each with its name in the run's folder."""
        files = dict.fromkeys(motion.file for motion in recordings(self.scenario))
        return {
            file: f"ground-{index}{Path(file).suffix}"
            for index, file in enumerate(files)
        }

    @property
    def files(self) -> list[Path]:
        """Files that the run reads again at its start or later."""
        paths = (self.scenario_path, self.relay_path, *map(Path, self.recordings))
        return [path for path in paths if path is not None]

    @property
    def scenario_text(self) -> str:
        """The scenario as TOML: the text of its file, or written from the struct.

        A scenario with recordings names the copies in the run's folder.
        """
        copies = self.recordings
        if self.scenario_path is not None and not copies:
            return self.scenario_path.read_text(encoding="utf-8")
        scenario = with_recordings(self.scenario, lambda motion: copies[motion.file])
        return toml_text(struct_table(scenario))


def make_plan(
    scenario: str | Path | Scenario,
    *,
    robot: str | Path | Robot = "walker",
    servo_profile: str | None = None,
    controller: str = "whole-body",
    settings: Settings = None,
    overrides: Sequence[str] = (),
    seed: int = 0,
    mode: Mode = "inline",
    relay: str | None = None,
    scale_to_robot: bool = False,
    duration_s: float | None = None,
    pushes: Sequence[Push] = (),
) -> RunPlan:
    """Load all files a run depends on.

    Args:
        scenario: shipped name, path of a TOML, or a scenario built in Python.
        robot: shipped name, path of a TOML, or a loaded robot.
        servo_profile: a profile of the robot file to use instead of its own choice.
        controller: name of the control law.
        settings: see :data:`Settings`.
        overrides: further settings as texts ``section.name=value``.
        seed: of the sensor noise, 0 or more.
        mode: how the two sides are paced.
        relay: a shipped relay plan or the path of one, for a relay between them.
        scale_to_robot: reduce motions and pushes that are too large for the robot.
        duration_s: duration of the run instead of the scenario's [s].
        pushes: pushes in addition to the scenario's.

    Raises:
        UsageError: a relay in lockstep; no scenario, or one that cannot be scaled; a
            push after the end; an invalid seed.
        ScenarioError: no such scenario, or no such recording of its ground.
        RobotFileError: no such robot, or its files contradict each other.
        FileFormatError: a file or an override is malformed; settings contradict each
            other, the robot or the scenario; the controller does not read an
            override.
    """
    _check_seed(seed)
    relay_path = None if relay is None else _find_relay_plan(relay, mode)
    path: Path | None = None
    if isinstance(scenario, Scenario):  # checked like one from a file
        table = struct_table(scenario)
        world = scenario_from_table(table, source=repr(scenario.name))
        name = world.name
    elif not isinstance(scenario, (str, Path)):
        raise UsageError(
            f"scenario: got a {type(scenario).__name__}, expected a name, the path of "
            "a TOML, or a Scenario; sf.Scenario(name=..., duration_s=...) makes one"
        )
    else:
        path = find_scenario(str(scenario))
        world, name = load_scenario(path), path.stem
    if duration_s is not None:
        world, path = _changed(world, "--duration", duration_s=duration_s), None
    if pushes:
        added = [*world.push, *pushes]
        world, path = _changed(world, "--push", push=[*map(struct_table, added)]), None
        late = [push for push in pushes if push.start_s >= world.duration_s]
        if late:
            raise UsageError(
                f"--push: a push at {late[0].start_s:g} s: the run ends at "
                f"{world.duration_s:g} s; push earlier, or run longer"
            )
    with naming_scenario(path or Path(world.name)):
        recorded_ground(world)
    model = resolve_robot(robot, servo_profile)
    what = f"{path or world.name}: duration_s" if duration_s is None else "--duration"
    check_duration(world.duration_s, model.period_s, what=what)
    for warning in warnings_of(model):
        _log.warning("%s", warning)
    if scale_to_robot:
        world, told = fitted(world, model)
        if told:
            path = None  # the run keeps the scenario as it is run
            _log.info("%s", told)
    is_shipped = not isinstance(robot, Robot) and Path(robot).suffix != ".toml"
    resolved = resolve_settings(settings, overrides=overrides, reader=controller)
    check_read(overrides, [controller])
    check_settings(resolved, model, duration_s=world.duration_s)
    return RunPlan(
        scenario=world,
        scenario_name=name,
        scenario_path=path,
        robot=model,
        robot_name=str(robot) if is_shipped else str(model.path),
        controller=controller,
        settings=resolved,
        seed=int(seed),
        mode=mode,
        relay=None if relay_path is None else load_relay_plan(relay_path),
        relay_path=relay_path,
    )


def _changed(scenario: Scenario, option: str, **keys: Any) -> Scenario:
    """Return a scenario with other values; an error is that of the option.

    Raises:
        FileFormatError: a value is out of range, or contradicts the scenario.
    """
    try:
        return scenario_from_table({**struct_table(scenario), **keys}, source=option)
    except FileFormatError as error:
        told = str(error).removeprefix(f"{option}: ")
        for key in keys:
            told = told.removeprefix(f"{key}: ")
        raise FileFormatError(f"{option}: {told}", field=error.field) from error


def steps_of(name: str, robot: Robot, settings: ControllerSettings) -> WalkPlan:
    """Return the steps of a scenario's walk.

    Raises:
        ScenarioError: no such scenario.
        FileFormatError: it is malformed, or has no walk.
    """
    path = find_scenario(name)
    scenario = load_scenario(path)
    if scenario.walk is None:
        raise FileFormatError(
            f"{path}: has no [walk] table; name a scenario in which the robot walks",
            field="walk",
        )
    return _steps(scenario, robot, settings)


def _steps(scenario: Scenario, robot: Robot, settings: ControllerSettings) -> WalkPlan:
    # The import is slow: report bad files first.
    from surefoot.stabilizer.walking.footsteps import plan_of

    assert scenario.walk is not None
    return plan_of(scenario.walk, robot, settings.walk, duration_s=scenario.duration_s)


def _check_seed(seed: int) -> None:
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        raise UsageError(f"seed: got {seed!r}, expected a whole number, 0 or more")


def resolve_robot(robot: str | Path | Robot, servo_profile: str | None) -> Robot:
    """Load a robot unless it is loaded, and select its servo profile.

    Raises:
        RobotFileError: no such robot, or its files contradict each other.
        FileFormatError: a file is malformed, or has no such profile.
    """
    if not isinstance(robot, Robot):
        return load_robot(robot, servo_profile=servo_profile)
    if servo_profile is None or servo_profile == robot.file.servo.profile:
        return robot
    file = with_servo_profile(robot.file, servo_profile, path=robot.path)
    return make_robot(file, path=robot.path, urdf_path=robot.urdf_path)


def check_on_disk(robot: Robot) -> None:
    """Check that a robot's file holds it, for whoever loads it from there.

    Raises:
        UsageError: with its servo profile the file gives another robot, or none.
    """
    profile = robot.file.servo.profile
    try:
        held = load_robot(robot.path, servo_profile=profile)
    except (RobotFileError, FileFormatError) as error:
        differing = f"its file gives none: {error}"
    else:
        parts = [
            (name, getattr(robot.file, name), getattr(held.file, name))
            for name in robot.file.__struct_fields__
        ]
        # All else of a robot follows from its file and its URDF.
        parts += [
            (field.name, getattr(robot, field.name), getattr(held, field.name))
            for field in fields(robot)
            if field.name != "file"
        ]
        names = [name for name, ours, theirs in parts if not _same(ours, theirs)]
        if not names:
            return
        differing = f"differing: {', '.join(names)}"
    raise UsageError(
        f"robot {robot.file.name!r}: got a Robot changed in Python, or whose file was "
        f"changed since; expected what {robot.path} holds with servo profile "
        f"{profile!r} ({differing}). Other processes, studies and saved runs load the "
        "robot from its file: write the changes to a file, such as one that `extends` "
        "it, and load that; sf.simulate takes a Robot as it is"
    )


def _same(one: Any, other: Any) -> bool:
    is_array = isinstance(one, np.ndarray) or isinstance(other, np.ndarray)
    return np.array_equal(one, other) if is_array else bool(one == other)


def _find_relay_plan(relay: str, mode: Mode) -> Path:
    """Find a relay plan and check it here, before a child process needs it."""
    if mode == "lockstep":
        raise UsageError(
            "--relay needs --realtime, or --inline in simulated time: in lockstep "
            "the robot's time stands still until a command comes, so that nothing is "
            "ever late, and what is lost stops it"
        )
    return find_plan(relay)


def resolve_settings(
    settings: Settings = None,
    *,
    overrides: Sequence[str] = (),
    reader: str | None = None,
) -> ControllerSettings:
    """Join defaults, given settings and overrides ``section.name=value``.

    Args:
        settings: see :data:`Settings`.
        overrides: texts ``section.name=value``.
        reader: the controller that is to read them, if there is one alone.

    Raises:
        FileFormatError: an unknown key, a wrong type, a value out of range; a file of
            which the reader uses no setting.
        ControllerError: there is no such controller.
    """
    texts = list(overrides)
    if settings is None:
        return build_settings({}, overrides=texts, source="--set")
    if isinstance(settings, ControllerSettings):
        return build_settings(plain(settings), overrides=texts, source="settings")
    if isinstance(settings, Mapping):
        table = _sections(plain(settings))
        return build_settings(table, overrides=texts, source="settings")
    path = find_settings(Path(settings))
    table = read_toml(path)
    resolved = build_settings(table, overrides=texts, source=str(path))
    if reader is not None:
        names = [f"{section}.{name}" for section in table for name in table[section]]
        check_one_read(names, reader, source=str(path))
    return resolved


def _sections(values: Mapping[str, Any]) -> dict[str, Any]:
    """Turn ``{"tsid.base_kp": 120.0}`` into tables; keep tables as they are."""
    tables: dict[str, Any] = {}
    for name, value in values.items():
        section, dot, key = name.partition(".")
        if not dot:
            tables[name] = value
            continue
        tables.setdefault(section, {})[key] = value
    return tables


def settings_text(settings: ControllerSettings) -> str:
    """Return settings as a file that ``--settings`` reads back."""
    return toml_text(msgspec.to_builtins(settings))
