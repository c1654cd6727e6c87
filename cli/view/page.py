"""The live page: looks at the bus thirty times a second and shows what it sees."""

from __future__ import annotations

import contextlib
import io
import time
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cli.view.asker import Asker
from cli.view.controls import add_controls, add_push
from cli.view.gains import GainSliders
from cli.view.plots import PLOTS, RollingPlot
from cli.view.robot_shape import RobotShape
from cli.view.scene import COM, MEASURED, POLYGON, WANTED, ZMP, Scene
from cli.view.scene_state import SceneState, state_of
from cli.view.words import status_html, verdict
from robot_io.errors import RobotUnreachableError
from robot_io.observer import Observer
from robot_io.robot import Robot
from robot_io.sight import SEEN_CHANNELS, Sight
from robot_io.stop_request import StopRequest
from schemas.endpoints import Endpoints

FRAME_S = 1.0 / 30.0
WORDS_S = 0.25
PLOTS_S = 0.2
IDENTITY = "live-page"
DIAL_S = 1.0
"""The page says that there is no robot, and tries again, so often."""
MM_PER_M = 1e3
_NOTHING = Sight()


class LivePage:
    """Server, scene and panel. Nothing here can hold up robot or stabilizer."""

    def __init__(self, robot: Robot, *, endpoints: Endpoints, port: int) -> None:
        """Serves the page on the loopback interface.

        Args:
            robot: what its files say.
            endpoints: where to dial.
            port: of the page; must be free.
        """
        import viser

        self._robot, self._endpoints = robot, endpoints
        self._where = ", ".join(endpoints.connect)
        with contextlib.redirect_stdout(io.StringIO()):  # its own banner
            self._server = viser.ViserServer(
                host="127.0.0.1", port=port, label="Surefoot", verbose=False
            )
        self._shape = RobotShape(robot)
        self._asker = Asker()
        self._words_due_s = self._plots_due_s = 0.0
        self._seen: tuple[int, ...] = ()
        self._build()

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://127.0.0.1:{self._server.get_port()}"

    def run(self, stop: StopRequest) -> None:
        """Shows until asked to stop; waits for the robot as long as it takes."""
        try:
            while not stop.is_set:
                self._tell(_NOTHING, None)
                try:
                    with Observer(
                        self._robot,
                        endpoints=self._endpoints,
                        channels=SEEN_CHANNELS,
                        identity=IDENTITY,
                    ) as observer:
                        observer.connect(timeout_s=DIAL_S)
                        self._watch(observer, stop)
                except RobotUnreachableError:
                    continue
        finally:
            self._asker.through(None)
            self._server.stop()

    def _watch(self, observer: Observer, stop: StopRequest) -> None:
        self._asker.through(observer.requests)
        due_s = time.monotonic()
        had_stabilizer = False
        while not stop.is_set:
            sight = observer.look()
            has_stabilizer = bool(observer.stabilizers)
            if has_stabilizer and not had_stabilizer:
                self._asker.ask("present gains", self._gains.learn)
            elif had_stabilizer and not has_stabilizer:
                self._gains.forget()
            had_stabilizer = has_stabilizer
            self._draw(sight)
            self._gains.send()
            self._tell(sight, observer)
            due_s += FRAME_S
            pause_s = due_s - time.monotonic()
            if pause_s < 0.0:  # behind: leave frames out, never catch up in a burst
                due_s, pause_s = time.monotonic(), 0.001
            time.sleep(pause_s)  # the pace of the frames

    def _draw(self, sight: Sight) -> None:
        ticks = tuple(-1 if message is None else message.tick for message in sight)
        if ticks == self._seen:
            return
        self._seen = ticks
        state = state_of(sight, self._robot, self._shape)
        if state is None:
            return
        with self._server.atomic():
            self._scene.update(state)
        self._plot(sight, state)

    def _plot(self, sight: Sight, state: SceneState) -> None:
        stabilizer = sight.stabilizer
        if sight.joints is None or stabilizer is None:
            return
        error = MM_PER_M * (
            np.array(stabilizer.com) - np.array(stabilizer.com_reference)
        )
        roll, pitch = Rotation.from_matrix(state.base[:3, :3]).as_euler(
            "xyz", degrees=True
        )[:2]
        rows: tuple[tuple[float, ...], ...] = (
            tuple(error),
            (
                stabilizer.F_meas_left[2],
                stabilizer.F_id_left[2],
                stabilizer.F_meas_right[2],
                stabilizer.F_id_right[2],
            ),
            (roll, pitch),
            (stabilizer.tick_median_ms, stabilizer.tick_p99_ms),
        )
        time_s = stabilizer.tick * self._robot.period_s
        for plot, row in zip(self._plots, rows, strict=True):
            plot.add(time_s, row)
        now_s = time.monotonic()
        if now_s >= self._plots_due_s:
            self._plots_due_s = now_s + PLOTS_S
            with self._server.atomic():
                for plot in self._plots:
                    plot.draw()

    def _tell(self, sight: Sight, observer: Observer | None) -> None:
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
        gui.configure_theme(
            control_layout="fixed",
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
        with gui.add_folder("Plots"):
            self._plots = [RollingPlot(gui, plot) for plot in PLOTS]
        add_push(gui, self._asker, self._robot)
        self._gains = GainSliders(gui, self._asker)
        with gui.add_folder("Asked", expand_by_default=True):
            self._notes = gui.add_markdown("nothing asked yet")
        self._add_scene_options(gui)

    def _add_scene_options(self, gui: Any) -> None:
        with gui.add_folder("Scene"):
            gui.add_html(_LEGEND)
            ghost = gui.add_checkbox("Commanded posture (ghost)", True)
            forces = gui.add_checkbox("Forces", True)
        ghost.on_update(lambda event: self._scene.show_ghost(ghost.value))
        forces.on_update(lambda event: self._scene.show_forces(forces.value))


def _swatch(colour: tuple[int, int, int], text: str) -> str:
    return (
        f"<div><span style='color:rgb{colour};font-size:1.2em'>&#9679;</span> "
        f"{text}</div>"
    )


_LEGEND = (
    "<div style='padding:0.2em 0.8em;font-size:0.8em'>"
    + _swatch(MEASURED, "measured force of the ground, 1 m per kN")
    + _swatch(WANTED, "wanted force, beside it; wanted CoM")
    + _swatch(COM, "centre of mass")
    + _swatch(ZMP, "zero moment point, measured")
    + _swatch(POLYGON, "support polygon")
    + "</div>"
)
