"""Names and contents of the files in the folder of a run."""

from __future__ import annotations

import platform
import shutil
import sys
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np

from cli.atomic_file import atomic_file
from cli.run_directory import MARKER
from cli.run_plan import RunPlan, settings_text
from schemas.arrays import Array

RESULT = "result.json"
SETTINGS = "settings.toml"
SCENARIO = "scenario.toml"
RELAY = "relay.toml"
TICKS = "ticks.npz"
RECORD = "run.mcap"
QP_FAILURE = "qp-failure.npz"
_PACKAGES = ("surefoot", "eclipse-zenoh", "mujoco", "pin", "piqp", "numpy", "msgspec")
_T = TypeVar("_T", bound=msgspec.Struct)


def write_inputs(folder: Path, plan: RunPlan) -> None:
    """Writes what a run depends on: scenario, settings, relay plan, and who ran it.

    With the scenario, the settings and the seed in ``run.json`` the run can be done
    again.
    """
    shutil.copyfile(plan.scenario_path, folder / SCENARIO)
    (folder / SETTINGS).write_text(settings_text(plan.settings), encoding="utf-8")
    if plan.relay_path is not None:
        shutil.copyfile(plan.relay_path, folder / RELAY)
    about = {
        "command": sys.argv[1:],
        "scenario": plan.scenario_name,
        "robot": plan.robot_name,
        "servo_profile": plan.robot.file.servo.profile,
        "controller": plan.controller,
        "seed": plan.seed,
        "mode": plan.mode,
        "relay": None if plan.relay_path is None else plan.relay_path.stem,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": {name: _version(name) for name in _PACKAGES},
    }
    (folder / MARKER).write_bytes(msgspec.json.format(msgspec.json.encode(about)))


def write_struct(path: Path, value: msgspec.Struct) -> None:
    """Writes a struct as JSON, whole or not at all."""
    with atomic_file(path) as file:
        file.write(msgspec.json.format(msgspec.json.encode(value)) + b"\n")


def read_struct(path: Path, kind: type[_T]) -> _T:
    """Reads what :func:`write_struct` wrote."""
    return msgspec.json.decode(path.read_bytes(), type=kind)


def write_arrays(path: Path, arrays: dict[str, Array]) -> None:
    """Writes named arrays as a compressed .npz, whole or not at all."""
    with atomic_file(path) as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
