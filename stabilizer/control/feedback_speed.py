"""How fast the feet may yield: K follows delay, contact, servos and drives.

A wrench error e moves a sole by Lambda_c^-1 |K|^-1 e, and servos and contact, a spring
k_s between commanded and real sole, answer with a wrench. The loop is an integrator
whose fastest mode has the speed k, the largest eigenvalue of k_s Lambda_c^-1 |K|^-1.
Sampled every dt, with d ticks of delay, it sways from

    k dt = 2 sin(pi / (2 (2 d + 1)))

on. ``needed_stiffness`` is the factor on K that leaves 6 dB to that on every axis; see
docs/margins.md for what the whole loop makes of it.
"""

from __future__ import annotations

import math

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import DikSettings
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.model import N_BASE_V

MARGIN = 2.12
"""From the speed at which the fastest mode sways: 6 dB, and 0.5 dB for single axes."""


def fastest_mode(dynamics: Dynamics, *, kp: Array, contact_stiffness: float) -> float:
    """Compute the speed of the fastest mode with the default K.

    Args:
        dynamics: at the nominal stance.
        kp: (n_a,) stiffness of the servos, model order [N m/rad].
        contact_stiffness: of one sole on its ground, along its normal [N/m].

    Returns:
        k [1/s].
    """
    model = dynamics.model
    legs = np.flatnonzero(model.is_leg)
    J = dynamics.J_contact
    # What torques do to the wrenches at once, Gamma_c; then by sole instead of joint.
    by_torque = np.linalg.solve(
        dynamics.Lambda_c_inv, J @ (dynamics.H_inv[:, N_BASE_V:] * kp)
    )
    servos = by_torque[:, legs] @ np.linalg.pinv(J[:, N_BASE_V + legs])
    soft = np.concatenate(
        [_give(contact_stiffness, *half) for half in model.half_sizes]
    )
    both = np.linalg.inv(np.linalg.inv(servos) + np.diag(soft))
    K_inv = -1.0 / np.array(DikSettings().k_force * 2)
    return float(np.linalg.eigvals(both @ dynamics.Lambda_c_inv * K_inv).real.max())


def _give(normal: float, half_length: float, half_width: float) -> Array:
    """How far a sole gives way at its corners' springs, x y z roll pitch yaw, (6,)."""
    roll, pitch = normal * half_width**2, normal * half_length**2
    return 1.0 / np.array([normal, normal, normal, roll, pitch, roll + pitch])


def needed_stiffness(speed: float, *, delay_ticks: int, period_s: float) -> float:
    """Compute the factor on K that this loop needs, 1 or more.

    Args:
        speed: of the fastest mode with the default K [1/s].
        delay_ticks: from a reading to the step its answer acts in.
        period_s: from tick to tick [s].
    """
    sways = 2.0 * math.sin(math.pi / (2.0 * (2.0 * delay_ticks + 1.0)))
    return max(1.0, MARGIN * speed * period_s / sways)
