"""Makes the files of recorded ground motion in shipped scenarios.

``python -m benchmarks.ground_files`` writes them into the package. They are the same
every time; a test compares them. Implements the sled pulses of Karekla, Tyler and
others as given by Krasna et al. (2021, 10.3389/fbioe.2021.680883), and the spectrum of
Kanai and Tajimi (1960) under the envelope of Saragoni and Hart (1974).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.integrate import cumulative_trapezoid

from surefoot.schemas.arrays import Array
from surefoot.sim_robot.catalogue import SCENARIOS_DIR

STEP_S = 0.01
"""From sample to sample [s]."""
HOLD_S, CRUISE_S = 1.0, 2.0
"""Duration of a pulse's plateau, and of constant speed after the pulse [s]."""
STOP_M_S2, STOP_JERK_M_S3 = 0.5, 0.5
"""Deceleration and jerk at the end of a ride [m/s^2, m/s^3]."""
SHAKEN_S = 24.0
GROUND_DAMPING = 0.6
"""Damping ratio of the layer of soil."""


def passenger_pulse(peak_m_s2: float, *, jerk_m_s3: float) -> tuple[Array, Array]:
    """Make the acceleration pulse of a bus that pulls away, then a gentle stop.

    Args:
        peak_m_s2: acceleration of the plateau; negative for a bus that brakes.
        jerk_m_s3: jerk before and after the plateau.

    Returns:
        Times [s] and velocities [m/s], each (n,); at rest at both ends.
    """
    rise = abs(peak_m_s2) / jerk_m_s3
    gained = abs(peak_m_s2) * (HOLD_S + rise)
    stop_rise = STOP_M_S2 / STOP_JERK_M_S3
    stop_hold = gained / STOP_M_S2 - stop_rise
    stop = STOP_M_S2
    if stop_hold < 0.0:  # too slow to reach the plateau
        stop, stop_hold = math.sqrt(gained * STOP_JERK_M_S3), 0.0
        stop_rise = stop / STOP_JERK_M_S3
    corners = np.cumsum(
        [0.0, rise, HOLD_S, rise, CRUISE_S, stop_rise, stop_hold, stop_rise]
    )
    levels = [0.0, abs(peak_m_s2), abs(peak_m_s2), 0.0, 0.0, -stop, -stop, 0.0]
    # Finer than the samples, so that the corners' velocities are exact enough.
    fine = np.linspace(0.0, corners[-1], round(corners[-1] / STEP_S) * 20 + 1)
    velocity = cumulative_trapezoid(np.interp(fine, corners, levels), fine, initial=0.0)
    times = STEP_S * np.arange(math.ceil(corners[-1] / STEP_S) + 1)
    speeds = np.interp(times, fine, velocity)
    speeds[-1] = 0.0
    return times, math.copysign(1.0, peak_m_s2) * speeds


def strong_motion(
    *, peak_m_s2: float, ground_hz: float = 2.5, seed: int
) -> tuple[Array, Array]:
    """Make an artificial accelerogram of a strong earthquake.

    White noise passes through a layer of soil, under an envelope that rises within a
    fifth of the time and decays.

    Returns:
        Times [s] and accelerations [m/s^2], each (n,).
    """
    random = np.random.default_rng(np.random.SeedSequence(seed))
    count = round(SHAKEN_S / STEP_S)
    times: Array = STEP_S * np.arange(count + 1, dtype=np.float64)
    # Saragoni-Hart: the peak is at a fifth of the time; the end is at a twentieth.
    peak_share, end_level = 0.2, 0.05
    b = (
        -peak_share
        * math.log(end_level)
        / (1.0 + peak_share * (math.log(peak_share) - 1.0))
    )
    share = times / SHAKEN_S
    envelope = (share / peak_share) ** b * np.exp(-b * (share / peak_share - 1.0))
    shaken = envelope * random.standard_normal(count + 1)
    frequency = np.fft.rfftfreq(count + 1, STEP_S)
    ratio = frequency / ground_hz
    soil = (1.0 + 2j * GROUND_DAMPING * ratio) / (
        1.0 - ratio**2 + 2j * GROUND_DAMPING * ratio
    )
    # Clough-Penzien: nothing below a fifth of a hertz, as in records.
    slow = (ratio_slow := frequency / 0.2) ** 2 / (
        1.0 - ratio_slow**2 + 1.2j * ratio_slow
    )
    acceleration = np.fft.irfft(np.fft.rfft(shaken) * soil * slow, count + 1)
    acceleration *= np.minimum(1.0, times / 0.5) * np.minimum(
        1.0, (times[-1] - times) / 2.0
    )
    return times, acceleration * (peak_m_s2 / np.abs(acceleration).max())


def write_ground(path: Path, times: Array, columns: Mapping[str, Array]) -> None:
    """Write a text file that the motion kind ``recorded`` reads.

    Args:
        path: of the file (.csv).
        times: (n,) [s].
        columns: (n,) by name; shorter ones are padded with their last value.
    """
    rows = [",".join(["time_s", *columns])]
    for index, time_s in enumerate(times):
        values = [column[min(index, len(column) - 1)] for column in columns.values()]
        rows.append(
            ",".join(
                [f"{time_s:.3f}", *(f"{round(value, 5) + 0.0:.5f}" for value in values)]
            )
        )
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


PULSES = {
    "start": passenger_pulse(1.5, jerk_m_s3=5.6),
    "start_hard": passenger_pulse(3.0, jerk_m_s3=11.3),
    "brake": passenger_pulse(-1.0, jerk_m_s3=5.6),
    "brake_hard": passenger_pulse(-2.5, jerk_m_s3=11.3),
}
SHAKES = {
    "ahead": strong_motion(peak_m_s2=3.0, seed=1),
    "sideways": strong_motion(peak_m_s2=2.5, seed=2),
    "up": strong_motion(peak_m_s2=1.5, ground_hz=5.0, seed=3),
}


def write_all(folder: Path) -> None:
    """Write all files into a folder."""
    longest = max((times for times, _ in PULSES.values()), key=len)
    write_ground(
        folder / "passenger-pulses.csv",
        longest,
        {name: velocity for name, (_, velocity) in PULSES.items()},
    )
    write_ground(
        folder / "strong-motion.csv",
        SHAKES["ahead"][0],
        {name: acceleration for name, (_, acceleration) in SHAKES.items()},
    )


if __name__ == "__main__":
    write_all(SCENARIOS_DIR)
