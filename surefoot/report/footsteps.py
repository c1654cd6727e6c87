"""A walk from above: footholds planned and taken, DCM and ZMP against the soles."""

from __future__ import annotations

from io import StringIO
from typing import Any, NamedTuple

import numpy as np

from surefoot.report.run_data import RunData
from surefoot.schemas.arrays import Array
from surefoot.schemas.signals import BY_NAME

PLANNED, TAKEN, DCM, ZMP = "#8a929c", "#0072b2", "#d55e00", "#009e73"
_SINGLE = BY_NAME["walk_phase"].words.index("single")
_SWING = BY_NAME["foot_state"].words.index("swing")
WIDTH_IN, HEIGHTS_IN, MARGIN_IN = 9.0, (1.5, 6.0), 1.3
"""Of the figure; the margin holds axis and legend."""


def footsteps(run: RunData) -> str:
    """Draw the walk of a run.

    Args:
        run: with the signals of a walk.

    Returns:
        SVG; empty for a run without steps.
    """
    signals = run.signals
    if not run.is_walk:
        return ""
    rows = np.flatnonzero(signals["walk_phase"] > 0)
    from matplotlib.figure import Figure

    steps = steps_of(run)
    goals, taken = [step.planned for step in steps], [step.taken for step in steps]
    first = signals["footholds"][rows[0]].reshape(2, 4)
    soles = np.concatenate([_sole(run, place) for place in (*goals, *taken, *first)])
    length, width = np.ptp(soles, axis=0)
    height = float(np.clip(WIDTH_IN * width / length, *HEIGHTS_IN)) + MARGIN_IN
    figure = Figure(figsize=(WIDTH_IN, height), layout="constrained")
    axes: Any = figure.subplots()
    for places, colour, style in (
        (goals, PLANNED, "--"),
        ([*taken, *first], TAKEN, "-"),
    ):
        for place in places:
            axes.plot(*_sole(run, place).T, style, color=colour, linewidth=1.0)
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


class StepTaken(NamedTuple):
    """A step of a run.

    Attributes:
        begin: row at which the foot left.
        side: 0 for the left foot, 1 for the right one.
        planned: (4,) x, y, z [m] and yaw [rad] where it was to be set as it left.
        taken: (4,) where it was in the end.
    """

    begin: int
    side: int
    planned: Array
    taken: Array


def steps_of(run: RunData) -> list[StepTaken]:
    """Return the steps of a run, in order; none of a run without a walk."""
    signals = run.signals
    if not run.is_walk:
        return []
    single = signals["walk_phase"] == _SINGLE
    goals, footholds = signals["foot_goals"], signals["footholds"]
    begins = np.flatnonzero(single[1:] & ~single[:-1]) + 1
    ends = np.flatnonzero(~single[1:] & single[:-1]) + 1
    steps = []
    for begin, end in zip(begins, ends, strict=False):
        states = signals["foot_state"][begin]
        side = int(np.argmax(states == _SWING))
        columns = slice(4 * side, 4 * side + 4)
        steps.append(
            StepTaken(int(begin), side, goals[begin, columns], footholds[end, columns])
        )
    return steps


def _sole(run: RunData, place: Array) -> Array:
    """Corners of a sole, (5, 2), the first one twice [m]."""
    x, y, _, yaw = place.tolist()
    foot = run.robot.file.foot[0]
    length, width = foot.half_length_m, foot.half_width_m
    corners = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1)]) * (length, width)
    cos, sin = np.cos(yaw), np.sin(yaw)
    turned: Array = corners @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
    return turned
