"""A run in three dimensions, as one file with a play bar."""

from __future__ import annotations

import contextlib
import io
import logging
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from surefoot.report.curves import NORMALS
from surefoot.report.footsteps import StepTaken, steps_of
from surefoot.report.run_data import RunData
from surefoot.schemas.arrays import Array
from surefoot.schemas.signals import BY_NAME
from surefoot.sim_robot.metrics import CONTACT_LOST_N
from surefoot.view.robot_shape import RobotShape
from surefoot.view.scene import Scene
from surefoot.view.scene_state import AIRBORNE, SceneState, WalkSight, pose

FRAMES_PER_S = 20.0
MOST_FRAMES = 1200
"""Longer runs show fewer frames per second, so that a page stays a few megabytes."""
STEPS_AHEAD = 3
"""Steps to come that are shown."""
CAMERA, LOOK_AT = (1.23, -1.05, 0.75), (0.0, -0.05, 0.42)


def frame_rows(run: RunData) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Rows of the ticks that are shown, evenly spaced; the first is 0."""
    count = run.signals.count
    period_s = run.robot.period_s
    frames = min(MOST_FRAMES, int(count * period_s * FRAMES_PER_S))
    return run.drawable(np.linspace(0, count - 1, max(frames, 2)))


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
        steps = steps_of(run)
        scene.update(state_at(run, int(rows[0]), steps))
        film = server.get_scene_serializer()
        for before, row in pairwise(rows):
            film.insert_sleep(float(row - before) * run.robot.period_s)
            scene.update(state_at(run, int(row), steps))
            on_frame()
        return film.as_html()
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def state_at(run: RunData, row: int, steps: Sequence[StepTaken] = ()) -> SceneState:
    """Return one tick of a run as a scene.

    Forces are those the controller measured and wanted. Where it tells none they are
    the true ones, and none that were wanted.

    Args:
        run: what happened.
        row: of the tick.
        steps: of its walk, if any.
    """
    signals = run.signals

    def told(name: str) -> Array | None:
        """A signal of the controller; None where it tells none."""
        values = signals[name][row] if name in signals else None
        return None if values is None or np.isnan(values).any() else values

    middle = 0.5 * (signals["true_sole_left"][row] + signals["true_sole_right"][row])
    F_true = signals["true_F"][row]
    F_meas = told("F_meas")
    contact = told("in_contact")
    if contact is None or contact.min() < 0:
        contact = F_true[list(NORMALS.values())] >= CONTACT_LOST_N
    base = signals["true_base_pose"][row]
    platforms = signals.get("true_platform_pose")
    return SceneState(
        base=pose(base[:3], base[3:]),
        q=signals["q"][row],
        q_command=signals["q_command"][row],
        platforms=[]
        if platforms is None
        else [pose(each[:3], each[3:]) for each in platforms[row]],
        ground=run.ground,
        F_meas=F_true if F_meas is None else F_meas,
        F_id=told("F_id"),
        in_contact=(bool(contact[0]), bool(contact[1])),
        com=signals["true_com"][row],
        com_reference=run.com_reference + middle * (1.0, 1.0, 0.0),
        walk=_walk_at(run, row, steps) if steps else None,
    )


def _walk_at(run: RunData, row: int, steps: Sequence[StepTaken]) -> WalkSight | None:
    """What there is to see of the walk: steps ahead as they were planned later on."""
    signals = run.signals
    words = BY_NAME["foot_state"].words
    left, right = (words[int(i)] not in AIRBORNE for i in signals["foot_state"][row])
    if np.isnan(signals["dcm"][row]).any():
        return None
    ahead = [step.planned for step in steps if step.begin > row][:STEPS_AHEAD]
    goals = signals["foot_goals"][row].reshape(2, 4)
    swings = [goals[side] for side, down in enumerate((left, right)) if not down]
    return WalkSight(
        footholds=signals["footholds"][row].reshape(2, 4),
        on_ground=(left, right),
        planned=np.array([*swings, *ahead]).reshape(-1, 4),
        dcm=signals["dcm"][row],
        dcm_reference=signals["dcm_reference"][row],
        zmp_reference=signals["zmp_reference"][row],
    )
