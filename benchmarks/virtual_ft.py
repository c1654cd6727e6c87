"""Wrenches inferred from joint efforts, compared with those of ankle sensors.

    python -m benchmarks.virtual_ft [--robot g1] [--seeds 2] [--duration 5] [--jobs 1]

Each row is a scenario and a case of ankles. Each run is a shipped scenario, scaled
to the robot's reach and cut short, in one process. Robots other than the Walker are
those of ``benchmarks.humanoids``. The table compares the controller's normal force and
moments about the soles' x and y with the simulator's truth (rms error from 1 s on), and
shows how many runs stood and the largest CoM error. Prints Markdown.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from joblib import Parallel, delayed

import surefoot as sf
from benchmarks.humanoids import HUMANOIDS
from surefoot.presentation import markdown
from surefoot.robot_files.scenario_fit import scale_to_robot
from surefoot.robot_io.robot import Robot
from surefoot.schemas.robot_file import VirtualForceTorque

SCENARIOS = ("standing", "moving-platform-slow", "moving-platform-fast")
SETTLED_S = 1.0
NORMALS, TILTS = [2, 8], [3, 4, 9, 10]
"""Indices in the stacked wrenches of both soles."""

COLUMNS = (
    "scenario",
    "ankles",
    "up",
    "normal force [N]",
    "moments [N m]",
    "CoM max [mm]",
)


class Case(NamedTuple):
    """A robot with or without ankle sensors, and errors unknown to the controller."""

    name: str
    virtual: VirtualForceTorque | None
    error: dict[str, float]


EXACT = VirtualForceTorque()
NOISY = VirtualForceTorque(effort_noise_nm=0.5)
CASES = (
    Case("ankle sensors, noise 2 N and 0.1 N m", None, {}),
    Case("virtual, exact efforts", EXACT, {}),
    Case("virtual, efforts with noise of 0.5 N m", NOISY, {}),
    Case("virtual, noise, joint friction 1 N m", NOISY, {"joint_friction_nm": 1.0}),
    Case("virtual, noise, joint friction 3 N m", NOISY, {"joint_friction_nm": 3.0}),
    Case("virtual, noise, masses 5 % larger", NOISY, {"mass_scale": 1.05}),
)


class Figures(NamedTuple):
    """Figures of one run."""

    outcome: str
    normal_n: float
    moment_nm: float
    com_mm: float


def run_case(
    case: Case, scenario_name: str, seed: int, robot: Robot, duration_s: float
) -> Figures:
    """Run one cell."""
    shipped, _ = scale_to_robot(sf.load_scenario(scenario_name), robot)
    error = msgspec.structs.replace(shipped.model_error, **case.error)
    scenario = msgspec.structs.replace(
        shipped, duration_s=duration_s, model_error=error
    )
    file = msgspec.structs.replace(robot.file, virtual_ft=case.virtual)
    robot = replace(robot, file=file)
    run: Any = sf.simulate(robot, scenario, controller="whole-body", seed=seed)
    signals = run.signals
    late = signals["time_s"] > SETTLED_S
    wrong = (signals["F_meas"] - signals["true_F"])[late]
    return Figures(
        str(run.outcome),
        float(np.sqrt(np.mean(wrong[:, NORMALS] ** 2))),
        float(np.sqrt(np.mean(wrong[:, TILTS] ** 2))),
        float(np.max(run.result.com_error_max_mm)),
    )


def main() -> None:
    """Run all cells and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", choices=["walker", *HUMANOIDS], default="walker")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--duration", type=float, default=5.0)
    parser.add_argument("--jobs", type=int, default=1)
    words = parser.parse_args()
    cells = list(product(CASES, SCENARIOS, range(words.seeds)))
    with tempfile.TemporaryDirectory() as folder:
        robot = (
            sf.load_robot("walker")
            if words.robot == "walker"
            else HUMANOIDS[words.robot].make(Path(folder)).robot
        )
        found = Parallel(n_jobs=words.jobs)(
            delayed(run_case)(*cell, robot, words.duration) for cell in cells
        )
    by_row: dict[tuple[str, str], list[Figures]] = {}
    for (case, scenario, _), figures in zip(cells, found, strict=True):
        by_row.setdefault((scenario, case.name), []).append(figures)
    lines = []
    for (scenario, name), rows in sorted(by_row.items(), key=lambda item: item[0][0]):
        up = sum(row.outcome == "stood" for row in rows)
        normal, moment = (
            np.mean([getattr(row, figure) for row in rows])
            for figure in ("normal_n", "moment_nm")
        )
        worst = max(row.com_mm for row in rows)
        told = (f"{normal:.1f}", f"{moment:.2f}", f"{worst:.1f}")
        lines.append((scenario, name, f"{up} of {len(rows)}", *told))
    print(markdown(COLUMNS, lines), end="")


if __name__ == "__main__":
    main()
