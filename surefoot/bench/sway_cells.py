"""Runs of COMTEST: the ground steps, swings or follows a ternary sequence.

A translation has the size of a tilt if it moves the feet as far as the tilt moves a
stiff body's centre of mass: tilt times height. Divided by the height it is an angle:
all gains are in deg/deg. With gain 0 the body stays upright over the feet. With gain 1
it tilts with the ground, or stays in place while the feet move away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from surefoot.bench.bench_runs import NOISE, BenchCell, Under
from surefoot.bench.sway_response import (
    HARMONICS,
    cycle_spectra,
    sine_response,
    step_figures,
)
from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.motions import Motion, PrtsMotion, RampMotion, SineMotion
from surefoot.schemas.scenario import Platform, Scenario
from surefoot.sim_robot.state_view import PlantTruth
from surefoot.simulation import Simulation

Protocol = Literal["transient", "sinus", "prts"]
SwayAxis = Literal["pitch", "roll", "x", "y"]
PROTOCOLS: tuple[Protocol, ...] = ("transient", "sinus", "prts")
AXES: tuple[SwayAxis, ...] = ("pitch", "roll", "x", "y")
TILTS = ("pitch", "roll")
START_S = 1.0
"""The robot first stands still for this time [s]."""
CYCLE_S = 20.0
"""Duration of a cycle of the ternary sequence at its ordinary speed [s]."""
STEP_S, AFTER_STEP_S = 1.0, 6.0
"""Duration of a step, and of the observation after it [s]."""
PERIODS = 4
"""Periods of a sine that count, after one of fading in and another one."""
LOOK_S, LOOKS_PER_PERIOD = 0.01, 20
"""Longest sampling period, and least number of samples in the shortest period that
counts: too few would show a fast motion as another one."""
CURVE_S = 0.05
"""Sampling period of the stored curves of steps [s]."""


class Stimulus(NamedTuple):
    """Motion of the ground.

    Attributes:
        protocol: kind of motion.
        axis: axis along or about which it moves.
        size_deg: peak-to-peak size, or size of the step; of a translation the
            equivalent tilt [deg].
        frequency_hz: of a sine [Hz].
        speed: of the ternary sequence; 5.0 plays it five times as fast.
        cycles: of the ternary sequence; the first one does not count.
    """

    protocol: Protocol
    axis: SwayAxis
    size_deg: float
    frequency_hz: float = 0.0
    speed: float = 1.0
    cycles: int = 3

    @property
    def cycle_s(self) -> float:
        """Duration of a cycle of the sequence [s]."""
        return CYCLE_S / self.speed

    @property
    def look_s(self) -> float:
        """Sampling period of its measurement [s]."""
        fastest_hz = self.frequency_hz
        if self.protocol == "prts":
            fastest_hz = HARMONICS[-1] / self.cycle_s
        return min(LOOK_S, 1.0 / (LOOKS_PER_PERIOD * max(fastest_hz, 1.0)))

    @property
    def case(self) -> str:
        """The motion in words."""
        words = f"{self.protocol} {self.axis} {self.size_deg:g} deg"
        if self.protocol == "sinus":
            return f"{words} {self.frequency_hz:g} Hz"
        if self.protocol == "prts":
            speed = "" if self.speed == 1.0 else f" x{self.speed:g}"
            return f"{words}{speed}, {self.cycles} cycles"
        return words


@dataclass(frozen=True, kw_only=True)
class SwayCell(BenchCell):
    """A run of COMTEST.

    Attributes:
        stimulus: motion of the ground.
        height_m: height of the centre of mass, to turn translations into angles [m].
    """

    stimulus: Stimulus
    height_m: float

    def probe(self) -> SwayProbe:
        """Return a new probe for a run."""
        return SwayProbe(self.stimulus, self.height_m)


def sway_cell(stimulus: Stimulus, under: Under, *, height_m: float) -> SwayCell:
    """Build the run of a stimulus.

    Args:
        stimulus: motion of the ground.
        under: controller and servo profile.
        height_m: of the robot's centre of mass over its soles [m].
    """
    scenario = Scenario(
        name=f"comtest {stimulus.case}",
        duration_s=_duration_s(stimulus),
        platform=[Platform(foot="both", motion=[_motion(stimulus, height_m)])],
        sensors=NOISE,
    )
    return SwayCell(
        case=stimulus.case,
        scenario=scenario,
        under=under,
        stimulus=stimulus,
        height_m=height_m,
    )


def _duration_s(stimulus: Stimulus) -> float:
    if stimulus.protocol == "prts":
        return START_S + stimulus.cycles * stimulus.cycle_s
    if stimulus.protocol == "sinus":
        looks = math.ceil((PERIODS + 2) / stimulus.frequency_hz / LOOK_S)
        return START_S + looks * LOOK_S
    return START_S + STEP_S + AFTER_STEP_S


def _motion(stimulus: Stimulus, height_m: float) -> Motion:
    axis, size = stimulus.axis, stimulus.size_deg
    unit = "deg"
    if axis not in TILTS:
        size, unit = height_m * math.radians(size), "m"
    if stimulus.protocol == "prts":
        return PrtsMotion(
            axis=axis,
            start_s=START_S,
            speed=stimulus.speed,
            cycles=stimulus.cycles,
            **{f"peak_to_peak_{unit}": size},
        )
    if stimulus.protocol == "sinus":
        return SineMotion(
            axis=axis,
            start_s=START_S,
            frequency_hz=stimulus.frequency_hz,
            **{f"amplitude_{unit}": 0.5 * size},
        )
    # The ground speeds up in the first half of the time and slows down in the second.
    return RampMotion(
        axis=axis,
        start_s=START_S,
        blend_s=0.5 * STEP_S,
        **{f"amplitude_{unit}": size, f"rate_{unit}_s": 2.0 * size / STEP_S},
    )


class SwayProbe:
    """Follows ground and centre of mass, and computes the figures of a protocol."""

    def __init__(self, stimulus: Stimulus, height_m: float) -> None:
        """Begin without measurements.

        Args:
            stimulus: motion of the ground.
            height_m: height of the centre of mass [m].
        """
        self._stimulus, self._height = stimulus, height_m
        self._time_s: list[float] = []
        self._ground: list[float] = []
        self._sway: list[float] = []
        self._first: Vec3 | None = None

    def look(self, sim: Simulation) -> None:
        """Take in the present tick."""
        every = max(1, int(self._stimulus.look_s / sim.robot.period_s + 1e-6))
        if sim.tick % every == 0:
            self.take(sim.time_s, sim.truth)

    def take(self, time_s: float, truth: PlantTruth) -> None:
        """Take in the true state at a time [s]."""
        axis = self._stimulus.axis
        place = truth.platforms[0].position
        if self._first is None:
            self._first = place
        self._time_s.append(time_s)
        self._sway.append(math.degrees(_lean(truth, axis)))
        if axis in TILTS:
            ground = _tilt(truth.platforms[0].quat_xyzw, axis)
        else:
            ground = float((place - self._first)["xy".index(axis)]) / self._height
        self._ground.append(math.degrees(ground))

    def figures(self) -> dict[str, Any]:
        """Return the protocol's figures of a complete run."""
        time_s, ground = np.array(self._time_s), np.array(self._ground)
        sway = np.array(self._sway)
        stimulus = self._stimulus
        moves = int(np.searchsorted(time_s, START_S))
        rms = float(np.sqrt(np.mean((sway[moves:] - sway[moves - 1]) ** 2)))
        if stimulus.protocol == "prts":
            spectra = [
                cycle_spectra(
                    time_s,
                    values,
                    start_s=START_S,
                    cycle_s=stimulus.cycle_s,
                    cycles=stimulus.cycles,
                )
                for values in (ground, sway)
            ]
            told = [[row.real.tolist(), row.imag.tolist()] for row in spectra]
            return {"sway_rms_deg": rms, "stimulus": told[0], "response": told[1]}
        if stimulus.protocol == "sinus":
            found = sine_response(
                time_s,
                ground,
                sway,
                start_s=START_S + 2.0 / stimulus.frequency_hz,
                frequency_hz=stimulus.frequency_hz,
                periods=PERIODS,
            )
            return {"sway_rms_deg": rms, **vars(found)}
        answer = ground - sway if stimulus.axis in TILTS else ground + sway
        figures = step_figures(time_s, ground, sway, answer, start_s=START_S)
        kept = slice(None, None, round(CURVE_S / LOOK_S))
        curve = {
            "time_s": np.round(time_s[kept] - START_S, 3).tolist(),
            "ground_deg": np.round(ground[kept], 4).tolist(),
            "sway_deg": np.round(sway[kept], 4).tolist(),
        }
        return {"sway_rms_deg": rms, **vars(figures), "curve": curve}


def _lean(truth: PlantTruth, axis: SwayAxis) -> float:
    """Lean of the centre of mass over the middle of the soles, in the world [rad].

    It has the sign of a tilt: positive ahead about pitch, to the right about roll. For
    a translation it is positive along the axis.
    """
    over = truth.com - 0.5 * (truth.sole_left + truth.sole_right)
    if axis in ("pitch", "x"):
        return math.atan2(over[0], over[2])
    lean = math.atan2(over[1], over[2])
    return -lean if axis == "roll" else lean


def _tilt(quat_xyzw: Array, axis: SwayAxis) -> float:
    """Angle of a platform that turns about a single axis [rad]."""
    x, y, _, w = quat_xyzw.tolist()
    return 2.0 * math.atan2(y if axis == "pitch" else x, w)
