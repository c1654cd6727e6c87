"""The live page: reads the bus thirty times a second and shows the robot."""

from __future__ import annotations

import asyncio
import contextlib
import html
import io
import logging
import socket
import time
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import QhullError
from scipy.spatial.transform import Rotation

from surefoot.errors import EnvironmentFailedError
from surefoot.robot_io.client_side.observer import (
    VIEWER_CHANNELS,
    LatestMessages,
    Observer,
)
from surefoot.robot_io.errors import RobotUnreachableError
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import MM_PER_M, Mat
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import StabilizerState, counted, plain
from surefoot.schemas.walk_plan import WalkStatus
from surefoot.view.controls import (
    PLOTS,
    Asker,
    GainSliders,
    RollingPlot,
    add_controls,
    add_push,
)
from surefoot.view.robot_shape import RobotShape
from surefoot.view.scene import LEGEND, MEASURED, WALK_LEGEND, Scene
from surefoot.view.scene_state import SceneState, state_of
from surefoot.view.walk import WalkControls

_LOG = logging.getLogger(__name__)
FRAME_S = 1.0 / 30.0
"""Period of the frames [s]."""
WORDS_S = 0.25
PLOTS_S = 0.2
UNDRAWN_S = 5.0
"""Least time between warnings about messages that cannot be drawn [s]."""
IDENTITY = "live-page"
DIAL_S = 1.0
"""Time of each attempt to reach a robot [s]; the page shows that it waits."""
_NOTHING = LatestMessages()
WALK_PHASES = {
    "shift": "weight goes onto one foot",
    "single": "single support",
    "double": "double support",
    "settle": "weight goes between the feet",
}
GREEN, AMBER, RED, GREY = "#1a9c5f", "#c77700", "#d8434e", "#7a828c"


class Headline(NamedTuple):
    """The robot's condition, as a headline and a sentence.

    Attributes:
        headline: one or two words.
        colour: colour of the headline's badge.
        detail: the reason, or what to do.
    """

    headline: str
    colour: str
    detail: str


def verdict(
    sight: LatestMessages, *, robot_is_here: bool, stabilizer_is_here: bool, where: str
) -> Headline:
    """Return the robot's condition, as the newest messages tell it."""
    status, stabilizer = sight.status, sight.stabilizer
    if not robot_is_here:
        if status is None:
            return Headline("waiting", GREY, f"for a robot at {where}")
        detail = status.detail or "its process has ended"
        return Headline("robot gone", GREY, f"last word: {detail}")
    if status is None:
        return Headline("waiting", GREY, "the robot has not said anything yet")
    if status.mode is RobotMode.FAULT:
        return Headline(
            "FAULT", RED, f"{status.detail}; the posture is kept until reset"
        )
    if status.mode is RobotMode.OFF:
        return Headline("off", GREY, status.detail or "follows nobody")
    if status.mode is RobotMode.HOLD:
        return Headline("HOLD", AMBER, status.detail or "keeps its posture")
    if not stabilizer_is_here:
        return Headline("no stabilizer", RED, "nobody answers the robot's ticks")
    if stabilizer is not None and stabilizer.state is not StabilizerState.ACTIVE:
        return Headline(plain(stabilizer.state), AMBER, stabilizer.detail)
    if sight.walk_status is not None and sight.walk_status.phase != "stand":
        return Headline("walking", GREEN, _walk_words(sight.walk_status))
    lost = _feet_in_the_air(sight)
    if lost:
        return Headline("balancing", AMBER, f"{lost} without contact")
    return Headline("balancing", GREEN, "both feet stand, both QPs solved")


def status_html(words: Headline, sight: LatestMessages, *, period_s: float) -> str:
    """Return the panel's HTML: badge, sentence, and a table of figures."""
    status, stabilizer = sight.status, sight.stabilizer
    rows = []
    if status is not None:
        rows.append(("time", f"{status.tick * period_s:.1f} s"))
        rows.append(("commander", status.commander or "nobody"))
        if status.notice:
            rows.append(("robot says", status.notice))
        rows.append(("refused", counted(status.refused)))
        rows.append(("clipped", counted(status.clipped)))
        rows.append(("missed ticks", str(status.deadline_misses)))
    if stabilizer is not None:
        rows.append(("QPs", stabilizer.qp_status))
    walk = sight.walk_status
    if walk is not None:
        taken = f"{walk.steps_done} of {walk.steps_planned}"
        rows.append(("steps", taken))
        if walk.refusal:
            rows.append(("steps refused", walk.refusal))
    table = "".join(
        f"<tr><td style='color:#7a828c;padding-right:1em'>{name}</td>"
        f"<td>{html.escape(text)}</td></tr>"
        for name, text in rows
    )
    return (
        "<div style='padding:0.2em 0.8em 0.4em;font-size:0.82em;line-height:1.45'>"
        f"<div id='surefoot-state'><span style='background:{words.colour};color:#fff;"
        "border-radius:4px;padding:0.15em 0.6em;font-weight:600;font-size:1.1em'>"
        f"{html.escape(words.headline)}</span> &nbsp;{html.escape(words.detail)}</div>"
        f"<table style='margin-top:0.5em'>{table}</table></div>"
    )


def _walk_words(walk: WalkStatus) -> str:
    """Return phase and states of the feet of a walk, in words."""
    feet = (("left", walk.foot_left), ("right", walk.foot_right))
    doing = [f"{side} foot {state}" for side, state in feet if state != "planted"]
    return ", ".join([WALK_PHASES[walk.phase], *doing])


def _feet_in_the_air(sight: LatestMessages) -> str:
    if sight.stabilizer is None:
        return ""
    sides = zip(("left foot", "right foot"), sight.stabilizer.in_contact, strict=True)
    return " and ".join(side for side, stands in sides if not stands)


def tilt_deg(base: Mat, robot: Robot) -> tuple[float, float]:
    """Return roll and pitch of the upright robot's axes [deg].

    They do not depend on how the axes of the base link lie in the robot.

    Args:
        base: (4, 4) world from base link.
        robot: defines its upright attitude.
    """
    upright = base[:3, :3] @ robot.R_upright_base.T
    roll, pitch, _ = Rotation.from_matrix(upright).as_euler("xyz", degrees=True)
    return float(roll), float(pitch)


class LivePage:
    """Server, scene and panel; never delays robot or stabilizer."""

    def __init__(self, robot: Robot, *, endpoints: Endpoints, port: int) -> None:
        """Serve the page on the loopback interface."""
        import viser

        self._robot, self._endpoints = robot, endpoints
        self._where = ", ".join(endpoints.connect)
        with contextlib.redirect_stdout(io.StringIO()):  # hides viser's banner
            self._server = viser.ViserServer(
                host="127.0.0.1", port=port, label="Surefoot", verbose=False
            )
        wake_on_loop(self._server)
        self._shape = RobotShape(robot)
        self._asker = Asker()
        self._undrawn_due_s = 0.0
        self._words_due_s = self._plots_due_s = self._undrawn_due_s = 0.0
        self._seen: tuple[int, ...] = ()
        self._build()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self._server.get_port()}"

    def run(self, stop: StopRequest) -> None:
        """Show until asked to stop; waits for a robot without limit."""
        try:
            while not stop.is_set:
                self._tell(_NOTHING, None)
                try:
                    with Observer(
                        self._robot,
                        endpoints=self._endpoints,
                        channels=VIEWER_CHANNELS,
                        identity=IDENTITY,
                    ) as observer:
                        observer.connect(timeout_s=DIAL_S)
                        self._watch(observer, stop)
                except RobotUnreachableError:
                    continue
        finally:
            self._walk.stroller.stop()
            self._asker.through(None)
            self._server.stop()

    def _watch(self, observer: Observer, stop: StopRequest) -> None:
        self._asker.through(observer.requests)
        self._gains.forget()
        due_s = time.monotonic()
        while not stop.is_set:
            began_s = time.monotonic()
            sight = observer.latest_messages()
            self._gains.watch(has_stabilizer=bool(observer.stabilizers))
            self._draw(sight)
            self._gains.send()
            self._walk.watch(has_visitors=bool(self._server.get_clients()))
            self._tell(sight, observer)
            if not observer.robot_is_here:
                return  # dial anew: a session that was cut off mixes up keys
            now_s = time.monotonic()
            # When late, skip frames and leave the server as much time as a frame took.
            due_s = max(due_s + FRAME_S, now_s + (now_s - began_s))
            time.sleep(due_s - now_s)  # sets the frame rate

    def _draw(self, sight: LatestMessages) -> None:
        ticks = tuple(-1 if message is None else message.tick for message in sight)
        if ticks == self._seen:
            return
        self._seen = ticks
        try:
            state = state_of(sight, self._robot, self._shape)
            if state is None:
                return
            with self._server.atomic():
                self._scene.update(state)
            self._plot(sight, state)
        except (ValueError, ArithmeticError, QhullError) as error:
            # Valid messages may still hold an impossible attitude or ground.
            words = f"tick {max(ticks)} cannot be drawn: {str(error).splitlines()[0]}"
            if time.monotonic() >= self._undrawn_due_s:
                self._undrawn_due_s = time.monotonic() + UNDRAWN_S
                _LOG.warning(words)

    def _plot(self, sight: LatestMessages, state: SceneState) -> None:
        stabilizer = sight.stabilizer
        if sight.joints is None or stabilizer is None:
            return
        error = MM_PER_M * (
            np.array(stabilizer.com) - np.array(stabilizer.com_reference)
        )
        rows: tuple[tuple[float, ...], ...] = (
            tuple(error),
            (
                stabilizer.F_meas_left[2],
                stabilizer.F_id_left[2],
                stabilizer.F_meas_right[2],
                stabilizer.F_id_right[2],
            ),
            tilt_deg(state.base, self._robot),
            (stabilizer.tick_median_ms, stabilizer.tick_p99_ms),
        )
        time_s = stabilizer.tick * self._robot.period_s
        for plot, row in zip(self._plots, rows, strict=False):
            plot.add(time_s, row)
        walk = sight.walk_status
        if walk is not None and walk.phase != "stand":
            off = MM_PER_M * (np.array(walk.dcm) - np.array(walk.dcm_reference))
            self._plots[-1].add(walk.tick * self._robot.period_s, tuple(off))
        now_s = time.monotonic()
        if now_s >= self._plots_due_s:
            self._plots_due_s = now_s + PLOTS_S
            with self._server.atomic():
                for plot in self._plots:
                    plot.draw()

    def _tell(self, sight: LatestMessages, observer: Observer | None) -> None:
        now_s = time.monotonic()
        if now_s < self._words_due_s:
            return
        self._words_due_s = now_s + WORDS_S
        words = verdict(
            sight,
            robot_is_here=observer is not None and observer.robot_is_here,
            stabilizer_is_here=observer is not None and bool(observer.stabilizers),
            where=self._where,
        )
        text = status_html(words, sight, period_s=self._robot.period_s)
        if text != self._status.content:
            self._status.content = text
        notes = "  \n".join(reversed(self._asker.notes)) or "nothing asked yet"
        if notes != self._notes.content:
            self._notes.content = notes

    def _build(self) -> None:
        server, gui = self._server, self._server.gui
        gui.main_panel.dock_right()
        gui.configure_theme(
            control_width="large",
            show_logo=False,
            show_share_button=False,
            brand_color=MEASURED,
        )
        gui.set_panel_label(f"Surefoot: {self._robot.file.name}")
        self._scene = Scene(server.scene, self._robot, self._shape)
        server.initial_camera.position = (1.45, -1.05, 0.95)
        server.initial_camera.look_at = (0.0, -0.05, 0.5)
        self._status = gui.add_html("")
        add_controls(gui, self._asker)
        add_push(gui, self._asker, self._robot)
        self._walk = WalkControls(gui, self._asker, self._robot, self._endpoints)
        self._gains = GainSliders(gui, self._asker)
        with gui.add_folder("Asked"):
            self._notes = gui.add_markdown("nothing asked yet")
        with gui.add_folder("Plots"):
            self._plots = [RollingPlot(gui, plot) for plot in PLOTS]
        self._add_scene_options(gui)

    def _add_scene_options(self, gui: Any) -> None:
        with gui.add_folder("Scene"):
            swatches = "".join(
                f"<div><span style='color:rgb{colour};font-size:1.2em'>&#9679;</span> "
                f"{text}</div>"
                for colour, text in (*LEGEND, *WALK_LEGEND)
            )
            style = "padding:0.2em 0.8em;font-size:0.8em"
            gui.add_html(f"<div style='{style}'>{swatches}</div>")
            ghost = gui.add_checkbox("Commanded posture (ghost)", True)
            forces = gui.add_checkbox("Forces", True)
        ghost.on_update(lambda event: self._scene.show_ghost(ghost.value))
        forces.on_update(lambda event: self._scene.show_forces(forces.value))


def wake_on_loop(server: Any) -> None:
    """Have viser wake the sender of its messages on its event loop alone.

    viser 1.1.1 sets an :class:`asyncio.Event` on the thread that draws, and once more
    on the loop. When the first one falls between the sender's look at the event and its
    wait, the second finds the event set and wakes nobody: the page then stays as it is
    for good, a robot in FAULT still "balancing".

    Args:
        server: a viser server.
    """
    try:
        event = server._websock_server.get_message_buffer().message_event
    except AttributeError:
        return  # another version of viser, which sends in another way
    wake = event.set

    def set_on_loop() -> None:
        with contextlib.suppress(RuntimeError):  # on another thread: the loop follows
            asyncio.get_running_loop()
            wake()

    event.set = set_on_loop


def free_port(port: int) -> int:
    """Check that a port of the loopback interface is free.

    Returns:
        The port; a free one for 0.

    Raises:
        EnvironmentFailedError: another program uses the port.
    """
    try:
        with socket.create_server(("127.0.0.1", port)) as server:
            return int(server.getsockname()[1])
    except OSError as error:
        raise EnvironmentFailedError(
            f"cannot serve the page at 127.0.0.1:{port}: {error.strerror or error}; "
            "stop the program there, or choose another port with --port (of run: "
            "--view-port)"
        ) from error
