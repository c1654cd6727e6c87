"""Frequency responses of systems with a known answer."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.bench.sway_response import (
    GROUPS,
    HARMONICS,
    cycle_spectra,
    frequency_response,
    sine_response,
)
from surefoot.schemas.arrays import Array

CYCLE_S, START_S, CYCLES = 4.0, 1.0, 3
STEP_S = 0.002
EXACT = 1e-6
SAMPLED = 2e-3
"""Tolerance, since values between samples are interpolated."""


def sum_of(amplitudes: dict[int, complex], time_s: Array) -> Array:
    turns = 2.0j * np.pi * (time_s - START_S) / CYCLE_S
    total = sum(a * np.exp(k * turns) for k, a in amplitudes.items())
    return np.real(total)


def spectra(values: Array, time_s: Array) -> Array:
    return cycle_spectra(
        time_s, values, start_s=START_S, cycle_s=CYCLE_S, cycles=CYCLES
    )


def times() -> Array:
    return np.arange(0.0, START_S + CYCLES * CYCLE_S + STEP_S, STEP_S)


def stimulus() -> dict[int, complex]:
    rng = np.random.default_rng(0)
    return {k: np.exp(2j * np.pi * rng.random()) / k for k in HARMONICS}


def low_pass(frequency_hz: float) -> complex:
    return 2.0 / (1.0 + 1j * frequency_hz / 0.5)


def test_spectra_are_the_amplitudes_of_the_harmonics() -> None:
    given = stimulus()
    found = spectra(sum_of(given, times()), times())
    assert found.shape == (CYCLES - 1, len(HARMONICS))
    assert np.abs(found - list(given.values())).max() < SAMPLED


def test_a_gain_and_a_phase_are_found_with_full_coherence_and_no_band() -> None:
    x = spectra(sum_of(stimulus(), times()), times())
    found = frequency_response(x, 0.4 * np.exp(-0.7j) * x, cycle_s=CYCLE_S)
    assert found.gain == pytest.approx(0.4, abs=EXACT)
    assert found.phase_deg == pytest.approx(np.degrees(-0.7), abs=EXACT)
    assert found.coherence == pytest.approx(1.0, abs=EXACT)
    assert found.gain_band == pytest.approx(0.0, abs=EXACT)


def test_a_filter_is_found_at_the_mean_of_each_group() -> None:
    given = stimulus()
    filtered = {k: low_pass(k / CYCLE_S) * a for k, a in given.items()}
    x, y = (spectra(sum_of(values, times()), times()) for values in (given, filtered))
    found = frequency_response(x, y, cycle_s=CYCLE_S)
    assert found.frequencies_hz == pytest.approx(
        [np.mean(group) / CYCLE_S for group in GROUPS]
    )
    expected = np.array([low_pass(f) for f in found.frequencies_hz])
    # Power falls with frequency, so that the low end of a group counts for more.
    assert np.abs(found.response / expected - 1.0).max() < 0.1


def test_a_response_at_even_harmonics_is_none_to_the_stimulus() -> None:
    x = spectra(sum_of(stimulus(), times()), times())
    y = spectra(sum_of({k + 1: 1.0 for k in HARMONICS}, times()), times())
    found = frequency_response(x, y, cycle_s=CYCLE_S)
    assert found.gain.max() < SAMPLED


def test_bands_hold_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(1)
    shape, truth = (4, len(HARMONICS)), 0.8 * np.exp(0.3j)
    inside = []
    for _ in range(200):
        x = np.ones(shape, dtype=np.complex128)
        noise = rng.normal(size=shape) + 1j * rng.normal(size=shape)
        found = frequency_response(x, truth * x + 0.3 * noise, cycle_s=CYCLE_S)
        inside.append(np.abs(found.response - truth) < found.gain_band)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)


def test_one_cycle_tells_no_band_where_one_harmonic_stands_alone() -> None:
    x = np.ones((1, len(HARMONICS)), dtype=np.complex128)
    found = frequency_response(x, x, cycle_s=CYCLE_S).as_dict()
    alone = [len(group) == 1 for group in GROUPS]
    assert [band is None for band in found["gain_band"]] == alone


def test_a_sines_gain_phase_and_share_of_power_are_found() -> None:
    time_s = times()
    angle = 2.0 * np.pi * 1.5 * time_s
    y = 0.3 * np.sin(angle - 0.5) + 0.1 * np.sin(3.0 * angle) + 7.0
    found = sine_response(
        time_s, np.sin(angle), y, start_s=2.0, frequency_hz=1.5, periods=4
    )
    assert found.gain == pytest.approx(0.3, abs=SAMPLED)
    assert found.phase_deg == pytest.approx(np.degrees(-0.5), abs=0.5)
    assert found.power_ratio == pytest.approx(0.9, abs=SAMPLED)
    drifts = sine_response(
        time_s,
        np.sin(angle),
        y + 3.0 * time_s,
        start_s=2.0,
        frequency_hz=1.5,
        periods=4,
    )
    assert (drifts.gain, drifts.phase_deg) == pytest.approx(
        (found.gain, found.phase_deg), rel=SAMPLED
    )
    assert drifts.power_ratio < 0.1
