"""Sway in response to ground motion: frequency responses and step responses.

Spectra are computed cycle by cycle. Cross and auto spectra are averaged over cycles and
over groups of odd harmonics, as in arXiv 2104.11935 and 2110.14395.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from surefoot.schemas.arrays import Array

Complex = NDArray[np.complex128]

HARMONICS = tuple(range(1, 50, 2))
"""Odd harmonics: a ternary sequence has no energy at the others."""
GROUPS = (
    *((1,), (3,), (5, 7), (7, 9), (9, 11, 13), (11, 13, 15, 17)),
    *((15, 17, 19, 21), (19, 21, 23, 25), (23, 25, 27, 29, 31)),
    *((31, 33, 35, 37, 39), (39, 41, 43, 45, 47, 49)),
)
"""Harmonics averaged for each of the eleven frequencies; the groups overlap."""
SAMPLES_PER_CYCLE = 2000
CONFIDENCE = 0.95
_LEAST_POWER = 1e-300
SETTLED = 0.02
"""Share of the step within which a curve counts as settled."""
RISEN, HALF = 0.9, 0.5
FINAL_S = 1.0
"""The final value is the mean over this time at the end [s]."""


@dataclass(frozen=True)
class FrequencyResponse:
    """Response at each frequency, averaged over cycles.

    Attributes:
        frequencies_hz: (n,) [Hz].
        response: (n,) complex, output over input.
        coherence: (n,) share of the output's power that follows the input, 0 to 1.
        gain_band: (n,) half the width of the 95 % band of the gain; NaN if there are
            too few cycles.
    """

    frequencies_hz: Array
    response: Complex
    coherence: Array
    gain_band: Array

    @property
    def gain(self) -> Array:
        """(n,) magnitude."""
        magnitude: Array = np.abs(self.response)
        return magnitude

    @property
    def phase_deg(self) -> Array:
        """(n,) phase without jumps, from -180 to 180 at the lowest frequency [deg]."""
        phase: Array = np.degrees(np.unwrap(np.angle(self.response)))
        return phase

    @property
    def phase_band_deg(self) -> Array:
        """(n,) half the width of the 95 % band of the phase, at most 180 [deg]."""
        share = self.gain_band / np.maximum(self.gain, _LEAST_POWER)
        band = np.degrees(np.arcsin(np.minimum(share, 1.0)))
        limited: Array = np.where(share > 1.0, 180.0, band)
        return limited

    def as_dict(self) -> dict[str, Any]:
        """Return everything as built-in types; None for NaN."""
        columns = {
            "frequency_hz": self.frequencies_hz,
            "gain": self.gain,
            "gain_band": self.gain_band,
            "phase_deg": self.phase_deg,
            "phase_band_deg": self.phase_band_deg,
            "coherence": self.coherence,
        }
        return {name: numbers(values) for name, values in columns.items()}


def numbers(values: Array) -> list[float | None]:
    """Return an array as numbers for a file; None for a value that is not finite."""
    return [float(v) if np.isfinite(v) else None for v in values]


def cycle_spectra(
    time_s: Array, values: Array, *, start_s: float, cycle_s: float, cycles: int
) -> Complex:
    """Return the Fourier coefficients of each cycle except the first.

    Args:
        time_s: (n,) times of the values, rising [s].
        values: (n,) measured values.
        start_s: beginning of the first cycle [s].
        cycle_s: duration of a cycle [s].
        cycles: number of cycles, two or more.

    Returns:
        (cycles - 1, 25) complex amplitude at each of :data:`HARMONICS`.
    """
    phase = np.arange(SAMPLES_PER_CYCLE) / SAMPLES_PER_CYCLE
    turns = np.exp(-2j * np.pi * np.outer(phase, HARMONICS))
    rows = [
        np.interp(start_s + cycle_s * (cycle + phase), time_s, values)
        for cycle in range(1, cycles)
    ]
    spectra: Complex = np.array(rows) @ turns * (2.0 / SAMPLES_PER_CYCLE)
    return spectra


def frequency_response(
    stimulus: Complex, response: Complex, *, cycle_s: float
) -> FrequencyResponse:
    """Average the spectra of some cycles into the eleven frequencies.

    Args:
        stimulus: (m, 25) spectra of the input, see :func:`cycle_spectra`.
        response: (m, 25) spectra of the output.
        cycle_s: duration of a cycle [s].
    """
    from scipy.stats import f as f_distribution

    cross = np.mean(np.conj(stimulus) * response, axis=0)
    power_in = np.mean(np.abs(stimulus) ** 2, axis=0)
    power_out = np.mean(np.abs(response) ** 2, axis=0)
    at = [[HARMONICS.index(k) for k in group] for group in GROUPS]
    gxy = np.array([np.mean(cross[i]) for i in at])
    gx = np.array([np.mean(power_in[i]) for i in at])
    gy = np.array([np.mean(power_out[i]) for i in at])
    coherence = np.abs(gxy) ** 2 / np.maximum(gx * gy, _LEAST_POWER)
    coherence = np.minimum(coherence, 1.0)
    freedom = 2.0 * len(stimulus) * np.array([len(group) for group in GROUPS]) - 2.0
    told = freedom > 0.0
    safe = np.where(told, freedom, 1.0)
    quantile = f_distribution.ppf(CONFIDENCE, 2, safe)
    band = np.sqrt(2.0 * (1.0 - coherence) * quantile / safe * gy / gx)
    return FrequencyResponse(
        frequencies_hz=np.array([np.mean(group) for group in GROUPS]) / cycle_s,
        response=gxy / gx,
        coherence=coherence,
        gain_band=np.where(told, band, np.nan),
    )


@dataclass(frozen=True)
class SineResponse:
    """Response to a sine at its own frequency.

    Attributes:
        gain: magnitude of the output over that of the input.
        phase_deg: of the output against the input, -180 to 180 [deg].
        power_ratio: share of the output's power, without its mean, at the frequency of
            the sine: 1 for a linear response without noise.
    """

    gain: float
    phase_deg: float
    power_ratio: float


def phasor(values: Array, *, period_s: float, frequency_hz: float) -> complex:
    """Return the complex amplitude of a sine in values.

    A steady drift is subtracted, from the mean of the first period to that of the last:
    a robot at its limit drifts, and a line also contributes at the sine's frequency.

    Args:
        values: (n,) evenly spaced, over whole periods of the sine.
        period_s: from one value to the next [s].
        frequency_hz: of the sine [Hz].
    """
    one = min(round(1.0 / (frequency_hz * period_s)), len(values))
    rise = float(values[-one:].mean() - values[:one].mean())
    at = np.arange(len(values))
    still = values - rise / max(len(values) - one, 1) * at
    turn = 2.0 * np.pi * frequency_hz * period_s * at
    parts = np.column_stack([np.cos(turn), -np.sin(turn), np.ones(len(at))])
    (real, imaginary, _), *_ = np.linalg.lstsq(parts, still, rcond=None)
    return complex(real, imaginary)


def sine_response(
    time_s: Array,
    stimulus: Array,
    response: Array,
    *,
    start_s: float,
    frequency_hz: float,
    periods: int,
) -> SineResponse:
    """Compare input and output over whole periods of a sine.

    Args:
        time_s: (n,) times of the values, rising [s].
        stimulus: (n,) the input.
        response: (n,) the output.
        start_s: beginning of the periods that count [s].
        frequency_hz: of the sine [Hz].
        periods: number of periods that count.
    """
    period_s = periods / (frequency_hz * SAMPLES_PER_CYCLE)
    at_s = start_s + period_s * np.arange(SAMPLES_PER_CYCLE)
    x, y = (np.interp(at_s, time_s, values) for values in (stimulus, response))
    x_line, y_line = (
        phasor(values, period_s=period_s, frequency_hz=frequency_hz)
        for values in (x, y)
    )
    ratio = y_line / x_line
    power = max(float(np.var(y)), _LEAST_POWER)
    return SineResponse(
        gain=float(np.abs(ratio)),
        phase_deg=float(np.degrees(np.angle(ratio))),
        power_ratio=min(float(0.5 * np.abs(y_line) ** 2 / power), 1.0),
    )


@dataclass(frozen=True)
class StepFigures:
    """Figures of a step of the ground; times count from its beginning.

    Two curves are measured, as shares of the ground's step. The sway is the lean of the
    centre of mass in the world. It should return to its former value; its peak, the
    time of the peak and the settling time are measured. The answer is the motion of the
    body relative to the ground. It is a step itself, with delay, rise and overshoot.

    Attributes:
        sway_peak: largest sway, signed [deg/deg].
        sway_peak_s: time of the largest sway [s].
        sway_final: remaining sway [deg/deg].
        settling_s: time from which the sway stays within 2 % of the step around its
            final value; None if it did not settle before its last second [s].
        delay_s: time until half of the answer; None without an answer [s].
        rise_s: time until 90 % of the answer; None without an answer [s].
        overshoot: of the answer, over its final value; None without an answer.
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
    """Measure a step, relative to the values at which the ground begins to move.

    Before that the robot may still be coming to rest from its start.

    Args:
        time_s: (n,) rising [s].
        stimulus: (n,) motion of the ground, in the unit of the sway.
        sway: (n,) lean of the centre of mass in the world.
        answer: (n,) motion of the body relative to the ground; it ends at the size of
            the step if the robot stands as before.
        start_s: time at which the ground begins to move [s].
    """
    after = int(np.searchsorted(time_s, start_s))
    since = time_s[after:] - start_s
    size = _final(time_s, stimulus) - stimulus[after - 1]
    sway_end = (_final(time_s, sway) - sway[after - 1]) / size
    course = (sway[after:] - sway[after - 1]) / size
    peak = int(np.argmax(np.abs(course)))
    away = np.abs(course - sway_end) > SETTLED
    last = len(away) - int(np.argmax(away[::-1])) if away.any() else 0
    settled = last < len(since) and since[last] <= since[-1] - FINAL_S
    went = (answer[after:] - answer[after - 1]) / size
    end = float((_final(time_s, answer) - answer[after - 1]) / size)
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
    """First time at which the values reach a level."""
    return float(since[int(np.argmax(values * np.sign(level) >= abs(level)))])


DATA = Path(__file__).parent / "human_sway.json"


@dataclass(frozen=True)
class HumanSway:
    """Statistics of people's sway; the data file names their sources.

    Attributes:
        frequencies_hz: (11,) of the response at the platform's ordinary speed [Hz].
        gain_percentiles: by percentile: (11,) lean over tilt [deg/deg].
        mean: (22,) mean response: real parts, then imaginary parts.
        weight: (22, 22) symmetric weight of the squared distance from the mean.
        score_percentiles: score of the people themselves, by percentile.
        sources: sources of the data.
    """

    frequencies_hz: Array
    gain_percentiles: dict[int, Array]
    mean: Array
    weight: Array
    score_percentiles: dict[int, float]
    sources: tuple[str, ...]

    @property
    def phase_deg(self) -> Array:
        """(11,) phase of the mean response, without jumps [deg]."""
        mean = self.mean[:11] + 1j * self.mean[11:]
        phase: Array = np.degrees(np.unwrap(np.angle(mean)))
        return phase

    def score(self, response: Complex) -> float:
        """Return D, the distance of a response from that of people.

        Implements the score of arXiv 2110.14395: D^2 = d' W inv(C) W d, where d is the
        difference from the mean. Half of all people are below 1.6.

        Args:
            response: (11,) complex, lean over tilt at the eleven frequencies.
        """
        d = np.concatenate([response.real, response.imag]) - self.mean
        return float(np.sqrt(d @ self.weight @ d))


@cache
def human_sway() -> HumanSway:
    """Return the statistics shipped with this package."""
    table: dict[str, Any] = msgspec.json.decode(DATA.read_bytes())
    weights = np.tile(np.array(table["score_weights"]), 2)
    return HumanSway(
        frequencies_hz=np.array(table["frequencies_hz"]),
        gain_percentiles={
            int(p): np.array(gains) for p, gains in table["gain_percentiles"].items()
        },
        mean=np.array(table["mean_real"] + table["mean_imag"]),
        weight=weights[:, None] * np.linalg.inv(table["covariance"]) * weights,
        score_percentiles={int(p): v for p, v in table["score_percentiles"].items()},
        sources=tuple(table["sources"]),
    )
