"""Rolling plots of the live page."""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

import numpy as np

WINDOW_S = 12.0
POINTS = 480
HEIGHT_PX = 160
PADDING_PX = (10, 14, 0, 0)
"""Above and beside the curves, where half a label at an axis' end needs room."""


class Curve(NamedTuple):
    """One line of a plot: its name and colour."""

    name: str
    colour: str


class Plot(NamedTuple):
    """A plot: title with unit, and its lines."""

    title: str
    curves: tuple[Curve, ...]


RED, GREEN, BLUE, AMBER = "#d8434e", "#1a9c5f", "#1b69dc", "#e08a00"
LIGHT_BLUE, LIGHT_AMBER = "#8db8f5", "#f3c777"
COM_ERROR = Plot(
    "CoM error, estimated [mm]",
    (Curve("x", RED), Curve("y", GREEN), Curve("z", BLUE)),
)
FORCE = Plot(
    "F_z [N]",
    (
        Curve("left", BLUE),
        Curve("left desired", LIGHT_BLUE),
        Curve("right", AMBER),
        Curve("right desired", LIGHT_AMBER),
    ),
)
TILT = Plot("base tilt [deg]", (Curve("roll", RED), Curve("pitch", GREEN)))
TICK = Plot("controller tick [ms]", (Curve("median", BLUE), Curve("99 %", AMBER)))
DCM_ERROR = Plot("DCM error, walking [mm]", (Curve("x", RED), Curve("y", GREEN)))
PLOTS = (COM_ERROR, FORCE, TILT, TICK, DCM_ERROR)


class RollingPlot:
    """The last seconds of some numbers."""

    def __init__(self, gui: Any, plot: Plot) -> None:
        """Add the plot to a panel.

        Args:
            gui: ``server.gui`` of viser.
            plot: what it shows.
        """
        from viser import uplot

        self._times: deque[float] = deque(maxlen=POINTS)
        self._rows: deque[tuple[float, ...]] = deque(maxlen=POINTS)
        width = len(plot.curves)
        self._handle = gui.add_uplot(
            data=(np.array([0.0]), *(np.array([0.0]) for _ in range(width))),
            series=(
                uplot.Series(label="t [s]"),
                *(
                    uplot.Series(label=curve.name, stroke=curve.colour, width=1.5)
                    for curve in plot.curves
                ),
            ),
            scales={"x": uplot.Scale(time=False, auto=True)},
            axes=(
                uplot.Axis(size=28, label="t [s]", labelSize=14, labelGap=0),
                uplot.Axis(size=46),
            ),
            title=plot.title,
            height=HEIGHT_PX,
            padding=PADDING_PX,
            legend=uplot.Legend(show=True, live=False),
            visible=False,
        )

    def add(self, time_s: float, row: tuple[float, ...]) -> None:
        """Keep a point; a time that goes back begins anew."""
        if self._times and time_s <= self._times[-1]:
            if time_s == self._times[-1]:
                return
            self._times.clear()
            self._rows.clear()
        self._times.append(time_s)
        self._rows.append(row)
        while self._times[-1] - self._times[0] > WINDOW_S:
            self._times.popleft()
            self._rows.popleft()

    def draw(self) -> None:
        """Send what is kept to the page."""
        if len(self._times) < 2:
            return
        if not self._handle.visible:
            self._handle.visible = True
        columns = np.array(self._rows, dtype=np.float64).T
        self._handle.data = (np.array(self._times), *columns)
