"""The curves of a report's plots, and the footsteps of a walk."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from io import StringIO
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from surefoot.report.run_data import BusColumns, RunData
from surefoot.schemas.arrays import MM_PER_M, Array
from surefoot.schemas.reasons import StabilizerState
from surefoot.schemas.signals import BY_NAME, MISSING
from surefoot.sim_robot.metrics import CONTACT_LOST_N

PLANNED, TAKEN, DCM, ZMP = "#8a929c", "#0072b2", "#d55e00", "#009e73"
_SINGLE = BY_NAME["walk_phase"].words.index("single")
_SWING = BY_NAME["foot_state"].words.index("swing")
WIDTH_IN, HEIGHTS_IN, MARGIN_IN = 9.0, (1.5, 6.0), 1.3
"""Width of the figure, its least and greatest height, room for axis and legend."""
AXES = ("x", "y", "z")
TURNS = ("roll", "pitch", "yaw")
MODES = ("off", "hold", "active", "fault")
CONTACT = ("no", "yes")
NORMALS = {"left": 2, "right": 8}
"""Index of each sole's normal force in the wrenches (12,) of both."""
STILL = 1e-6
"""A platform axis that moves less than this is not drawn [m, rad]."""
TRUE, ESTIMATED, MEASURED, DESIRED = "true", "estimated", "measured", "desired"
EACH = "each tick"
REPORTED = "as reported"
_GAP_PERIODS = 1.5
"""Rows farther apart than this many periods are not consecutive ticks."""
BUCKETS = 800
"""Stretches of time per curve; about one per pixel of a wide plot."""


def footsteps(run: RunData) -> str:
    """Draw soles, ZMP and DCM of a walk, seen from above.

    Returns:
        SVG; empty for a run without steps.
    """
    signals = run.signals
    if not run.is_walk:
        return ""
    rows = np.flatnonzero(signals["walk_phase"] > 0)
    from matplotlib.figure import Figure

    steps = steps_of(run)
    goals, taken = [step.planned for step in steps], [step.taken for step in steps]
    first = signals["footholds"][rows[0]].reshape(2, 4)
    soles = np.concatenate([_sole(run, place) for place in (*goals, *taken, *first)])
    length, width = np.ptp(soles, axis=0)
    height = float(np.clip(WIDTH_IN * width / length, *HEIGHTS_IN)) + MARGIN_IN
    figure = Figure(figsize=(WIDTH_IN, height), layout="constrained")
    axes: Any = figure.subplots()
    for places, colour, style in (
        (goals, PLANNED, "--"),
        ([*taken, *first], TAKEN, "-"),
    ):
        for place in places:
            axes.plot(*_sole(run, place).T, style, color=colour, linewidth=1.0)
    for name, colour, style, label in (
        ("zmp_reference", ZMP, "-", "ZMP, reference"),
        ("dcm_reference", DCM, "--", "DCM, reference"),
        ("dcm", DCM, "-", "DCM, estimated"),
    ):
        axes.plot(*signals[name][rows].T, style, color=colour, lw=0.9, label=label)
    axes.plot([], [], "--", color=PLANNED, label="soles, planned")
    axes.plot([], [], "-", color=TAKEN, label="soles, set down")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=5, fontsize=8)
    text = StringIO()
    figure.savefig(text, format="svg")
    whole = text.getvalue()
    return whole[whole.index("<svg") :]


class StepTaken(NamedTuple):
    """One step of a run, in the odometry frame.

    Attributes:
        begin: row at which the foot left the ground.
        side: 0 for the left foot, 1 for the right one.
        planned: (4,) x, y, z [m] and yaw [rad] of the foothold planned at lift-off.
        taken: (4,) the foothold in the end.
    """

    begin: int
    side: int
    planned: Array
    taken: Array


def steps_of(run: RunData) -> list[StepTaken]:
    """Return the steps of a run in order; none without a walk."""
    signals = run.signals
    if not run.is_walk:
        return []
    single = signals["walk_phase"] == _SINGLE
    goals, footholds = signals["foot_goals"], signals["footholds"]
    begins = np.flatnonzero(single[1:] & ~single[:-1]) + 1
    ends = np.flatnonzero(~single[1:] & single[:-1]) + 1
    steps = []
    for begin, end in zip(begins, ends, strict=False):
        states = signals["foot_state"][begin]
        side = int(np.argmax(states == _SWING))
        columns = slice(4 * side, 4 * side + 4)
        steps.append(
            StepTaken(int(begin), side, goals[begin, columns], footholds[end, columns])
        )
    return steps


def _sole(run: RunData, place: Array) -> Array:
    """Return the corners of a sole from above, (5, 2) [m]; the last is the first."""
    x, y, _, yaw = place.tolist()
    foot = run.robot.file.foot[0]
    length, width = foot.half_length_m, foot.half_width_m
    corners = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1)]) * (length, width)
    cos, sin = np.cos(yaw), np.sin(yaw)
    turned: Array = corners @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
    return turned


STATES = tuple(reversed(StabilizerState))


def thin(
    times: Array,
    values: Array,
    *,
    period_s: float = float("inf"),
    buckets: int = BUCKETS,
) -> tuple[Array, Array]:
    """Keep the smallest and the largest value of each stretch of time.

    So a peak of one tick stays visible, which every n-th point could miss. A gap that
    is wide enough to be seen is marked by a NaN.

    Args:
        times: (n,) in order [s].
        values: (n,) finite values.
        period_s: period of the times without gaps [s].
        buckets: number of stretches, of equally many points each.

    Returns:
        Times and values in order, at most two per stretch besides the ends of gaps;
        first and last are kept.
    """
    count = len(times)
    if count <= 2 * buckets:
        ends = np.flatnonzero(np.diff(times) > _GAP_PERIODS * period_s)
        return _broken(times, values, ends)
    widest = max(_GAP_PERIODS * period_s, (times[-1] - times[0]) / buckets)
    ends = np.flatnonzero(np.diff(times) > widest)
    edges = np.linspace(0, count, buckets + 1).astype(int)
    kept = {0, count - 1, *ends.tolist(), *(ends + 1).tolist()}
    for start, end in pairwise(edges):
        stretch = values[start:end]
        kept.add(start + int(np.argmin(stretch)))
        kept.add(start + int(np.argmax(stretch)))
    rows = np.array(sorted(kept))
    return _broken(times[rows], values[rows], np.searchsorted(rows, ends))


def _broken(
    times: Array, values: Array, ends: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Insert a NaN after some rows, where the line is to be interrupted."""
    after = ends + 1
    return np.insert(times, after, times[ends]), np.insert(values, after, np.nan)


def changes(times: Array, values: Array) -> tuple[Array, Array]:
    """Keep the rows at which a piecewise constant value changes.

    Args:
        times: (n,) in order [s].
        values: (n,), NaN where unknown.

    Returns:
        Times and values of the first row, of each change, of the last row, and of the
        last row before an unknown one.
    """
    if len(times) == 0:
        return times, values
    unknown = np.isnan(values)
    differs = values[1:] != values[:-1]
    is_new = np.concatenate(([True], differs & ~(unknown[1:] & unknown[:-1])))
    is_new[:-1] |= unknown[1:] & ~unknown[:-1]
    is_new[-1] = True
    return times[is_new], values[is_new]


class Curve(NamedTuple):
    """One curve of a plot.

    Attributes:
        panel: key of its plot.
        kind: source of the values: true, estimated, measured, desired, ...
        times: (n,) simulated time [s].
        values: (n,) in the unit of the plot.
    """

    panel: str
    kind: str
    times: Array
    values: Array


def curves(run: RunData) -> Iterator[Curve]:
    """Yield all curves of a run, thinned; signals without values give none."""
    for curve in (*_truth(run), *_platforms(run), *_controller(run), *_sensors(run)):
        if len(curve.times):
            yield curve
    if run.heard is not None:
        yield from _words(run, run.heard)


def com_error(run: RunData) -> Array:
    """Return (n, 3) true centre of mass minus reference, as in the result [m]."""
    signals = run.signals
    error: Array = signals["true_com"] - run.com_reference
    middle = 0.5 * (signals["true_sole_left"] + signals["true_sole_right"])
    error[:, :2] -= middle[:, :2]
    return error


def _thinned(panel: str, kind: str, run: RunData, values: Array) -> Curve:
    """Return a curve of the finite values of a signal."""
    known = np.isfinite(values)
    return _drawn(panel, kind, run, run.signals.time_s[known], values[known])


def _drawn(panel: str, kind: str, run: RunData, times: Array, values: Array) -> Curve:
    """Return a thinned curve of finite values; it is interrupted at gaps."""
    return Curve(panel, kind, *thin(times, values, period_s=run.robot.period_s))


def _contact(side: str, kind: str, run: RunData, stands: Array) -> Curve:
    """Return a curve of 0 and 1 for a foot that stands; ``MISSING`` becomes NaN."""
    values = np.where(stands >= 0, stands, np.nan)
    told = slice(None) if np.isfinite(values).any() else slice(0)
    times = run.signals.time_s[told]
    return Curve(f"contact_{side}", kind, *changes(times, values[told]))


def _attitude(
    panel: str,
    kind: str,
    run: RunData,
    quat_xyzw: Array,
    *,
    axes: Sequence[float] = (0.0, 0.0, 0.0, 1.0),
) -> Iterator[Curve]:
    """Yield roll, pitch and yaw [deg] at the rows where they are known.

    Args:
        panel: first part of the plots' keys.
        kind: source of the values.
        run: the run.
        quat_xyzw: (ticks, 4) world from body.
        axes: (4,) attitude of the body's axes in the axes whose angles are wanted.
    """
    known = np.isfinite(quat_xyzw).all(axis=1)
    turned = Rotation.from_quat(quat_xyzw[known]) * Rotation.from_quat(axes).inv()
    angles = turned.as_euler("xyz", degrees=True)
    for turn, angle in zip(TURNS, angles.T, strict=True):
        yield _drawn(f"{panel}_{turn}", kind, run, run.signals.time_s[known], angle)


def _truth(run: RunData) -> Iterator[Curve]:
    signals = run.signals
    if not run.is_walk:  # in a walk the CoM is not midway between the feet
        for axis, error in zip(AXES, com_error(run).T, strict=True):
            yield _thinned(f"com_{axis}", TRUE, run, MM_PER_M * error)
    pose = signals["true_base_pose"]
    turned = Rotation.from_matrix(run.robot.R_upright_base).as_quat()
    yield from _attitude("base", TRUE, run, pose[:, 3:], axes=turned)
    start = pose[run.drawable(np.zeros(1))[0], :3]
    for axis, way in zip(AXES, (pose[:, :3] - start).T, strict=True):
        yield _thinned(f"base_{axis}", TRUE, run, MM_PER_M * way)
    for side, index in NORMALS.items():
        normal = signals["true_F"][:, index]
        yield _thinned(f"force_{side}", TRUE, run, normal)
        stands = np.where(np.isnan(normal), MISSING, normal >= CONTACT_LOST_N)
        yield _contact(side, TRUE, run, stands)


def _platforms(run: RunData) -> Iterator[Curve]:
    poses = run.signals.get("true_platform_pose")
    if poses is None:
        return
    for index in range(poses.shape[1]):
        known = np.isfinite(poses[:, index]).all(axis=1)
        times, pose = run.signals.time_s[known], poses[known, index]
        moved = pose[:, :3] - pose[0, :3]
        turned = Rotation.from_quat(pose[:, 3:]).as_euler("xyz")
        for names, columns, scale in (
            (AXES, moved, MM_PER_M),
            (TURNS, turned, np.degrees(1.0)),
        ):
            for name, values in zip(names, columns.T, strict=True):
                if np.ptp(values) > STILL:
                    key = f"platform_{index}_{name}"
                    yield _drawn(key, TRUE, run, times, scale * values)


def _controller(run: RunData) -> Iterator[Curve]:
    """Yield the controller's own signals.

    Estimates are drawn from the end of the calibration on. Before it nothing uses
    them, and single readings would be the largest values of the plot.
    """
    signals = run.signals
    calibrated = signals.time_s >= run.settings.get("estimator.calibration_s", 0.0)
    if "com" in signals and "com_reference" in signals:
        error = MM_PER_M * (signals["com"] - signals["com_reference"])
        error[~calibrated] = np.nan
        for axis, values in zip(AXES, error.T, strict=True):
            yield _thinned(f"com_{axis}", ESTIMATED, run, values)
    for name, kind in (("dcm", ESTIMATED), ("dcm_reference", DESIRED)):
        if name in signals:
            walks = signals["walk_phase"] > 0  # before, the reference means nothing
            for axis, values in zip(AXES, signals[name].T, strict=False):
                known = np.where(walks, MM_PER_M * values, np.nan)
                yield _thinned(f"dcm_{axis}", kind, run, known)
    if "base_pose" in signals:
        # Its yaw is relative to the feet, not to the world.
        told = np.where(calibrated[:, np.newaxis], signals["base_pose"][:, 3:], np.nan)
        yield from [*_attitude("base", ESTIMATED, run, told)][:2]
    for foot, (side, index) in enumerate(NORMALS.items()):
        for kind, name in ((MEASURED, "F_meas"), (DESIRED, "F_id")):
            if name in signals:
                yield _thinned(f"force_{side}", kind, run, signals[name][:, index])
        if "in_contact" in signals:
            yield _contact(side, ESTIMATED, run, signals["in_contact"][:, foot])
    if "controller_ms" in signals:
        yield _thinned("tick", EACH, run, signals["controller_ms"])
    if run.heard is not None:
        answered = run.heard.answer_tick * run.robot.period_s
        yield _drawn("answer", EACH, run, answered, run.heard.answer_ms)


def _sensors(run: RunData) -> Iterator[Curve]:
    wrench = run.signals["ft_left"]
    for axis, force, moment in zip(AXES, wrench.T[:3], wrench.T[3:], strict=True):
        yield _thinned(f"ankle_force_{axis}", REPORTED, run, force)
        yield _thinned(f"ankle_moment_{axis}", REPORTED, run, moment)


def _words(run: RunData, heard: BusColumns) -> Iterator[Curve]:
    """Yield states as numbers; each is the index of its word in the plot."""
    period_s = run.robot.period_s
    for panel, words, said, ticks in (
        ("mode", MODES, heard.mode, heard.mode_tick),
        ("state", STATES, heard.state, heard.told_tick),
    ):
        known = [row for row, word in enumerate(said) if word in words]
        values = np.array([words.index(said[row]) for row in known], dtype=np.float64)
        yield Curve(panel, REPORTED, *changes(ticks[known] * period_s, values))
