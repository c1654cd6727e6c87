"""Draws a recorded run: ground, CoM error and normal forces over time.

    surefoot run moving-platform-slow --inline --out out/slow
    python -m benchmarks.plot_run out/slow out/slow.png

Needs matplotlib (pip install matplotlib).
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.robot_io.robot import load_robot
from surefoot.signals import read_signals
from surefoot.sim_robot.catalogue import load_scenario
from surefoot.sim_robot.plant import Plant

MM = 1e3
NO_MATPLOTLIB = "plot_run needs matplotlib; get it with: pip install matplotlib"
COLOURS = {"x": "#c0392b", "y": "#27ae60", "z": "#1f5fa8"}


def tilt_angles(quat_xyzw: Any) -> tuple[Any, Any]:
    """Return roll and pitch of R = Rz Ry Rx [deg].

    Args:
        quat_xyzw: (ticks, 4).
    """
    x, y, z, w = quat_xyzw.T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    return np.degrees(roll), np.degrees(pitch)


def draw(run: Path, picture: Path) -> None:
    """Draw the run in a folder that ``surefoot run --out`` filled."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    signals = read_signals(run)
    scenario = load_scenario(str(run / "scenario.toml"))
    about = json.loads((run / "run.json").read_text(encoding="utf-8"))
    reference = Plant(load_robot(about["robot"]), scenario, seed=0).com_reference
    time_s = signals.time_s
    soles = 0.5 * (signals["true_sole_left"] + signals["true_sole_right"])
    error = MM * (signals["true_com"] - reference)
    error[:, :2] -= MM * soles[:, :2]
    figure, (ground, com, force) = plt.subplots(
        3, 1, figsize=(9.0, 7.0), sharex=True, layout="constrained"
    )
    platform = signals["true_platform_pose"][:, 0]
    heights = platform[:, 2]
    roll, pitch = tilt_angles(platform[:, 3:])
    ground.plot(time_s, MM * heights, color=COLOURS["z"], label="height [mm]")
    ground.plot(time_s, 10 * roll, color=COLOURS["x"], label="roll [0.1 deg]")
    ground.plot(time_s, 10 * pitch, color=COLOURS["y"], label="pitch [0.1 deg]")
    ground.set_ylabel("platform")
    for axis, name in enumerate("xyz"):
        com.plot(time_s, error[:, axis], color=COLOURS[name], label=name)
    com.set_ylabel("CoM error [mm]")
    normals = signals["true_F"][:, (2, 8)]
    force.plot(time_s, normals[:, 0], lw=0.8, color="#8e44ad", label="left")
    force.plot(time_s, normals[:, 1], lw=0.8, color="#e67e22", label="right")
    force.set_ylabel("normal force [N]")
    force.set_ylim(bottom=0.0)
    force.set_xlabel("time [s]")
    for axes in (ground, com, force):
        axes.grid(alpha=0.3)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
    figure.suptitle(f"{scenario.name}: {about['robot']}, {about['controller']}")
    figure.savefig(picture, dpi=110)


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("picture", type=Path)
    arguments = parser.parse_args()
    try:
        draw(arguments.run, arguments.picture)
    except ModuleNotFoundError as error:
        if error.name != "matplotlib":
            raise
        print(NO_MATPLOTLIB, file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
