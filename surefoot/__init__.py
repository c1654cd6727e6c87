"""Surefoot: a force-feedback whole-body stabilizer for position-controlled humanoids.

::

    import surefoot as sf

    run = sf.simulate("walker", "moving-platform-slow", seed=3)
    print(run.outcome, run.result.com_error_rms_mm)

The names in ``__all__`` are the public API. Each is imported when it is first used:
``import surefoot`` is quick and needs none of the extras.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

# Linear algebra of 34 x 34 is slower with threads, and its slowest ticks much slower.
# numpy's libraries read these variables when they load, so they are set before.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

_HOMES = {
    "robot_io.robot": ("Robot", "load_robot", "list_robots"),
    "robot_io.snapshot": ("Snapshot",),
    "robot_io.errors": (
        *("RobotFileError", "RobotIoError", "RobotMismatchError"),
        "RobotUnreachableError",
    ),
    "schemas.errors": ("FileFormatError", "SchemaError"),
    "schemas.messages": ("Reference",),
    "schemas.result": ("RunResult",),
    "schemas.scenario": (
        *("Scenario", "Platform", "Push"),
        *("SensorFault", "Tile"),
    ),
    "schemas.scenario_robot": (
        *("Sensors", "Delay"),
        *("DisplacementRod", "ForceRod", "ModelError", "Payload", "Start"),
        "StrikeRod",
    ),
    "schemas.motions": (
        *("SineMotion", "RampMotion", "DropMotion"),
        *("PrtsMotion", "SpectrumMotion", "RecordedMotion"),
    ),
    "schemas.settings": ("ControllerSettings",),
    "sim_robot.catalogue": ("ScenarioError", "list_scenarios", "load_scenario"),
    "robot_io.robot_side.driver": ("drive",),
    "stabilizer.foreign": ("list_controllers",),
    "stabilizer.controller": ("Controller", "ControllerError", "ControllerOutput"),
    "errors": (
        *("SurefootError", "UsageError", "EnvironmentFailedError"),
        *("ChildFailedError", "RunInterrupted", "TuneInterrupted"),
        *("UnknownSignalError",),
    ),
    "stabilizer.margins.margins": ("AxisMargin", "LoopMargins"),
    "controllers": ("make_controller", "compute_margins"),
    "signals": ("Signals", "read_signals"),
    "simulation": ("Simulation",),
    "runs": ("Run", "simulate", "run", "load_run"),
    "recording.read": ("Record", "read_record"),
    "playback.recompute": ("ReplayOutcome",),
    "playback.check": ("replay",),
    "studies.study": ("Study", "study"),
    "tuning.outcome": ("Tuned",),
    "tuning.tune": ("tune",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}
_MODULES = ("bench",)

__all__ = sorted([*_HOME_OF, *_MODULES])


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f"surefoot.{name}")
    home = _HOME_OF.get(name)
    if home is None:
        raise AttributeError(f"module 'surefoot' has no attribute {name!r}")
    value = getattr(import_module(f"surefoot.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if TYPE_CHECKING:
    from surefoot import bench as bench
    from surefoot.controllers import compute_margins as compute_margins
    from surefoot.controllers import make_controller as make_controller
    from surefoot.errors import ChildFailedError as ChildFailedError
    from surefoot.errors import EnvironmentFailedError as EnvironmentFailedError
    from surefoot.errors import RunInterrupted as RunInterrupted
    from surefoot.errors import SurefootError as SurefootError
    from surefoot.errors import TuneInterrupted as TuneInterrupted
    from surefoot.errors import UnknownSignalError as UnknownSignalError
    from surefoot.errors import UsageError as UsageError
    from surefoot.playback.check import replay as replay
    from surefoot.playback.recompute import ReplayOutcome as ReplayOutcome
    from surefoot.recording.read import Record as Record
    from surefoot.recording.read import read_record as read_record
    from surefoot.robot_io.errors import RobotFileError as RobotFileError
    from surefoot.robot_io.errors import RobotIoError as RobotIoError
    from surefoot.robot_io.errors import RobotMismatchError as RobotMismatchError
    from surefoot.robot_io.errors import RobotUnreachableError as RobotUnreachableError
    from surefoot.robot_io.robot import Robot as Robot
    from surefoot.robot_io.robot import list_robots as list_robots
    from surefoot.robot_io.robot import load_robot as load_robot
    from surefoot.robot_io.robot_side.driver import drive as drive
    from surefoot.robot_io.snapshot import Snapshot as Snapshot
    from surefoot.runs import Run as Run
    from surefoot.runs import load_run as load_run
    from surefoot.runs import run as run
    from surefoot.runs import simulate as simulate
    from surefoot.schemas.errors import FileFormatError as FileFormatError
    from surefoot.schemas.errors import SchemaError as SchemaError
    from surefoot.schemas.messages import Reference as Reference
    from surefoot.schemas.motions import DropMotion as DropMotion
    from surefoot.schemas.motions import PrtsMotion as PrtsMotion
    from surefoot.schemas.motions import RampMotion as RampMotion
    from surefoot.schemas.motions import RecordedMotion as RecordedMotion
    from surefoot.schemas.motions import SineMotion as SineMotion
    from surefoot.schemas.motions import SpectrumMotion as SpectrumMotion
    from surefoot.schemas.result import RunResult as RunResult
    from surefoot.schemas.scenario import Platform as Platform
    from surefoot.schemas.scenario import Push as Push
    from surefoot.schemas.scenario import Scenario as Scenario
    from surefoot.schemas.scenario import SensorFault as SensorFault
    from surefoot.schemas.scenario import Tile as Tile
    from surefoot.schemas.scenario_robot import Delay as Delay
    from surefoot.schemas.scenario_robot import DisplacementRod as DisplacementRod
    from surefoot.schemas.scenario_robot import ForceRod as ForceRod
    from surefoot.schemas.scenario_robot import ModelError as ModelError
    from surefoot.schemas.scenario_robot import Payload as Payload
    from surefoot.schemas.scenario_robot import Sensors as Sensors
    from surefoot.schemas.scenario_robot import Start as Start
    from surefoot.schemas.scenario_robot import StrikeRod as StrikeRod
    from surefoot.schemas.settings import ControllerSettings as ControllerSettings
    from surefoot.signals import Signals as Signals
    from surefoot.signals import read_signals as read_signals
    from surefoot.sim_robot.catalogue import ScenarioError as ScenarioError
    from surefoot.sim_robot.catalogue import list_scenarios as list_scenarios
    from surefoot.sim_robot.catalogue import load_scenario as load_scenario
    from surefoot.simulation import Simulation as Simulation
    from surefoot.stabilizer.controller import Controller as Controller
    from surefoot.stabilizer.controller import ControllerError as ControllerError
    from surefoot.stabilizer.controller import (
        ControllerOutput as ControllerOutput,
    )
    from surefoot.stabilizer.foreign import list_controllers as list_controllers
    from surefoot.stabilizer.margins.margins import AxisMargin as AxisMargin
    from surefoot.stabilizer.margins.margins import LoopMargins as LoopMargins
    from surefoot.studies.study import Study as Study
    from surefoot.studies.study import study as study
    from surefoot.tuning.outcome import Tuned as Tuned
    from surefoot.tuning.tune import tune as tune
