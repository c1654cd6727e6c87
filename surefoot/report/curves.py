"""Curves of a run for plots, named by their quantity."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from surefoot.report.run_data import BusColumns, RunData
from surefoot.schemas.arrays import Array
from surefoot.schemas.reasons import StabilizerState
from surefoot.sim_robot.metrics import CONTACT_LOST_N
from surefoot.view.robot_shape import RobotShape

AXES = ("x", "y", "z")
TURNS = ("roll", "pitch", "yaw")
MODES = ("off", "hold", "active", "fault")
STATES = tuple(reversed(StabilizerState))
CONTACT = ("no", "yes")
MM_PER_M = 1e3
STILL = 1e-6
"""A platform that moves less is not drawn [m, rad]."""
TRUE, ESTIMATED, MEASURED, DESIRED = "true", "estimated", "measured", "desired"
MEDIAN, P99, EACH = "median", "99th percentile", "each tick"
REPORTED = "as reported"
BUCKETS = 800
"""Stretches of time per curve, about one per pixel of a wide plot."""


def thin(times: Array, values: Array, *, buckets: int = BUCKETS) -> tuple[Array, Array]:
    """Keep the least and the largest value of each stretch of time.

    So a peak of one tick is seen, which every n-th point would miss.

    Args:
        times: (n,) in order.
        values: (n,).
        buckets: stretches of as many points each.

    Returns:
        Times and values, at most 2 per stretch, in order; first and last are kept.
    """
    count = len(times)
    if count <= 2 * buckets:
        return times, values
    edges = np.linspace(0, count, buckets + 1).astype(int)
    kept = {0, count - 1}
    for start, end in pairwise(edges):
        stretch = values[start:end]
        kept.add(start + int(np.argmin(stretch)))
        kept.add(start + int(np.argmax(stretch)))
    rows = np.array(sorted(kept))
    return times[rows], values[rows]


def changes(times: Array, values: Array) -> tuple[Array, Array]:
    """Keep where a value that stays the same for long becomes another one.

    Args:
        times: (n,) in order.
        values: (n,).

    Returns:
        Times and values of first, changes and last.
    """
    if len(times) == 0:
        return times, values
    is_new = np.concatenate(([True], values[1:] != values[:-1]))
    is_new[-1] = True
    return times[is_new], values[is_new]


class Signal(NamedTuple):
    """One curve.

    Attributes:
        panel: key of the plot it belongs to.
        kind: what it is: true, estimated, measured, desired, ...
        times: (n,) simulated time [s].
        values: (n,) in the unit of the panel.
    """

    panel: str
    kind: str
    times: Array
    values: Array


def signals(run: RunData, shape: RobotShape) -> Iterator[Signal]:
    """All curves of a run, in few enough points.

    Args:
        run: what it left behind.
        shape: tells how the IMU sits on the base.
    """
    yield from _truth(run)
    yield from _platforms(run)
    if run.heard is not None:
        yield from _stabilizer(run, run.heard)
        yield from _sensors(run, run.heard, shape)
        yield from _words(run, run.heard)


def com_error(run: RunData) -> Array:
    """(n, 3) true centre of mass less reference, as in the result [m]."""
    ticks = run.ticks
    error: Array = ticks["com"] - run.com_reference
    error[:, :2] -= 0.5 * (ticks["sole_left"] + ticks["sole_right"])[:, :2]
    return error


def _truth(run: RunData) -> Iterator[Signal]:
    times, ticks = run.ticks["time_s"], run.ticks
    for axis, error in zip(AXES, com_error(run).T, strict=True):
        yield Signal(f"com_{axis}", TRUE, *thin(times, MM_PER_M * error))
    angles = Rotation.from_quat(ticks["base_quat_xyzw"]).as_euler("xyz", degrees=True)
    for turn, angle in zip(TURNS, angles.T, strict=True):
        yield Signal(f"base_{turn}", TRUE, *thin(times, angle))
    for axis, place in zip(AXES, ticks["base_position"].T, strict=True):
        moved = MM_PER_M * (place - place[0])
        yield Signal(f"base_{axis}", TRUE, *thin(times, moved))
    for side in ("left", "right"):
        normal = ticks[f"F_{side}"][:, 2]
        yield Signal(f"force_{side}", TRUE, *thin(times, normal))
        stands = (normal >= CONTACT_LOST_N).astype(np.float64)
        yield Signal(f"contact_{side}", TRUE, *changes(times, stands))


def _platforms(run: RunData) -> Iterator[Signal]:
    times = run.ticks["time_s"]
    places = run.ticks["platform_position"]
    attitudes = run.ticks["platform_quat_xyzw"]
    for index in range(places.shape[1]):
        moved = places[:, index] - places[0, index]
        turned = Rotation.from_quat(attitudes[:, index]).as_euler("xyz")
        for names, columns, scale in (
            (AXES, moved, MM_PER_M),
            (TURNS, turned, np.degrees(1.0)),
        ):
            for name, values in zip(names, columns.T, strict=True):
                if np.ptp(values) > STILL:
                    drawn = thin(times, scale * values)
                    yield Signal(f"platform_{index}_{name}", TRUE, *drawn)


def _stabilizer(run: RunData, heard: BusColumns) -> Iterator[Signal]:
    times = heard.told_tick * run.robot.period_s
    error = MM_PER_M * (heard.com - heard.com_reference)
    for axis, values in zip(AXES, error.T, strict=True):
        yield Signal(f"com_{axis}", ESTIMATED, *thin(times, values))
    for foot, side in enumerate(("left", "right")):
        normal = 6 * foot + 2
        for kind, wrenches in ((MEASURED, heard.F_meas), (DESIRED, heard.F_id)):
            yield Signal(f"force_{side}", kind, *thin(times, wrenches[:, normal]))
        stands = heard.in_contact[:, foot]
        yield Signal(f"contact_{side}", ESTIMATED, *changes(times, stands))
    for kind, values in zip((MEDIAN, P99), heard.tick_ms.T, strict=True):
        yield Signal("tick", kind, *thin(times, values))
    answered = heard.answer_tick * run.robot.period_s
    yield Signal("answer", EACH, *thin(answered, heard.answer_ms))


def _sensors(run: RunData, heard: BusColumns, shape: RobotShape) -> Iterator[Signal]:
    times = heard.ankle_tick * run.robot.period_s
    for axis, force in zip(AXES, heard.ankle[:, :3].T, strict=True):
        yield Signal(f"ankle_force_{axis}", REPORTED, *thin(times, force))
    for axis, moment in zip(AXES, heard.ankle[:, 3:].T, strict=True):
        yield Signal(f"ankle_moment_{axis}", REPORTED, *thin(times, moment))
    yield from _imu(run, heard, shape)


def _imu(run: RunData, heard: BusColumns, shape: RobotShape) -> Iterator[Signal]:
    """Attitude of the base as the IMU has it; its yaw is free."""
    rows = heard.imu_tick.astype(int)
    is_attitude = np.linalg.norm(heard.imu_quat_xyzw, axis=1) > 0.0
    known = (rows < len(run.ticks["q"])) & is_attitude
    if not known.any():
        return
    rows = rows[known]
    # Thinned first: the pose of the unit on the base takes a walk along the links.
    step = max(1, len(rows) // 2000)
    rows = rows[::step]
    frame = run.robot.file.imu.frame
    on_base = np.array([shape.poses(q)[frame][:3, :3] for q in run.ticks["q"][rows]])
    unit = Rotation.from_quat(heard.imu_quat_xyzw[known][::step])
    base = unit * Rotation.from_matrix(on_base).inv()
    angles = base.as_euler("xyz", degrees=True)
    times = rows * run.robot.period_s
    for turn, angle in zip(TURNS[:2], angles.T[:2], strict=True):
        yield Signal(f"base_{turn}", ESTIMATED, *thin(times, angle))


def _words(run: RunData, heard: BusColumns) -> Iterator[Signal]:
    """States as numbers, the row of their word in the panel."""
    period_s = run.robot.period_s
    for panel, words, said, ticks in (
        ("mode", MODES, heard.mode, heard.mode_tick),
        ("state", STATES, heard.state, heard.told_tick),
    ):
        known = [row for row, word in enumerate(said) if word in words]
        values = np.array([words.index(said[row]) for row in known], dtype=np.float64)
        yield Signal(panel, REPORTED, *changes(ticks[known] * period_s, values))
