"""Sliders and keys of the live page that have the robot walk."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

from surefoot.planner import VelocityPlanner, walk_on_bus
from surefoot.robot_io.bus.stop_request import StopRequest
from surefoot.robot_io.client_side.planner_client import PlannerClient
from surefoot.robot_io.errors import RobotIoError
from surefoot.robot_io.robot import Robot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.errors import SchemaError
from surefoot.schemas.walk_plan import DOUBLE_S, HEIGHT_M, SINGLE_S
from surefoot.stabilizer.walking.footsteps import Pace, half_width_of
from surefoot.view.controls import Asker

_LOG = logging.getLogger("surefoot")
DIAL_S = 5.0
"""A planner that has found no robot for so long gives up [s]."""


class Rate(NamedTuple):
    """A velocity with its slider and keys.

    Attributes:
        label: with unit.
        limit: both ends of the slider.
        step: of the slider and of a key.
        more: key for more of it.
        less: key for less.
    """

    label: str
    limit: float
    step: float
    more: str
    less: str


RATES = (
    Rate("Ahead [m/s]", 0.4, 0.05, "I", "K"),
    Rate("To the left [m/s]", 0.1, 0.05, "U", "O"),
    Rate("Turn left [deg/s]", 20.0, 5.0, "J", "L"),
)
STOP_KEY: Literal["X"] = "X"
"""Not the space bar, which presses whatever button was clicked last."""


class Stroller:
    """Sends plans for a velocity while somebody wants the robot to walk.

    It is a planner like ``surefoot walk``, on a thread and a session of its own.
    """

    def __init__(
        self, robot: Robot, endpoints: Endpoints, *, tell: Callable[[str], None]
    ) -> None:
        """Prepare; nothing is dialed before somebody wants to walk.

        Args:
            robot: that is to walk.
            endpoints: where to dial.
            tell: told what came of it, in words.
        """
        self._robot, self._endpoints, self._tell = robot, endpoints, tell
        self._planner: VelocityPlanner | None = None
        self._stop = StopRequest()
        self._thread: threading.Thread | None = None

    @property
    def is_walking(self) -> bool:
        """Whether plans are being sent."""
        thread = self._thread
        return thread is not None and thread.is_alive() and not self._stop.is_set

    def go(self, rates: tuple[float, float, float]) -> None:
        """Walk at a velocity, or go on at it.

        Args:
            rates: ahead and to the left [m/s], turn to the left [deg/s].
        """
        ahead, lateral, turn = rates
        pace = Pace(ahead, lateral, math.radians(turn), SINGLE_S, DOUBLE_S, HEIGHT_M)
        if self._planner is None:
            self._planner = VelocityPlanner(pace, half_width=half_width_of(self._robot))
        self._planner.pace = pace
        if not self.is_walking:
            if self._thread is not None:
                self._thread.join()  # brings the feet together first
            self._stop = StopRequest()
            self._thread = threading.Thread(
                target=self._walk, name="stroller", daemon=True
            )
            self._thread.start()

    def stop(self) -> None:
        """Bring the feet together and stand."""
        self._stop.set()

    def _walk(self) -> None:
        assert self._planner is not None
        try:
            with PlannerClient(self._robot, endpoints=self._endpoints) as client:
                client.connect(timeout_s=DIAL_S)
                status = walk_on_bus(client, self._planner, steps=None, stop=self._stop)
        except (RobotIoError, SchemaError) as error:
            self._tell(f"walk: {error}")
            return
        if status is None:
            self._tell("walk: the stabilizer takes no steps")
        elif status.refusal:
            self._tell(f"walk: refused, {status.refusal}")
        else:
            self._tell(f"walk: over, {status.steps_done} steps so far")


class WalkControls:
    """Sliders of a velocity, two buttons and keys.

    Attributes:
        stroller: sends the plans.
    """

    def __init__(
        self, gui: Any, asker: Asker, robot: Robot, endpoints: Endpoints
    ) -> None:
        """Add them.

        Args:
            gui: ``server.gui`` of viser.
            asker: does what is pressed, and shows what came of it.
            robot: that is to walk.
            endpoints: where to dial.
        """
        self._asker = asker
        self.stroller = Stroller(robot, endpoints, tell=asker.note)
        with gui.add_folder("Walk", expand_by_default=False):
            self._sliders = [
                gui.add_slider(
                    rate.label,
                    min=-rate.limit,
                    max=rate.limit,
                    step=rate.step,
                    initial_value=0.0,
                    hint=f"Keys {rate.more} and {rate.less}.",
                )
                for rate in RATES
            ]
            buttons = gui.add_button_group("Steps", ("walk", "stop"))
            gui.add_markdown("Keys: I K ahead, J L turn, U O aside, X stops.")
        buttons.on_click(
            lambda event: self._go() if buttons.value == "walk" else self._halt()
        )
        for slider in self._sliders:
            slider.on_update(lambda event: self._follow())
        for slider, rate in zip(self._sliders, RATES, strict=True):
            for key, sign in ((rate.more, 1.0), (rate.less, -1.0)):
                name = rate.label.split(" [")[0].lower()
                command = gui.add_command(
                    f"Walk: {name}, {'more' if sign > 0.0 else 'less'}", hotkey=key
                )
                command.on_trigger(self._nudger(slider, sign * rate.step))
        gui.add_command("Walk: stop", hotkey=STOP_KEY).on_trigger(
            lambda event: self._halt()
        )

    def watch(self, *, has_visitors: bool) -> None:
        """Stop a robot that nobody looks at any more; called now and then."""
        if self.stroller.is_walking and not has_visitors:
            self._asker.note("walk: stopped, nobody looks at the page")
            self.stroller.stop()

    def _nudger(self, slider: Any, step: float) -> Callable[[Any], None]:
        def nudge(event: Any) -> None:
            value = float(slider.value) + step
            slider.value = round(min(max(value, slider.min), slider.max), 3)
            self._go()

        return nudge

    def _rates(self) -> tuple[float, float, float]:
        ahead, lateral, turn = (float(slider.value) for slider in self._sliders)
        return ahead, lateral, turn

    def _follow(self) -> None:
        if self.stroller.is_walking:
            self.stroller.go(self._rates())

    def _go(self) -> None:
        ahead, lateral, turn = rates = self._rates()
        self._asker.ask(
            f"walk at {ahead:g} m/s, {lateral:g} m/s left, {turn:g} deg/s",
            lambda requests: self.stroller.go(rates),
        )

    def _halt(self) -> None:
        for slider in self._sliders:
            slider.value = 0.0
        self.stroller.stop()
