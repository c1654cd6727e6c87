"""A walk on the live page: footsteps and DCM in the scene, sliders and keys."""

from __future__ import annotations

import logging
import math
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from surefoot.planner import VelocityPlanner, walk_on_bus
from surefoot.robot_io.client_side.requests import PlannerClient
from surefoot.robot_io.errors import RobotIoError
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Mat
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.errors import SchemaError
from surefoot.schemas.walk_plan import DOUBLE_S, HEIGHT_M, SINGLE_S
from surefoot.stabilizer.walking.footsteps import Pace, half_width_of
from surefoot.view.controls import Asker
from surefoot.view.scene_state import (
    SceneState,
    WalkSight,
    odometry_in_world,
    sole_corners,
)

AWAY = (0.0, 0.0, -50.0)
"""Where nodes are put that are not to be seen [m]."""
PLANNED, TAKEN, DCM = (240, 150, 20), (20, 105, 220), (0, 150, 160)
MOST_TAKEN, MOST_PLANNED = 12, 6
MOVED_M = 0.01
"""A foot that was set down farther than this from its last place has stepped [m]."""
LIFT_M = 0.008
"""Height at which soles are drawn above the ground [m]."""
UNDER_BOTH_M = 0.7
"""A platform longer and wider than this can carry both feet [m]."""
FOLLOWED = 0.08
"""Share of the distance to the feet that the picture follows in each frame [1]."""
DIAL_S = 5.0
"""Time to reach the robot, after which a walk is given up [s]."""
STOP_KEY: Literal["X"] = "X"
"""Not the space bar, which presses the button that was clicked last."""


def _attitude(state: SceneState) -> Mat:
    """Return the (3, 3) attitude of the ground under a walk.

    It is that of the platform under both feet, or level.
    """
    for block in state.ground:
        is_wide = min(block.size[:2]) > UNDER_BOTH_M
        if is_wide and 0 <= block.platform < len(state.platforms):
            return state.platforms[block.platform][:3, :3]
    return np.eye(3)


class WalkScene:
    """Nodes that show a walk; hidden while the robot stands.

    Attributes:
        middle: (2,) smoothed middle of the feet in the world [m], which the picture
            follows.
    """

    def __init__(self, scene: Any, robot: Robot) -> None:
        """Add all nodes."""
        self._feet = robot.file.foot
        self._taken: deque[Array] = deque(maxlen=MOST_TAKEN)
        self._last: list[Array | None] = [None, None]
        self.middle: Array = np.zeros(2)
        self._frame = scene.add_frame("/world/walk", show_axes=False)
        nothing = np.zeros((4, 2, 3)) + AWAY
        # A fixed number of lines: for another number the browser makes new ones.
        self._taken_lines, self._planned_lines = (
            scene.add_line_segments(
                f"/world/walk/{name}",
                np.tile(nothing, (count, 1, 1)),
                colour,
                thickness=0.007,
            )
            for name, count, colour in (
                ("taken", MOST_TAKEN, TAKEN),
                ("planned", MOST_PLANNED, PLANNED),
            )
        )
        self._dcm, self._dcm_reference, self._zmp = (
            scene.add_cylinder(
                f"/world/walk/{name}", radius, 0.005, colour, position=AWAY
            )
            for name, radius, colour in (
                ("dcm", 0.022, DCM),
                ("dcm_reference", 0.03, PLANNED),
                ("zmp_reference", 0.014, PLANNED),
            )
        )

    def update(self, state: SceneState, soles: tuple[Mat, Mat]) -> None:
        """Move all nodes to a state.

        Args:
            state: state of the whole scene.
            soles: (4, 4) world from sole, left and right.
        """
        walk = state.walk
        if self._frame.visible is not (walk is not None):
            self._frame.visible = walk is not None
            self._taken.clear()
            self._last = [None, None]
            self.middle[:] = 0.0
        if walk is None or not any(walk.on_ground):
            return
        self._note_steps(walk)
        side = 0 if walk.on_ground[0] else 1
        T = odometry_in_world(walk, soles, _attitude(state))
        x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
        self._frame.wxyz, self._frame.position = (w, x, y, z), tuple(T[:3, 3])
        planned = list(walk.planned[:MOST_PLANNED])
        self._planned_lines.points = self._outlines(planned, MOST_PLANNED)
        level = float(walk.footholds[side][2]) + LIFT_M
        for node, place, up in (
            (self._dcm_reference, walk.dcm_reference, 0.0),
            (self._dcm, walk.dcm, 0.003),
            (self._zmp, walk.zmp_reference, 0.006),
        ):
            node.position = (float(place[0]), float(place[1]), level + up)
        middle = T @ [*walk.footholds[:, :3].mean(axis=0), 1.0]
        self.middle += FOLLOWED * (middle[:2] - self.middle)

    def _note_steps(self, walk: WalkSight) -> None:
        """Keep each new foothold of a foot."""
        changed = False
        for side, place in enumerate(walk.footholds):
            last = self._last[side]
            if not walk.on_ground[side]:
                continue
            if last is None or np.hypot(*(place - last)[:2]) > MOVED_M:
                self._taken.append(place.copy())
                self._last[side], changed = place.copy(), True
        if changed:
            self._taken_lines.points = self._outlines(list(self._taken), MOST_TAKEN)

    def _outlines(self, places: list[Array], count: int) -> Array:
        """Return (4 count, 2, 3) edges of the soles [m]; missing ones lie far away."""
        edges = np.zeros((count, 4, 2, 3)) + AWAY
        for index, (x, y, z, yaw) in enumerate(places):
            sole = np.eye(4)
            sole[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
            sole[:3, 3] = x, y, z + LIFT_M
            corners = sole_corners(self._feet[0], sole)
            edges[index] = np.stack((corners, np.roll(corners, -1, axis=0)), axis=1)
        return edges.reshape(-1, 2, 3)


_LOG = logging.getLogger("surefoot")


class Rate(NamedTuple):
    """One component of the velocity, with its slider and keys.

    Attributes:
        label: text with unit.
        limit: largest value of the slider, and of its negative.
        step: step of the slider and of each key press.
        more: key that increases it.
        less: key that decreases it.
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


class Stroller:
    """Sends footsteps for a velocity while the user wants the robot to walk.

    It plans like ``surefoot walk``, on its own thread and bus session.

    Attributes:
        stops: how often the walk was stopped.
    """

    def __init__(
        self, robot: Robot, endpoints: Endpoints, *, tell: Callable[[str], None]
    ) -> None:
        """Prepare; dials the robot only when a walk is asked for."""
        self._robot, self._endpoints, self._tell = robot, endpoints, tell
        self._planner: VelocityPlanner | None = None
        self._stop = StopRequest()
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()
        self.stops = 0

    @property
    def is_walking(self) -> bool:
        """Whether footsteps are being sent."""
        thread = self._thread
        return thread is not None and thread.is_alive() and not self._stop.is_set

    def go(self, rates: tuple[float, float, float], *, since: int) -> None:
        """Walk at a velocity, or change to it, unless stopped meanwhile.

        Args:
            rates: ahead and to the left [m/s], turn to the left [deg/s].
            since: ``stops`` when the walk was asked for; the request may have waited
                in the queue.
        """
        ahead, lateral, turn = rates
        pace = Pace(ahead, lateral, math.radians(turn), SINGLE_S, DOUBLE_S, HEIGHT_M)
        if self._planner is None:
            self._planner = VelocityPlanner(pace, half_width=half_width_of(self._robot))
        self._planner.pace = pace
        if self.is_walking:
            return
        if self._thread is not None:
            self._thread.join()  # the last walk first brings the feet together
        with self._lock:
            if self.stops != since:
                return
            self._stop = StopRequest()
            self._thread = threading.Thread(
                target=self._walk, name="stroller", daemon=True
            )
            self._thread.start()

    def stop(self) -> None:
        """Bring the feet together and stand."""
        with self._lock:
            self.stops += 1
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
            self._tell("walk: over, before a stabilizer answered")
        elif status.refusal:
            self._tell(f"walk: refused, {status.refusal}")
        else:
            self._tell(f"walk: over, {status.steps_done} steps so far")


class WalkControls:
    """Sliders for a velocity, two buttons and keys.

    Attributes:
        stroller: sends the footsteps.
    """

    def __init__(
        self, gui: Any, asker: Asker, robot: Robot, endpoints: Endpoints
    ) -> None:
        """Add the controls to the panel."""
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
        """Stop the robot when no browser shows the page; called each frame."""
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
            self.stroller.go(self._rates(), since=self.stroller.stops)

    def _go(self) -> None:
        ahead, lateral, turn = rates = self._rates()
        since = self.stroller.stops
        self._asker.ask(
            f"walk at {ahead:g} m/s, {lateral:g} m/s left, {turn:g} deg/s",
            lambda requests: self.stroller.go(rates, since=since),
        )

    def _halt(self) -> None:
        for slider in self._sliders:
            slider.value = 0.0
        self.stroller.stop()
