"""Turns recorded ground into motions: integrated, freed of drift, looked up by time."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.motions import Quantity, RecordedMotion
from surefoot.schemas.result import RecordedGround
from surefoot.schemas.scenario import Scenario
from surefoot.sim_robot.catalogue import ScenarioError, within
from surefoot.sim_robot.conventions import FASTEST_HZ, SIM_STEP_S, MotionLaw
from surefoot.sim_robot.ground_records import GroundRecord, read_record

LARGEST = 1000.0
"""Largest value [m or rad, or these per s or s^2]: no robot stands on ground beyond."""
_FILTER_ORDER = 2
"""Order of the high-pass. It runs forwards and backwards: twice that order in all."""
_PADDING_PERIODS = 3.0
"""Zeros before and after a record, in periods of the high-pass."""
_SLOWEST_HZ = 1e-3
"""Lowest high-pass [Hz]: a lower one's padding would be longer than any scenario."""
_LEAST_LINE = 0.01
"""A drift whose rise over the largest value is above this share is taken off."""
_LEAST_STROKE = 1e-9
"""A smaller stroke is rounding of constant values [m or rad]."""
LONGEST_S = 3600.0
"""Longest record, as the longest duration of a scenario [s]."""
_MOST_MISSING = 5.0
"""Longest gap that a curve may bridge, in typical intervals."""
_BURST = 16
"""Number of intervals over which the sampling rate is taken, since stamps jitter."""


@dataclass(frozen=True)
class RecordedTrack:
    """A recorded motion as the platform carries it out, at every simulation step.

    Attributes:
        sha256: digest of the file.
        position: (n,) [m or rad]; begins at zero.
        velocity: (n,) its derivative [per s]; begins and ends at zero.
        acceleration: (n,) the derivative of the velocity [per s^2].
    """

    sha256: str
    position: Array
    velocity: Array
    acceleration: Array


def recorded_law(motion: RecordedMotion) -> MotionLaw:
    """Make the motion of a file, cubic between simulation steps.

    Raises:
        ScenarioError: the file cannot be read, or is no motion.
    """
    track = recorded_track(motion)
    position, velocity = track.position, track.velocity
    start_s, last = motion.start_s, len(position) - 1
    end = float(position[last])

    def law(time_s: float) -> tuple[float, float]:
        since = (time_s - start_s) / SIM_STEP_S
        if since <= 0.0:
            return 0.0, 0.0
        index = int(since)
        if index >= last:
            return end, 0.0
        u = since - index
        p, p_next = position.item(index), position.item(index + 1)
        v = velocity.item(index) * SIM_STEP_S
        v_next = velocity.item(index + 1) * SIM_STEP_S
        # Hermite: p + v u + b u^2 + a u^3.
        rise = p_next - p
        a, b = v + v_next - 2.0 * rise, 3.0 * rise - 2.0 * v - v_next
        return (
            p + u * (v + u * (b + u * a)),
            (v + u * (2.0 * b + 3.0 * u * a)) / SIM_STEP_S,
        )

    return law


def recorded_track(motion: RecordedMotion) -> RecordedTrack:
    """Read a recorded motion and compute the platform's motion.

    The record is sampled at the simulation's steps and drift is taken off. Missing
    quantities are integrated or differentiated. The velocity is faded in and out.

    Raises:
        ScenarioError: the file cannot be read, or is no motion; ``field`` is the key.
    """
    state: tuple[int, ...] = ()
    try:
        about = Path(motion.file).stat()
        # Another file in its place may have the same time of its last change.
        state = about.st_mtime_ns, about.st_ctime_ns, about.st_size, about.st_ino
    except (OSError, ValueError):
        pass  # reading the file will report what is wrong
    return _track(motion, state)


@lru_cache(maxsize=8)
def _track(motion: RecordedMotion, state: tuple[int, ...]) -> RecordedTrack:
    """Do the work of :func:`recorded_track`, anew when the file has changed."""
    del state
    record = read_record(motion)
    times, values = _cut(record, motion)
    try:
        factor = motion.si_factor(motion.units or record.units, record.quantity)
    except ValueError as error:
        said = "" if motion.units else f" (as {Path(motion.file).name} says)"
        raise ScenarioError(
            f"units: {error}{said}; `units` in the scenario overrides the file's",
            field="units",
        ) from error
    with np.errstate(over="ignore"):  # the check below reports it
        values = motion.scale * factor * values
    _check_size(values, motion, "holds")
    drift_hz = motion.drift_of(record.quantity)
    _check_drift(drift_hz, times)
    v, a = _velocity(record.quantity, times, values, drift_hz=drift_hz)
    v, a = _faded(v, a, blend_s=motion.blend)
    # Corrected trapezoid: exact for a velocity that is cubic between two steps.
    steps = 0.5 * SIM_STEP_S * (v[1:] + v[:-1])
    steps += SIM_STEP_S**2 / 12.0 * (a[:-1] - a[1:])
    p = np.concatenate(([0.0], np.cumsum(steps)))
    _check_size(p, motion, "moves the ground by")
    if np.ptp(p) < _LEAST_STROKE:
        raise ScenarioError(
            f"file: {motion.file} does not move the ground in {motion.axis}: its "
            "values are all alike, or what is in them is taken for drift; is it the "
            "right column, channel or field?",
            field="file",
        )
    return RecordedTrack(hashlib.sha256(record.content).hexdigest(), p, v, a)


def _check_drift(drift_hz: float, times: Array) -> None:
    most_hz = 0.5 / float(np.median(np.diff(times)))
    fits = _SLOWEST_HZ <= drift_hz < most_hz * (1.0 - 1e-6)
    if drift_hz != 0.0 and not fits:
        raise ScenarioError(
            f"drift_hz: got {drift_hz:g}, expected 0 for none, or from {_SLOWEST_HZ:g} "
            f"to less than {most_hz:g} Hz, half the record's rate",
            field="drift_hz",
        )


def _check_size(values: Array, motion: RecordedMotion, what: str) -> None:
    largest = float(np.abs(values).max())
    if not largest <= LARGEST:  # which nan is neither
        raise ScenarioError(
            f"file: {motion.file} {what} {largest:g}, expected at most {LARGEST:g} in "
            "SI units; are its numbers, units and scale right?",
            field="file",
        )


def recorded_ground(scenario: Scenario) -> list[RecordedGround]:
    """Return a summary of each recorded motion of a scenario, in the order of its file.

    Raises:
        ScenarioError: a file cannot be read, or is no motion.
    """
    grounds = []
    for index, platform in enumerate(scenario.platform):
        for at, motion in enumerate(platform.motion):
            if isinstance(motion, RecordedMotion):
                with within(f"platform[{index}].motion[{at}]"):
                    track = recorded_track(motion)
                per_unit = math.degrees(1.0) if motion.is_rotation else 1.0
                grounds.append(
                    RecordedGround(
                        file=Path(motion.file).name,
                        sha256=track.sha256,
                        platform=index,
                        axis=motion.axis,
                        stroke=per_unit * float(np.ptp(track.position)),
                        speed_max=per_unit * float(np.abs(track.velocity).max()),
                        acceleration_max=per_unit
                        * float(np.abs(track.acceleration).max()),
                    )
                )
    return grounds


def _cut(record: GroundRecord, motion: RecordedMotion) -> tuple[Array, Array]:
    """Return times from zero [s] and values of the selected part."""
    times = record.times - record.times[0]
    until = times[-1] if motion.to_s is None else motion.to_s
    chosen = (times >= motion.from_s - 1e-9) & (times <= until + 1e-9)
    count = int(np.count_nonzero(chosen))
    if motion.from_s >= times[-1]:
        raise ScenarioError(
            f"from_s: got {motion.from_s:g} s, but {motion.file} ends after "
            f"{times[-1]:g} s; begin before that",
            field="from_s",
        )
    if count < 4:
        raise ScenarioError(
            f"from_s: {motion.file} lasts {times[-1]:g} s; from {motion.from_s:g} s to "
            f"{until:g} s there are {count} samples, expected at least 4",
            field="from_s",
        )
    times, values = times[chosen], record.values[chosen]
    _check_times(times, motion)
    return times - times[0], values


def _check_times(times: Array, motion: RecordedMotion) -> None:
    """Refuse a record that is too long, too fast or has gaps, before resampling."""
    length_s = float(times[-1] - times[0])
    if length_s > LONGEST_S:
        raise ScenarioError(
            f"file: {motion.file} lasts {length_s:g} s, expected at most "
            f"{LONGEST_S:g}; are its times in seconds? `from_s` and `to_s` cut a piece "
            "out",
            field="file",
        )
    most_hz, over = 2.0 * FASTEST_HZ, min(_BURST, len(times) - 1)
    rates_hz = over / (times[over:] - times[:-over])
    at = int(np.argmax(rates_hz))
    mean_hz = (len(times) - 1) / length_s
    # Jitter of the stamps alone shortens some intervals.
    if mean_hz > most_hz * (1.0 + 1e-6) or rates_hz[at] > 1.25 * most_hz:
        raise ScenarioError(
            f"file: {motion.file} has {rates_hz[at]:g} samples a second at "
            f"{times[at]:g} s, expected at most {most_hz:g}, the simulation's rate: "
            "what is faster than half of that cannot be shown; low-pass the record and "
            "sample it anew",
            field="file",
        )
    steps = np.diff(times)
    typical, at = float(np.median(steps)), int(np.argmax(steps))
    if steps[at] > _MOST_MISSING * typical:
        raise ScenarioError(
            f"file: {motion.file} has no samples from {times[at]:g} s to "
            f"{times[at + 1]:g} s, expected one about every {typical:g} s; take a "
            "piece beside the gap by `from_s` and `to_s`, or fill it",
            field="file",
        )


def _velocity(
    quantity: Quantity, times: Array, values: Array, *, drift_hz: float
) -> tuple[Array, Array]:
    """Return velocity and acceleration at every step, each (n,) in SI."""
    from scipy.interpolate import CubicSpline

    grid = SIM_STEP_S * np.arange(round(times[-1] / SIM_STEP_S) + 1)
    # Straight lines between samples would weaken fast parts.
    spline = CubicSpline(times, values)
    if quantity == "position":
        v, a = spline(grid, 1), spline(grid, 2)
        return _without_drift(v, drift_hz), _without_drift(a, drift_hz)
    measured = spline(np.minimum(grid, times[-1]))
    if drift_hz > 0.0:
        measured = _without_line(measured)
    padding = round(_PADDING_PERIODS / drift_hz / SIM_STEP_S) if drift_hz > 0.0 else 0
    measured = np.pad(measured, padding)
    if quantity == "acceleration":
        a = _without_drift(measured, drift_hz)
        steps = 0.5 * SIM_STEP_S * (a[1:] + a[:-1])
        v = np.concatenate(([0.0], np.cumsum(steps)))
    else:
        v = _without_drift(measured, drift_hz)
        a = np.gradient(v, SIM_STEP_S)
    inner = slice(padding, padding + len(grid))
    return v[inner], a[inner]


def _without_line(values: Array) -> Array:
    """Take off an offset or a line, which would be a step at both ends and ring there.

    A line with almost no rise may be motion as well as drift, so it stays.
    """
    from scipy.signal import detrend

    level: Array = detrend(values, type="constant")
    straight: Array = detrend(values, type="linear")
    line = level - straight
    is_drift = abs(line[-1] - line[0]) > _LEAST_LINE * np.abs(level).max()
    return straight if is_drift else level


def _without_drift(values: Array, drift_hz: float) -> Array:
    """High-pass without phase shift: Butterworth, forwards and backwards."""
    from scipy.signal import butter, sosfiltfilt

    if drift_hz <= 0.0:
        return values
    sections = butter(
        _FILTER_ORDER, drift_hz, btype="highpass", fs=1.0 / SIM_STEP_S, output="sos"
    )
    padding = min(9, len(values) - 1)  # SciPy's default, if there are so many values
    filtered: Array = sosfiltfilt(sections, values, padlen=padding)
    return filtered


def _faded(v: Array, a: Array, *, blend_s: float) -> tuple[Array, Array]:
    """Fade a velocity in and out; return it with its derivative."""
    count = len(v)
    u = np.arange(count) * SIM_STEP_S / blend_s
    begin, end = np.minimum(u, 1.0), np.minimum(u[::-1], 1.0)
    share = begin**2 * (3.0 - 2.0 * begin) * end**2 * (3.0 - 2.0 * end)
    slope = np.gradient(share, SIM_STEP_S)
    return share * v, share * a + slope * v
