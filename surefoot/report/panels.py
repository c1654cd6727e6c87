"""Parts of a report's page: panels of plots, and the 3-D replay."""

from __future__ import annotations

import base64
import contextlib
import io
import logging
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from surefoot.report import curves as s
from surefoot.report.curves import NORMALS, StepTaken, steps_of
from surefoot.report.run_data import RunData
from surefoot.schemas.arrays import Array
from surefoot.schemas.signals import BY_NAME
from surefoot.sim_robot.metrics import CONTACT_LOST_N
from surefoot.view.robot_shape import RobotShape
from surefoot.view.scene import Scene
from surefoot.view.scene_state import (
    AIRBORNE,
    SceneState,
    WalkSight,
    pose,
    stance_in_world,
)

FRAMES_PER_S = 20.0
MOST_FRAMES = 1200
"""Longer runs get fewer frames per second, which limits the page's size."""
STEPS_AHEAD = 3
"""Number of planned steps that are shown."""
CAMERA, LOOK_AT = (1.23, -1.05, 0.75), (0.0, -0.05, 0.42)
BLUE, VERMILION, GREEN = "#0072b2", "#d55e00", "#009e73"
ORANGE, PINK, SKY = "#e69f00", "#cc79a7", "#56b4e9"
RUN_COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PINK, SKY)
"""One colour per run, in the order of the runs; their number limits a page."""
GREY = "#8a929c"
COM, BASE, FORCE = "Centre of mass", "Base", "Normal force"
WALK = "Walk"
ANKLE, GROUND = "Left ankle", "Ground"
MODE, TIME = "Mode and contact", "Time"
GROUPS = {
    COM: "CoM minus reference. True: the simulator's; x and y from the middle of "
    "the true soles, z in the world. Estimated: the stabilizer's, from the robot's "
    "sensors, in its frame between the feet, once it has calibrated.",
    WALK: "Divergent component of motion, in the odometry frame, from the first shift "
    "of the weight to the last.",
    BASE: "True: the simulator's. Estimated: the controller's; its yaw is relative to "
    "the feet. Positions are relative to the start of the run.",
    FORCE: "Force of the ground on each sole, along the sole's normal. True: the "
    "simulator's. Measured: the ankle's sensor, compensated to the sole. Desired: "
    "result of the first QP.",
    ANKLE: "Readings of the force-torque sensor, in its own frame.",
    GROUND: "Top centre of each platform, relative to the start; axes that do not move "
    "are left out.",
    MODE: "Mode of the robot's command gate, state of the stabilizer, and whether "
    "each foot stands: in truth, and as the stabilizer estimates.",
    TIME: "Wall-clock time. Controller tick: from snapshot to command. Answer: from "
    "the stamp of the sensors to the stamp of the command that answers them.",
}
"""Groups of plots in the order of the page, with their explanations."""


def frame_rows(run: RunData) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return the rows of the ticks that are shown, evenly spaced in time."""
    count = run.signals.count
    period_s = run.robot.period_s
    frames = min(MOST_FRAMES, int(count * period_s * FRAMES_PER_S))
    return run.drawable(np.linspace(0, count - 1, max(frames, 2)))


def scene_page(run: RunData, shape: RobotShape, *, on_frame: Callable[[], None]) -> str:
    """Draw a run as a 3-D replay.

    Returns:
        The page as HTML; it needs no other file and no network.
    """
    import viser

    logging.getLogger("websockets").setLevel(logging.WARNING)
    rows = frame_rows(run)
    with contextlib.redirect_stdout(io.StringIO()):  # hides viser's banner
        # viser makes pages from a server only; nobody connects to this one.
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


def tells_forces(run: RunData) -> bool:
    """Whether the run has any force that the controller measured."""
    return bool(np.isfinite(run.signals.get("F_meas", np.nan)).any())


def state_at(run: RunData, row: int, steps: Sequence[StepTaken] = ()) -> SceneState:
    """Return one tick of a run as a scene.

    Forces are those that the controller measured and desired. Where it recorded none,
    the measured ones are replaced by the true ones.
    """
    signals = run.signals

    def told(name: str) -> Array | None:
        """Return a signal of the controller at this row; None if not recorded."""
        values = signals[name][row] if name in signals else None
        return None if values is None or np.isnan(values).any() else values

    feet = np.array([signals[f"true_sole_{s}"][row] for s in ("left", "right")])
    walk = _walk_at(run, row, steps) if steps else None
    reference = run.com_reference if walk is None else told("com_reference")
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
        com_reference=None
        if reference is None
        else stance_in_world(reference, feet, walk),
        walk=walk,
    )


def _walk_at(run: RunData, row: int, steps: Sequence[StepTaken]) -> WalkSight | None:
    """Return the walk at a row; planned steps are as at their own lift-off."""
    signals = run.signals
    words = BY_NAME["foot_state"].words
    left, right = (words[int(i)] not in AIRBORNE for i in signals["foot_state"][row])
    footholds = signals["footholds"][row].reshape(2, 4)
    if np.isnan(signals["dcm"][row]).any() or not footholds.any():
        return None  # the walk has not begun
    ahead = [step.planned for step in steps if step.begin > row][:STEPS_AHEAD]
    goals = signals["foot_goals"][row].reshape(2, 4)
    swings = [goals[side] for side, down in enumerate((left, right)) if not down]
    return WalkSight(
        footholds=footholds,
        on_ground=(left, right),
        planned=np.array([*swings, *ahead]).reshape(-1, 4),
        dcm=signals["dcm"][row],
        dcm_reference=signals["dcm_reference"][row],
        zmp_reference=signals["zmp_reference"][row],
    )


KIND_COLOURS = {
    **{s.TRUE: BLUE, s.REPORTED: BLUE, s.EACH: BLUE},
    **{s.MEASURED: VERMILION, s.ESTIMATED: VERMILION},
    s.DESIRED: GREEN,
}
"""Colours by source, on a page about one run."""
DASHES = {s.MEASURED: "dot", s.ESTIMATED: "dot", s.DESIRED: "dash"}
"""Dashes by source, on a page where colours distinguish runs; others are solid."""


class Panel(NamedTuple):
    """One plot.

    Attributes:
        group: heading that it stands under.
        title: name of the quantity.
        unit: unit of the values; empty for states.
        words: names of the states 0, 1, ...; empty for numbers.
    """

    group: str
    title: str
    unit: str
    words: tuple[str, ...] = ()


PANELS = {
    **{f"com_{a}": Panel(COM, f"CoM error {a}", "mm") for a in s.AXES},
    **{f"dcm_{a}": Panel(WALK, f"DCM {a}", "mm") for a in s.AXES[:2]},
    **{f"base_{t}": Panel(BASE, f"base {t}", "deg") for t in s.TURNS},
    **{f"base_{a}": Panel(BASE, f"base {a}", "mm") for a in s.AXES},
    **{
        f"force_{side}": Panel(FORCE, f"{side} foot F_z", "N")
        for side in ("left", "right")
    },
    **{f"ankle_force_{a}": Panel(ANKLE, f"force {a}", "N") for a in s.AXES},
    **{f"ankle_moment_{a}": Panel(ANKLE, f"moment {a}", "N m") for a in s.AXES},
    "mode": Panel(MODE, "robot's mode", "", s.MODES),
    "state": Panel(MODE, "stabilizer's state", "", s.STATES),
    "contact_left": Panel(MODE, "left foot stands", "", s.CONTACT),
    "contact_right": Panel(MODE, "right foot stands", "", s.CONTACT),
    "tick": Panel(TIME, "controller tick", "ms"),
    "answer": Panel(TIME, "answer to a tick", "ms"),
}


def panel_groups(runs: list[tuple[str, list[s.Curve]]]) -> list[dict[str, Any]]:
    """Return the groups of plots for the page's script.

    Returns:
        All groups with curves: ``name``, ``about``, and ``panels``, each with ``key``,
        ``title``, ``unit``, ``words`` and ``curves``.
    """
    found: dict[str, list[dict[str, Any]]] = {}
    for index, (label, curves) in enumerate(runs):
        for signal in curves:
            found.setdefault(signal.panel, []).append(
                _curve(signal, index=index, label=label, alone=len(runs) == 1)
            )
    groups: dict[str, list[dict[str, Any]]] = {name: [] for name in GROUPS}
    for key in _in_order(found):
        panel = PANELS.get(key) or _platform_panel(key)
        groups[panel.group].append(
            {
                "key": key,
                "title": panel.title,
                "unit": panel.unit,
                "words": panel.words,
                "curves": found[key],
            }
        )
    return [
        {"name": name, "about": GROUPS[name], "panels": panels}
        for name, panels in groups.items()
        if panels
    ]


def _curve(signal: s.Curve, *, index: int, label: str, alone: bool) -> dict[str, Any]:
    kind = signal.kind
    return {
        "run": index,
        "kind": kind,
        "name": kind if alone else f"{label}, {kind}",
        "colour": KIND_COLOURS[kind] if alone else RUN_COLOURS[index],
        "dash": DASHES.get(kind, "solid"),
        "x": _packed(signal.times),
        "y": _packed(signal.values),
    }


def _packed(values: Array) -> dict[str, str]:
    """Pack numbers in plotly's binary form, a quarter of the size of digits."""
    data = np.ascontiguousarray(values, dtype="<f4").tobytes()
    return {"dtype": "f4", "bdata": base64.b64encode(data).decode()}


def _in_order(found: Iterable[str]) -> list[str]:
    """Return keys as in PANELS, then platforms by index and axis."""
    known = [*PANELS]
    axes = (*s.AXES, *s.TURNS)

    def place(key: str) -> tuple[int, int, int]:
        if key in PANELS:
            return 0, known.index(key), 0
        _, index, axis = key.split("_")
        return 1, int(index), axes.index(axis)

    return sorted(found, key=place)


def _platform_panel(key: str) -> Panel:
    _, index, axis = key.split("_")
    unit = "mm" if axis in s.AXES else "deg"
    return Panel(GROUND, f"platform {int(index) + 1} {axis}", unit)


class Mark(NamedTuple):
    """A moment to mark: time [s], event, and colour of the line."""

    time: float
    text: str
    colour: str


def marks_of(runs: list[RunData]) -> list[Mark]:
    """Collect pushes, sensor faults, changes of settings and falls, each once."""
    marks = []
    for index, run in enumerate(runs):
        colour = RUN_COLOURS[index] if len(runs) > 1 else GREY
        period_s = run.robot.period_s
        marks += [Mark(push.start_s, "push", GREY) for push in run.scenario.push]
        marks += [
            Mark(fault.start_s, f"{fault.sensor}: {fault.kind}", GREY)
            for fault in run.scenario.fault
        ]
        result = run.result
        marks += [Mark(p.tick * period_s, "push asked", colour) for p in result.pushes]
        marks += [
            Mark(change.tick * period_s, "settings", colour)
            for change in result.settings_changes
        ]
        if result.fell_at_s is not None:
            marks.append(Mark(result.fell_at_s, "fell", colour))
    return list(dict.fromkeys(marks))
