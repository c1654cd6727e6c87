"""A walk from above: footholds planned and taken, DCM and ZMP against the soles."""

from __future__ import annotations

from io import StringIO
from typing import Any

import numpy as np

from surefoot.report.run_data import RunData
from surefoot.schemas.arrays import Array
from surefoot.schemas.signals import BY_NAME

PLANNED, TAKEN, DCM, ZMP = "#8a929c", "#0072b2", "#d55e00", "#009e73"
_SINGLE = BY_NAME["walk_phase"].words.index("single")
WIDTH_IN, HEIGHTS_IN, MARGIN_IN = 9.0, (1.5, 6.0), 1.3
"""Of the figure; the margin holds axis and legend."""
_WALKS = 0.5
"""Numbers of phases other than standing are larger."""


def footsteps(run: RunData) -> str:
    """Draw the walk of a run.

    Args:
        run: with the signals of a walk.

    Returns:
        SVG; empty for a run without steps.
    """
    signals = run.signals
    if "foot_goals" not in signals:
        return ""
    phase = signals["walk_phase"]
    rows = np.flatnonzero(phase > _WALKS)
    if not len(rows):
        return ""
    from matplotlib.figure import Figure

    goals, taken = _steps(phase, signals["foot_goals"], signals["footholds"])
    soles = np.concatenate([_sole(run, *place) for place in goals + taken])
    length, width = np.ptp(soles, axis=0)
    height = float(np.clip(WIDTH_IN * width / length, *HEIGHTS_IN)) + MARGIN_IN
    figure = Figure(figsize=(WIDTH_IN, height), layout="constrained")
    axes: Any = figure.subplots()
    for places, colour, style in ((goals, PLANNED, "--"), (taken, TAKEN, "-")):
        for side, x, y, yaw in places:
            corners = _sole(run, side, x, y, yaw)
            axes.plot(*corners.T, style, color=colour, linewidth=1.0)
    for name, colour, style, label in (
        ("zmp_reference", ZMP, "-", "ZMP, reference"),
        ("dcm_reference", DCM, "--", "DCM, reference"),
        ("dcm", DCM, "-", "DCM, estimated"),
    ):
        axes.plot(*signals[name][rows].T, style, color=colour, lw=0.9, label=label)
    axes.plot([], [], "--", color=PLANNED, label="soles, planned")
    axes.plot([], [], "-", color=TAKEN, label="soles, set down")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=5, fontsize=8)
    text = StringIO()
    figure.savefig(text, format="svg")
    whole = text.getvalue()
    return whole[whole.index("<svg") :]


Placed = tuple[int, float, float, float]
"""A sole: side, x, y [m] and yaw [rad]."""


def _steps(
    phase: Array, goals: Array, footholds: Array
) -> tuple[list[Placed], list[Placed]]:
    """Where soles were planned as they left, and where they were in the end."""
    single = phase == _SINGLE
    begins = np.flatnonzero(single[1:] & ~single[:-1]) + 1
    ends = np.flatnonzero(~single[1:] & single[:-1]) + 1
    planned: list[Placed] = []
    taken: list[Placed] = []
    for begin, end in zip(begins, ends, strict=False):
        moved = np.abs(footholds[end] - footholds[begin]).reshape(2, 4).sum(axis=1)
        side = int(np.argmax(moved))
        columns = slice(4 * side, 4 * side + 4)
        for places, row in ((planned, goals[begin]), (taken, footholds[end])):
            x, y, _, yaw = row[columns].tolist()
            places.append((side, x, y, yaw))
    for side in range(2):
        x, y, _, yaw = footholds[begins[0]][4 * side : 4 * side + 4].tolist()
        taken.append((side, x, y, yaw))
    return planned, taken


def _sole(run: RunData, side: int, x: float, y: float, yaw: float) -> Array:
    """Corners of a sole, (5, 2), the first one twice [m]."""
    foot = run.robot.file.foot[side]
    length, width = foot.half_length_m, foot.half_width_m
    corners = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1)]) * (length, width)
    cos, sin = np.cos(yaw), np.sin(yaw)
    turned: Array = corners @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
    return turned
