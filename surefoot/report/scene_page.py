"""A run in three dimensions, as one file with a play bar."""

from __future__ import annotations

import contextlib
import io
import logging
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from surefoot.report.run_data import RunData
from surefoot.sim_robot.metrics import CONTACT_LOST_N
from surefoot.view.robot_shape import RobotShape
from surefoot.view.scene import Scene
from surefoot.view.scene_state import SceneState, pose

FRAMES_PER_S = 20.0
MOST_FRAMES = 1200
"""Longer runs show fewer frames per second, so that a page stays a few megabytes."""
CAMERA, LOOK_AT = (1.23, -1.05, 0.75), (0.0, -0.05, 0.42)


def frame_rows(run: RunData) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Rows of the ticks that are shown, evenly spaced; the first is 0."""
    count = len(run.ticks["time_s"])
    period_s = run.robot.period_s
    frames = min(MOST_FRAMES, int(count * period_s * FRAMES_PER_S))
    return np.linspace(0, count - 1, max(frames, 2)).astype(np.int64)


def scene_page(run: RunData, shape: RobotShape, *, on_frame: Callable[[], None]) -> str:
    """Draw a run.

    Args:
        run: what happened.
        shape: of its robot.
        on_frame: called after each frame.

    Returns:
        The page; it needs no other file and no network.
    """
    import viser

    logging.getLogger("websockets").setLevel(logging.WARNING)
    rows = frame_rows(run)
    with contextlib.redirect_stdout(io.StringIO()):  # its own banner
        # The library makes pages from a server only; this one serves nobody.
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        server.initial_camera.position = CAMERA
        server.initial_camera.look_at = LOOK_AT
        scene = Scene(server.scene, run.robot, shape)
        scene.update(state_at(run, int(rows[0])))
        film = server.get_scene_serializer()
        for before, row in pairwise(rows):
            film.insert_sleep(float(row - before) * run.robot.period_s)
            scene.update(state_at(run, int(row)))
            on_frame()
        return film.as_html()
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def state_at(run: RunData, row: int) -> SceneState:
    """Return one tick of a run as a scene.

    Forces are those the stabilizer measured and wanted last. Runs without a record
    show the true ones instead, and none that were wanted.
    """
    ticks = run.ticks
    middle = 0.5 * (ticks["sole_left"][row] + ticks["sole_right"][row])
    F_meas = np.concatenate((ticks["F_left"][row], ticks["F_right"][row]))
    F_id = None
    contact = (
        bool(ticks["F_left"][row, 2] >= CONTACT_LOST_N),
        bool(ticks["F_right"][row, 2] >= CONTACT_LOST_N),
    )
    heard = run.heard
    if heard is not None:
        told = int(np.searchsorted(heard.told_tick, row, side="right")) - 1
        if told >= 0:
            F_meas, F_id = heard.F_meas[told], heard.F_id[told]
            contact = (bool(heard.in_contact[told, 0]), bool(heard.in_contact[told, 1]))
    return SceneState(
        base=pose(ticks["base_position"][row], ticks["base_quat_xyzw"][row]),
        q=ticks["q"][row],
        q_command=ticks["q_command"][row],
        platforms=[
            pose(position, quat_xyzw)
            for position, quat_xyzw in zip(
                ticks["platform_position"][row],
                ticks["platform_quat_xyzw"][row],
                strict=True,
            )
        ],
        F_meas=F_meas,
        F_id=F_id,
        in_contact=contact,
        com=ticks["com"][row],
        com_reference=run.com_reference + middle * (1.0, 1.0, 0.0),
    )
