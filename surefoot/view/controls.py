"""Plots, sliders and buttons of the live page."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, NamedTuple

import numpy as np

from surefoot.robot_io.client_side.requests import Requests
from surefoot.robot_io.errors import (
    RequestRefusedError,
    RobotIoError,
    RobotUnreachableError,
)
from surefoot.robot_io.robot import Robot
from surefoot.schemas.errors import SchemaError

WINDOW_S = 12.0
"""Time that a plot shows [s]."""
POINTS = 480
HEIGHT_PX = 160
PADDING_PX = (10, 14, 0, 0)
"""Space around the curves; half a label at the end of an axis needs it [px]."""
RED, GREEN, BLUE, AMBER = "#d8434e", "#1a9c5f", "#1b69dc", "#e08a00"
LIGHT_BLUE, LIGHT_AMBER = "#8db8f5", "#f3c777"
DIRECTIONS = {
    "forward": (1.0, 0.0),
    "back": (-1.0, 0.0),
    "left": (0.0, 1.0),
    "right": (0.0, -1.0),
}
MAX_PUSH_N = 300.0
STOP_RED = (216, 54, 66)
GREY = (94, 104, 116)
SETTLED_S = 0.25
"""Time at rest after which a slider's value is sent [s]."""
SAME = 1e-9
"""A slider that moved less has not been moved by hand."""


class Curve(NamedTuple):
    """Name and colour of one curve."""

    name: str
    colour: str


class Plot(NamedTuple):
    """A plot's title, with unit, and its curves."""

    title: str
    curves: tuple[Curve, ...]


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
    """Plots the last seconds of some numbers."""

    def __init__(self, gui: Any, plot: Plot) -> None:
        """Add the plot to a panel; it is hidden until it has data."""
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
        """Add a point; a time before the last one clears the plot.

        Args:
            time_s: time of the point [s]; a point at the same time is ignored.
            row: one number per curve, in the unit of the plot.
        """
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
        """Send all points to the page."""
        if len(self._times) < 2:
            return
        if not self._handle.visible:
            self._handle.visible = True
        columns = np.array(self._rows, dtype=np.float64).T
        self._handle.data = (np.array(self._times), *columns)


_LOG = logging.getLogger("surefoot")

Request = Callable[[Requests], object]


class Asker:
    """Sends requests on a thread of its own, so that slow answers never block the page.

    Attributes:
        notes: results of the last requests, in words.
    """

    NOTES_KEPT = 4

    def __init__(self) -> None:
        """Start the thread, which ends with the process."""
        self.notes: list[str] = []
        self._requests: Requests | None = None
        self._queue: SimpleQueue[tuple[str, Request, bool]] = SimpleQueue()
        threading.Thread(target=self._work, name="asker", daemon=True).start()

    def through(self, requests: Requests | None) -> None:
        """Use this connection from now on; None when there is no robot."""
        self._requests = requests

    def ask(self, what: str, request: Request, *, by_hand: bool = True) -> None:
        """Queue a request, which the thread will call.

        Args:
            what: the request in words, for notes.
            request: called with the connection.
            by_hand: whether success is noted, too.
        """
        self._queue.put((what, request, by_hand))

    def ask_now(self, what: str, request: Request, by_hand: bool = True) -> None:
        """Call a request at once on the calling thread, before all queued ones."""
        stamp_ns = time.monotonic_ns()
        requests = self._requests
        if requests is None:
            self.note(f"{what}: no robot to ask")
            return
        try:
            request(requests)
        except RequestRefusedError as error:
            self.note(f"{what}: refused, {error.detail}")
        except (RobotIoError, SchemaError) as error:
            self.note(f"{what}: {error}")
        else:
            if by_hand:
                told = f"{what}: done"
                self.note(f"{told} (asked at {stamp_ns} ns)", shown=told)

    def _work(self) -> None:
        while True:
            self.ask_now(*self._queue.get())

    def note(self, text: str, *, shown: str | None = None) -> None:
        """Log a result and show it on the page, or ``shown`` in its place."""
        _LOG.info(text)
        self.notes = [*self.notes, shown or text][-self.NOTES_KEPT :]


def add_controls(gui: Any, asker: Asker) -> None:
    """Add the buttons for e-stop, hold and resume."""
    estop = gui.add_button(
        "E-STOP", color=STOP_RED, hint="The robot keeps its posture until it is reset."
    )
    hold = gui.add_button(
        "Hold",
        color=GREY,
        hint="The robot keeps its posture; the stabilizer keeps command.",
    )
    resume = gui.add_button("Resume", color=GREY, hint="Balance again after a hold.")

    # viser gives its decorators no types.
    @estop.on_click  # type: ignore[untyped-decorator]
    def _(event: Any) -> None:
        asker.ask_now("e-stop", lambda requests: requests.stop_robot())

    @hold.on_click  # type: ignore[untyped-decorator]
    def _(event: Any) -> None:
        asker.ask("hold", lambda requests: requests.control("hold"))

    @resume.on_click  # type: ignore[untyped-decorator]
    def _(event: Any) -> None:
        asker.ask("resume", lambda requests: requests.control("resume"))


def add_push(gui: Any, asker: Asker, robot: Robot) -> None:
    """Add controls to push the robot, which only a simulated robot can obey."""
    with gui.add_folder("Push (simulator only)"):
        force = gui.add_slider(
            "Force [N]", min=10, max=MAX_PUSH_N, step=10, initial_value=120
        )
        duration = gui.add_slider(
            "Duration [s]", min=0.05, max=0.5, step=0.05, initial_value=0.1
        )
        directions = gui.add_button_group("Push", tuple(DIRECTIONS))

    @directions.on_click  # type: ignore[untyped-decorator]
    def _(event: Any) -> None:
        x, y = DIRECTIONS[directions.value]
        newtons, seconds = float(force.value), float(duration.value)
        asker.ask(
            f"push {directions.value}, {newtons:g} N for {seconds:g} s",
            lambda requests: requests.push(
                robot.file.base_link,
                [x * newtons, y * newtons, 0.0],
                duration_s=seconds,
            ),
        )


class Gain(NamedTuple):
    """A slider for one setting, all axes of which it sets to one value.

    Attributes:
        name: name of the setting.
        label: text with unit, short enough for one line of the panel.
        low: lower end of the slider.
        high: upper end of the slider.
        step: step of the slider.
        sign: -1 for a setting that is negative by convention.
    """

    name: str
    label: str
    low: float
    high: float
    step: float
    sign: float = 1.0


GAINS = (
    Gain("tsid.com_kp", "CoM kp [s⁻²]", 5.0, 120.0, 1.0),
    Gain("tsid.com_kd", "CoM kd [s⁻¹]", 1.0, 40.0, 0.5),
    Gain("tsid.base_kp", "Base kp [s⁻²]", 10.0, 300.0, 5.0),
    Gain("tsid.base_kd", "Base kd [s⁻¹]", 2.0, 60.0, 1.0),
    Gain("dik.k_force", "Force |K| [s⁻¹]", 20.0, 200.0, 5.0, -1.0),
    Gain("dik.com_gain", "CoM p [s⁻¹]", 0.5, 6.0, 0.1),
    Gain("dik.base_gain", "Base p [s⁻¹]", 0.5, 6.0, 0.1),
)


class GainSliders:
    """Sliders that show the stabilizer's present gains and change them."""

    def __init__(self, gui: Any, asker: Asker) -> None:
        """Add the sliders, disabled until the stabilizer's gains are known."""
        self._asker = asker
        self._lock = threading.Lock()
        self._known: dict[str, float] = {}
        self._moved: dict[str, float] = {}
        self._moved_at_s = 0.0
        self._handles: dict[str, Any] = {}
        self._is_asked = self._is_late = False
        with gui.add_folder(
            "Gains (ramped over 0.5 s, recorded)", expand_by_default=False
        ):
            for gain in GAINS:
                self._handles[gain.name] = handle = gui.add_slider(
                    gain.label,
                    min=gain.low,
                    max=gain.high,
                    step=gain.step,
                    initial_value=gain.low,
                    disabled=True,
                    hint=gain.name,
                )
                handle.on_update(self._note_move(gain))

    def watch(self, *, has_stabilizer: bool) -> None:
        """Ask a new stabilizer for its gains, and forget those of one that is gone.

        Called in every frame.
        """
        if has_stabilizer and not self._is_asked:
            self._is_asked = True
            self._asker.ask("present gains", self.learn, by_hand=False)
        elif self._is_asked and not has_stabilizer:
            self.forget()

    def forget(self) -> None:
        """Forget the gains, since another stabilizer may have others."""
        self._is_asked = self._is_late = False
        with self._lock:
            self._known, self._moved = {}, {}
        for handle in self._handles.values():
            handle.disabled = True

    def learn(self, requests: Requests) -> None:
        """Ask the stabilizer for its gains and show them.

        If it does not answer in time, it is asked again. The delay is reported once.

        Raises:
            RobotUnreachableError: for the first answer that is late.
        """
        try:
            reply = requests.change_settings({})
        except RobotUnreachableError:
            was_late, self._is_late, self._is_asked = self._is_late, True, False
            if was_late:
                return
            raise
        values = reply.settings
        for gain in GAINS:
            if gain.name not in values:
                continue
            numbers = values[gain.name]
            mean = gain.sign * sum(numbers) / len(numbers)
            shown = min(max(mean, gain.low), gain.high)
            with self._lock:
                self._known[gain.name] = shown
            handle = self._handles[gain.name]
            handle.value = shown
            handle.disabled = False

    def send(self) -> None:
        """Send changed values once the sliders rest; called in every frame."""
        with self._lock:
            if not self._moved or time.monotonic() - self._moved_at_s < SETTLED_S:
                return
            moved, self._moved = self._moved, {}
            self._known.update(moved)
        signs = {gain.name: gain.sign for gain in GAINS}
        changes = {name: [signs[name] * value] for name, value in moved.items()}
        text = ", ".join(f"{name} = {value[0]:g}" for name, value in changes.items())
        self._asker.ask(text, lambda requests: self._change(requests, changes))

    def _change(self, requests: Requests, changes: dict[str, list[float]]) -> None:
        """Change settings; a refusal makes the sliders show the present values."""
        try:
            requests.change_settings(changes)
        except (RobotIoError, SchemaError):
            self._is_asked = False
            raise

    def _note_move(self, gain: Gain) -> Any:
        def on_update(event: Any) -> None:
            value = float(self._handles[gain.name].value)
            with self._lock:
                known = self._known.get(gain.name)
                if known is None or abs(value - known) < SAME:
                    self._moved.pop(gain.name, None)
                    return
                self._moved[gain.name] = value
                self._moved_at_s = time.monotonic()

        return on_update
