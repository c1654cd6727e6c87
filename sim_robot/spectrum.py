"""Irregular waves: the JONSWAP spectrum as a sum of sines."""

from __future__ import annotations

import math

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.motions import SpectrumMotion
from surefoot.sim_robot.motion_law import MotionLaw, check_frequency, fade

COMPONENTS = 256
LOWEST, HIGHEST = 0.5, 4.0
"""Band of the components, in peak frequencies; 99.5 % of the variance lie in it."""


def jonswap(frequency_hz: Array, *, peak_hz: float, gamma: float) -> Array:
    """Return the shape of the JONSWAP spectrum, (n,), to be scaled.

    Hasselmann et al. (1973): f^-5 exp(-5/4 (f/fp)^-4) gamma^r, with
    r = exp(-(f - fp)^2 / (2 sigma^2 fp^2)), sigma = 0.07 below the peak and 0.09 above.

    Args:
        frequency_hz: (n,) above zero.
        peak_hz: frequency of the peak.
        gamma: how peaked it is.
    """
    relative = frequency_hz / peak_hz
    sigma = np.where(relative <= 1.0, 0.07, 0.09)
    peak = np.exp(-((relative - 1.0) ** 2) / (2.0 * sigma**2))
    shape: Array = relative**-5 * np.exp(-1.25 * relative**-4) * gamma**peak
    return shape


def components(motion: SpectrumMotion) -> tuple[Array, Array, Array]:
    """Return frequencies [Hz], amplitudes of the waves [m] and phases [rad], (256,).

    One component at a random place in each of equally wide bands, so that the sum does
    not repeat itself. Amplitudes follow the spectrum and add up to the wanted variance,
    height^2 / 16, exactly.
    """
    peak_hz = 1.0 / motion.period_s
    random = np.random.default_rng(np.random.SeedSequence(motion.seed))
    width = (HIGHEST - LOWEST) / COMPONENTS
    places = np.arange(COMPONENTS) + random.random(COMPONENTS)
    frequency_hz = peak_hz * (LOWEST + width * places)
    variance = jonswap(frequency_hz, peak_hz=peak_hz, gamma=motion.gamma)
    variance *= motion.height_m**2 / 16.0 / variance.sum()
    return frequency_hz, np.sqrt(2.0 * variance), math.tau * random.random(COMPONENTS)


def spectrum_law(motion: SpectrumMotion) -> MotionLaw:
    """Make the sum of the components times the gain, faded in, C2 smooth.

    Raises:
        ScenarioError: faster than half the simulation's rate.
    """
    check_frequency(
        HIGHEST / motion.period_s,
        "period_s",
        what=f"{motion.period_s:g} s, so waves of up to "
        f"{HIGHEST / motion.period_s:g} Hz",
    )
    frequency_hz, height, phase = components(motion)
    omega = math.tau * frequency_hz
    amplitude = motion.gain_si * height
    amplitude_rate = -amplitude * omega
    phase = phase + math.radians(motion.phase_deg)
    start_s = motion.start_s
    per_fade = 1.0 / (motion.period_s if motion.blend_s is None else motion.blend_s)

    def law(time_s: float) -> tuple[float, float]:
        since = time_s - start_s
        if since <= 0.0:
            return 0.0, 0.0
        angle = omega * since
        angle += phase
        position = float(amplitude @ np.cos(angle))
        velocity = float(amplitude_rate @ np.sin(angle))
        u = since * per_fade
        if u >= 1.0:
            return position, velocity
        share, rate = fade(u)
        return share * position, share * velocity + rate * per_fade * position

    return law
