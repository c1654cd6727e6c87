"""The paper's figures: base pose and left-foot wrench over time, per controller."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.studies import paper as d
from surefoot.studies.cell import Cell, Group

SHOWN = {
    "moving-platform-slow": "One platform, slow",
    "moving-platform-fast": "One platform, fast",
    "two-platforms-fast": "A platform per foot, fast",
    "falling-platform-80": "The left platform falls by 80 mm",
}
COMPARED = (d.WHOLE_BODY, d.TUNED)
EVERY_TICKS = 10


def record(scenario: str, variant: str) -> dict[str, Array]:
    """Signals of every tick of one run with seed 0 and the ideal servo."""
    from surefoot.signals import memory_sinks
    from surefoot.simulation import Simulation
    from surefoot.stabilizer.factory import make_controller

    cell = Cell(Group(scenario, (), variant, d.IDEAL), seed=0)
    plan = cell.plan(robot="walker", overrides=())
    sim = Simulation.of_plan(plan, sinks=memory_sinks())
    sim.run(make_controller(plan.controller, plan.robot, plan.settings))
    return dict(sim.signals)


def draw(title: str, runs: dict[str, dict[str, Array]]) -> bytes:
    """Draw base position and rotation, force and moment of the left sole.

    Args:
        title: of the scenario.
        runs: arrays by controller.

    Returns:
        SVG.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 7.2), layout="constrained")
    figure.suptitle(title)
    grid: Any = figure.subplots(4, len(runs), sharex=True, sharey="row", squeeze=False)
    for column, (variant, arrays) in enumerate(runs.items()):
        time_s = arrays["time_s"][::EVERY_TICKS]
        base = arrays["true_base_pose"]
        panels = (
            (1e3 * (base[:, :3] - base[0, :3]), "xyz"),
            (np.degrees(_roll_pitch_yaw(base[:, 3:])), "rpy"),
            (arrays["true_F"][:, :3], "xyz"),
            (arrays["true_F"][:, 3:6], "xyz"),
        )
        for row, (values, names) in enumerate(panels):
            axes = grid[row, column]
            for index, name in enumerate(names):
                label = {"r": "roll", "p": "pitch"}.get(name, name)
                label = "yaw" if names == "rpy" and index == 2 else label
                axes.plot(time_s, values[::EVERY_TICKS, index], lw=0.9, label=label)
            axes.grid(alpha=0.3)
            if column == len(runs) - 1:  # beside the last one: inside it hides curves
                axes.legend(
                    fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5)
                )
        grid[0, column].set_title(variant)
        grid[-1, column].set_xlabel("time [s]")
    labels = ("base position [mm]", "base rotation [deg]", "force [N]", "moment [N m]")
    for row, label in enumerate(labels):
        grid[row, 0].set_ylabel(label)
    buffer = BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def _roll_pitch_yaw(quat_xyzw: Array) -> Array:
    """Return (n, 3) angles about x, y, z in turn [rad]."""
    from scipy.spatial.transform import Rotation

    angles: Array = Rotation.from_quat(quat_xyzw).as_euler("xyz")
    return angles
