from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import welch

from surefoot.schemas.motions import SpectrumMotion
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.motion import components, jonswap, motion_law

SEA = SpectrumMotion(axis="z", height_m=4.0, period_s=9.0, gain=0.01, seed=3)
STEP_S = 0.25


def _hours(motion: SpectrumMotion, hours: float) -> np.ndarray:
    law = motion_law(motion)
    times = 100.0 + STEP_S * np.arange(round(3600.0 * hours / STEP_S))
    return np.array([law(float(t))[0] for t in times])


def test_significant_height_and_peak_period_are_those_asked_for() -> None:
    heave = _hours(SEA, 3.0)
    assert 4.0 * heave.std() == pytest.approx(0.01 * 4.0, rel=0.05)
    frequencies, power = welch(heave, fs=1.0 / STEP_S, nperseg=1024)
    assert 1.0 / frequencies[np.argmax(power)] == pytest.approx(9.0, rel=0.05)


def test_components_hold_the_variance_exactly() -> None:
    frequencies, amplitudes, _ = components(SEA)
    assert (0.5 * amplitudes**2).sum() == pytest.approx(4.0**2 / 16.0)
    assert frequencies[np.argmax(amplitudes)] == pytest.approx(1.0 / 9.0, rel=0.05)


def test_shape_is_peaked_by_gamma() -> None:
    at_peak = np.array([0.1])
    plain = jonswap(at_peak, peak_hz=0.1, gamma=1.0)
    assert jonswap(at_peak, peak_hz=0.1, gamma=3.3) == pytest.approx(3.3 * plain)
    far = np.array([0.3])
    assert jonswap(far, peak_hz=0.1, gamma=3.3) == pytest.approx(
        jonswap(far, peak_hz=0.1, gamma=1.0)
    )


def test_one_seed_is_one_sea_on_every_axis() -> None:
    pitch = SpectrumMotion(axis="pitch", height_m=4.0, period_s=9.0, gain=1.0, seed=3)
    other = SpectrumMotion(axis="z", height_m=4.0, period_s=9.0, gain=0.01, seed=4)
    for time_s in (20.0, 50.0, 333.0):
        heave, tilt = motion_law(SEA)(time_s)[0], motion_law(pitch)(time_s)[0]
        assert tilt / math.radians(1.0) == pytest.approx(heave / 0.01)
        assert motion_law(other)(time_s)[0] != pytest.approx(heave, rel=1e-3)


def test_waves_over_half_the_rate_are_refused() -> None:
    with pytest.raises(ScenarioError, match="half the simulation's rate") as caught:
        motion_law(SpectrumMotion(axis="z", height_m=1e-4, period_s=0.004))
    assert caught.value.field == "period_s"
