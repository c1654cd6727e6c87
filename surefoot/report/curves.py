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
"""Of the figure; the margin holds axis and legend."""
AXES = ("x", "y", "z")
TURNS = ("roll", "pitch", "yaw")
MODES = ("off", "hold", "active", "fault")
CONTACT = ("no", "yes")
NORMALS = {"left": 2, "right": 8}
"""Where the normal force of each sole is among the wrenches of both."""
STILL = 1e-6
"""A platform that moves less is not drawn [m, rad]."""
TRUE, ESTIMATED, MEASURED, DESIRED = "true", "estimated", "measured", "desired"
EACH = "each tick"
REPORTED = "as reported"
_GAP_PERIODS = 1.5
"""What is further apart than so many periods is not of consecutive ticks."""
BUCKETS = 800
"""Stretches of time per curve, about one per pixel of a wide plot."""


def footsteps(run: RunData) -> str:
    """Draw the walk of a run.

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
    """A step of a run.

    Attributes:
        begin: row at which the foot left.
        side: 0 for the left foot, 1 for the right one.
        planned: (4,) x, y, z [m] and yaw [rad] where it was to be set as it left.
        taken: (4,) where it was in the end.
    """

    begin: int
    side: int
    planned: Array
    taken: Array


def steps_of(run: RunData) -> list[StepTaken]:
    """Return the steps of a run, in order; none of a run without a walk."""
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
    """Corners of a sole, (5, 2), the first one twice [m]."""
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
    """Keep the least and the largest value of each stretch of time.

    So a peak of one tick is seen, which every n-th point would miss. In a gap that is
    wide enough to be seen stands a NaN, since nobody knows what was there.

    Args:
        times: (n,) in order.
        values: (n,), all of them known.
        period_s: of the times, without gaps [s].
        buckets: stretches of as many points each.

    Returns:
        Times and values, at most 2 per stretch, in order; first and last are kept.
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
    """Put a NaN behind some rows, where a line is not to go on."""
    after = ends + 1
    return np.insert(times, after, times[ends]), np.insert(values, after, np.nan)


def changes(times: Array, values: Array) -> tuple[Array, Array]:
    """Keep where a value that stays the same for long becomes another one.

    Args:
        times: (n,) in order.
        values: (n,), NaN where it is not known.

    Returns:
        Times and values of first, changes, last, and last before it is not known.
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


def curves(run: RunData) -> Iterator[Curve]:
    """All curves of a run, in few enough points, without those that nobody told."""
    for curve in (*_truth(run), *_platforms(run), *_controller(run), *_sensors(run)):
        if len(curve.times):
            yield curve
    if run.heard is not None:
        yield from _words(run, run.heard)


def com_error(run: RunData) -> Array:
    """(n, 3) true centre of mass less reference, as in the result [m]."""
    signals = run.signals
    error: Array = signals["true_com"] - run.com_reference
    middle = 0.5 * (signals["true_sole_left"] + signals["true_sole_right"])
    error[:, :2] -= middle[:, :2]
    return error


def _thinned(panel: str, kind: str, run: RunData, values: Array) -> Curve:
    """A curve of what is known of a signal."""
    known = np.isfinite(values)
    return _drawn(panel, kind, run, run.signals.time_s[known], values[known])


def _drawn(panel: str, kind: str, run: RunData, times: Array, values: Array) -> Curve:
    """A curve of known values; it is broken where some are missing."""
    return Curve(panel, kind, *thin(times, values, period_s=run.robot.period_s))


def _contact(side: str, kind: str, run: RunData, stands: Array) -> Curve:
    """Whether a foot stands: 0 or 1, NaN where it is not known."""
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
    """Roll, pitch and yaw where they are known.

    Args:
        panel: which angles.
        kind: of curve.
        run: whose.
        quat_xyzw: (ticks, 4) world from body.
        axes: (4,) the body's own axes seen from those whose angles are asked for.
    """
    known = np.isfinite(quat_xyzw).all(axis=1)
    turned = Rotation.from_quat(quat_xyzw[known]) * Rotation.from_quat(axes).inv()
    angles = turned.as_euler("xyz", degrees=True)
    for turn, angle in zip(TURNS, angles.T, strict=True):
        yield _drawn(f"{panel}_{turn}", kind, run, run.signals.time_s[known], angle)


def _truth(run: RunData) -> Iterator[Curve]:
    signals = run.signals
    if not run.is_walk:  # on the way it is not midway between the feet
        for axis, error in zip(AXES, com_error(run).T, strict=True):
            yield _thinned(f"com_{axis}", TRUE, run, MM_PER_M * error)
    pose = signals["true_base_pose"]
    turned = Rotation.from_matrix(run.robot.R_upright_base).as_quat()
    yield from _attitude("base", TRUE, run, pose[:, 3:], axes=turned)
    for axis, place in zip(AXES, pose[:, :3].T, strict=True):
        yield _thinned(f"base_{axis}", TRUE, run, MM_PER_M * (place - place[0]))
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
    """What the controller tells, as far as it does.

    Its estimate of the state counts from the end of its calibration on. Nothing acts on
    it before, and single readings are off by more than all that follows.
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
            walks = signals["walk_phase"] > 0  # its reference means nothing before
            for axis, values in zip(AXES, signals[name].T, strict=False):
                known = np.where(walks, MM_PER_M * values, np.nan)
                yield _thinned(f"dcm_{axis}", kind, run, known)
    if "base_pose" in signals:
        # Its yaw is against the feet, not against the world.
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
    """States as numbers, the row of their word in the panel."""
    period_s = run.robot.period_s
    for panel, words, said, ticks in (
        ("mode", MODES, heard.mode, heard.mode_tick),
        ("state", STATES, heard.state, heard.told_tick),
    ):
        known = [row for row, word in enumerate(said) if word in words]
        values = np.array([words.index(said[row]) for row in known], dtype=np.float64)
        yield Curve(panel, REPORTED, *changes(ticks[known] * period_s, values))
