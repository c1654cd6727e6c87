"""Equivalent impedance of a robot that is pushed: inertia, damping and stiffness."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from surefoot.schemas.arrays import Array


class Impedance(NamedTuple):
    """What a mass, a damper and a spring would have that answer alike.

    Attributes:
        inertia_kg: [kg].
        damping_n_s_m: [N s/m].
        stiffness_n_m: [N/m].
    """

    inertia_kg: float
    damping_n_s_m: float
    stiffness_n_m: float


def phasor(values: Array, *, period_s: float, frequency_hz: float) -> complex:
    """Return the complex amplitude of a sine within values.

    Args:
        values: (n,) evenly spaced, over whole periods of the sine.
        period_s: from one value to the next [s].
        frequency_hz: of the sine [Hz].
    """
    turns = np.exp(-2j * np.pi * frequency_hz * period_s * np.arange(len(values)))
    return complex(2.0 * np.mean(values * turns))


def fit_impedance(
    frequencies_hz: Sequence[float], force_over_way: Sequence[complex]
) -> Impedance | None:
    """Fit force over way by least squares.

    A sine at one frequency cannot tell a spring from a mass: both answer in phase. So
    several are fitted at once: F/X = K - I w^2 + j w D. Each counts by its relative
    error, or the highest frequency would decide alone.

    Args:
        frequencies_hz: of the sines [Hz].
        force_over_way: complex amplitudes of the force over those of the way [N/m].

    Returns:
        None for fewer than two frequencies.
    """
    if len(set(frequencies_hz)) < 2:
        return None
    omega = 2.0 * np.pi * np.array(frequencies_hz)
    z = np.array(force_over_way)
    weight = 1.0 / np.abs(z)
    in_phase = np.column_stack([-(omega**2), np.ones_like(omega)]) * weight[:, None]
    (inertia, stiffness), *_ = np.linalg.lstsq(in_phase, z.real * weight, rcond=None)
    quarter = omega * weight
    damping = float(quarter @ (z.imag * weight) / (quarter @ quarter))
    return Impedance(float(inertia), damping, float(stiffness))
