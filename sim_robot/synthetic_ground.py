"""Makes ground to play: pulses a standing passenger feels, and strong motion.

Implements the sled pulses of Karekla and Tyler and others as given by Krasna et al.
(2021, 10.3389/fbioe.2021.680883), and the spectrum of Kanai and Tajimi (1960) under the
envelope of Saragoni and Hart (1974). Sea states need no file: see the motion kind
``spectrum``; nor does the ternary sequence: ``prts``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from surefoot.schemas.arrays import Array

STOP_M_S2, STOP_JERK_M_S3 = 0.5, 0.5
"""How gently a ride ends."""


def passenger_pulse(
    peak_m_s2: float,
    *,
    jerk_m_s3: float,
    hold_s: float = 1.0,
    cruise_s: float = 2.0,
    step_s: float = 0.01,
) -> tuple[Array, Array]:
    """Make a pulse of acceleration, as a bus that pulls away; then a gentle stop.

    Args:
        peak_m_s2: of the plateau; negative for a bus that brakes.
        jerk_m_s3: how fast it is reached and left.
        hold_s: how long it lasts.
        cruise_s: at constant speed after it.
        step_s: between samples.

    Returns:
        Times [s] and velocities [m/s], each (n,); at rest at both ends.
    """
    from scipy.integrate import cumulative_trapezoid

    rise = abs(peak_m_s2) / jerk_m_s3
    gained = abs(peak_m_s2) * (hold_s + rise)
    stop_rise = STOP_M_S2 / STOP_JERK_M_S3
    stop_hold = gained / STOP_M_S2 - stop_rise
    stop = STOP_M_S2
    if stop_hold < 0.0:  # too slow to reach the plateau
        stop, stop_hold = math.sqrt(gained * STOP_JERK_M_S3), 0.0
        stop_rise = stop / STOP_JERK_M_S3
    corners = np.cumsum(
        [0.0, rise, hold_s, rise, cruise_s, stop_rise, stop_hold, stop_rise]
    )
    levels = [0.0, abs(peak_m_s2), abs(peak_m_s2), 0.0, 0.0, -stop, -stop, 0.0]
    # Finer than the samples, so that the corners' velocities are exact enough.
    fine = np.linspace(0.0, corners[-1], round(corners[-1] / step_s) * 20 + 1)
    velocity = cumulative_trapezoid(np.interp(fine, corners, levels), fine, initial=0.0)
    times = step_s * np.arange(math.ceil(corners[-1] / step_s) + 1)
    speeds = np.interp(times, fine, velocity)
    speeds[-1] = 0.0
    return times, math.copysign(1.0, peak_m_s2) * speeds


def strong_motion(
    *,
    peak_m_s2: float,
    duration_s: float = 24.0,
    ground_hz: float = 2.5,
    ground_damping: float = 0.6,
    seed: int = 0,
    step_s: float = 0.01,
) -> tuple[Array, Array]:
    """Make an accelerogram of a strong earthquake that never happened.

    White noise through a layer of soil, under an envelope that rises within a fifth of
    the time and dies away.

    Args:
        peak_m_s2: largest acceleration.
        duration_s: of the shaking.
        ground_hz: of the layer; lower is softer.
        ground_damping: of the layer.
        seed: of the noise.
        step_s: between samples.

    Returns:
        Times [s] and accelerations [m/s^2], each (n,).
    """
    random = np.random.default_rng(np.random.SeedSequence(seed))
    count = round(duration_s / step_s)
    times: Array = step_s * np.arange(count + 1, dtype=np.float64)
    # Saragoni-Hart: at its peak after a fifth of the time, at a twentieth at the end.
    peak_share, end_level = 0.2, 0.05
    b = (
        -peak_share
        * math.log(end_level)
        / (1.0 + peak_share * (math.log(peak_share) - 1.0))
    )
    share = times / duration_s
    envelope = (share / peak_share) ** b * np.exp(-b * (share / peak_share - 1.0))
    shaken = envelope * random.standard_normal(count + 1)
    frequency = np.fft.rfftfreq(count + 1, step_s)
    ratio = frequency / ground_hz
    soil = (1.0 + 2j * ground_damping * ratio) / (
        1.0 - ratio**2 + 2j * ground_damping * ratio
    )
    # Clough-Penzien: nothing below a fifth of a hertz, where records have none either.
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
        columns: (n,) by name; shorter ones are continued by their last value.
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
