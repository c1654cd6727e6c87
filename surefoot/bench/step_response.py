"""How a robot answers a smooth step of the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surefoot.schemas.arrays import Array

SETTLED = 0.02
"""Of the step: what is this close to its final value has settled."""
RISEN, HALF = 0.9, 0.5
FINAL_S = 1.0
"""The final value is the mean over this long at the end [s]."""


@dataclass(frozen=True)
class StepFigures:
    """Figures of a step of the ground; times count from its beginning.

    Two curves are looked at. The sway is the lean of the centre of mass in space: it
    should come back to where it was, so that its size, the time of its peak and the
    time until it has settled tell how it went. The answer is what the robot did to get
    there, the body's way against the ground: a step itself, with a delay, a rise and
    an overshoot. Shares are of the step of the ground.

    Attributes:
        sway_peak: largest sway, signed [deg/deg].
        sway_peak_s: when that was [s].
        sway_final: sway that stays [deg/deg].
        settling_s: until the sway stays within 2 % of the step of what it ends with;
            None when it had not settled before its last second [s].
        delay_s: until half of the answer; None when there was none [s].
        rise_s: until 90 % of the answer [s].
        overshoot: of the answer, over its final value.
    """

    sway_peak: float
    sway_peak_s: float
    sway_final: float
    settling_s: float | None
    delay_s: float | None
    rise_s: float | None
    overshoot: float | None


def step_figures(
    time_s: Array, stimulus: Array, sway: Array, answer: Array, *, start_s: float
) -> StepFigures:
    """Measure a step.

    Args:
        time_s: (n,) rising [s].
        stimulus: (n,) motion of the ground, in the unit of the sway.
        sway: (n,) lean of the centre of mass in space.
        answer: (n,) of the body against the ground; ends at the step when the robot
            stands as before.
        start_s: when the ground begins to move [s].
    """
    before, after = time_s < start_s, time_s >= start_s
    since = time_s[after] - start_s
    size = _final(time_s, stimulus) - stimulus[before].mean()
    sway_end = (_final(time_s, sway) - sway[before].mean()) / size
    course = (sway[after] - sway[before].mean()) / size
    peak = int(np.argmax(np.abs(course)))
    away = np.abs(course - sway_end) > SETTLED
    last = len(away) - int(np.argmax(away[::-1])) if away.any() else 0
    settled = last < len(since) and since[last] <= since[-1] - FINAL_S
    went = (answer[after] - answer[before].mean()) / size
    end = float((_final(time_s, answer) - answer[before].mean()) / size)
    is_answer = abs(end) > SETTLED
    return StepFigures(
        sway_peak=float(course[peak]),
        sway_peak_s=float(since[peak]),
        sway_final=float(sway_end),
        settling_s=float(since[last]) if settled else None,
        delay_s=_reaches(since, went, HALF * end) if is_answer else None,
        rise_s=_reaches(since, went, RISEN * end) if is_answer else None,
        overshoot=max(0.0, float(np.max(went / end)) - 1.0) if is_answer else None,
    )


def _final(time_s: Array, values: Array) -> float:
    return float(values[time_s > time_s[-1] - FINAL_S].mean())


def _reaches(since: Array, values: Array, level: float) -> float:
    """First time at a level."""
    return float(since[int(np.argmax(values * np.sign(level) >= abs(level)))])
