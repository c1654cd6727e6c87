from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import welch

from benchmarks.ground_files import passenger_pulse, strong_motion, write_all
from surefoot.sim_robot.catalogue import SCENARIOS_DIR


def test_shipped_files_are_what_the_code_makes(tmp_path: Path) -> None:
    write_all(tmp_path)
    for made in tmp_path.iterdir():
        shipped = np.genfromtxt(SCENARIOS_DIR / made.name, delimiter=",", names=True)
        again = np.genfromtxt(made, delimiter=",", names=True)
        assert shipped.dtype.names == again.dtype.names
        for name in again.dtype.names:  # another processor may round the last digit
            np.testing.assert_allclose(shipped[name], again[name], atol=2e-5)


@pytest.mark.parametrize(("peak", "jerk"), [(1.5, 5.6), (3.0, 11.3), (-1.0, 5.6)])
def test_a_pulse_has_its_peak_and_jerk_and_ends_at_rest(
    peak: float, jerk: float
) -> None:
    times, velocity = passenger_pulse(peak, jerk_m_s3=jerk)
    acceleration = np.gradient(velocity, times)
    first = times < 2.0
    extreme = acceleration[first][np.argmax(np.abs(acceleration[first]))]
    assert extreme == pytest.approx(peak, rel=1e-2)
    steepest = np.abs(np.gradient(acceleration, times))[first].max()
    assert steepest == pytest.approx(jerk, rel=0.05)
    assert velocity[0] == velocity[-1] == 0.0
    assert np.abs(acceleration[times > 2.0]).max() < 0.55


def test_strong_motion_has_its_peak_and_the_soil_s_frequency() -> None:
    times, acceleration = strong_motion(peak_m_s2=3.0, ground_hz=2.5, seed=1)
    assert np.abs(acceleration).max() == pytest.approx(3.0)
    frequency, power = welch(acceleration, fs=1.0 / (times[1] - times[0]), nperseg=512)
    middle = (frequency * power).sum() / power.sum()
    assert 2.0 < middle < 8.0
    assert power[np.searchsorted(frequency, 20.0)] < 0.05 * power.max()
    assert not np.array_equal(acceleration, strong_motion(peak_m_s2=3.0, seed=2)[1])
