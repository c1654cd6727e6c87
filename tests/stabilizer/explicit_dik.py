"""The second QP as the paper writes it, with Delta among the unknowns.

Written from the paper and the descriptions of the settings, not from our code.
"""

from __future__ import annotations

import numpy as np

from surefoot.schemas.arrays import Array, Mat
from surefoot.stabilizer.model import N_BASE_V
from tests.stabilizer.rig import Rig
from tests.stabilizer.uncondensed_tsid import minimiser


def solve_explicit(rig: Rig, r: Array, *, q_command: Array) -> Array:
    """Solve the QP at the rig's present state; return (n_v,) the velocity.

    The unknowns are v and Delta, with J_c v = r + Delta as an equality.
    """
    n_v, settings = rig.model.n_v, rig.settings.dik
    P, c = np.zeros((n_v + 12,) * 2), np.zeros(n_v + 12)
    for J, wanted, weight in _tasks(rig, q_command):
        W = np.diag(np.broadcast_to(weight, len(wanted)))
        P[:n_v, :n_v] += J.T @ W @ J
        c[:n_v] -= J.T @ W @ wanted
    P[n_v:, n_v:] = np.diag(settings.contact_weight * 2)
    lower, upper = velocity_range(rig, q_command)
    free = np.full(N_BASE_V, np.inf)
    no_limit = np.full(12, np.inf)
    x = minimiser(
        P=P,
        c=c,
        A=np.hstack((rig.dynamics.J_contact, -np.eye(12))),
        b=r,
        x_l=np.concatenate((-free, lower, -no_limit)),
        x_u=np.concatenate((free, upper, no_limit)),
    )
    return x[:n_v]


def velocity_range(rig: Rig, q_command: Array) -> tuple[Array, Array]:
    """Return (n_a,) the slowest and the fastest allowed joint velocity [rad/s].

    Both stay within the drive's limit. A joint may not be so fast that it would reach
    the end of its range, less a margin, within the damper's time.
    """
    settings, model = rig.settings.dik, rig.model
    fastest = np.minimum(model.velocity_limit, settings.velocity_limit_rad_s)
    margin, time = settings.limit_margin_rad, settings.limit_time_s
    lower = np.clip((model.lower + margin - q_command) / time, -fastest, fastest)
    upper = np.clip((model.upper - margin - q_command) / time, -fastest, fastest)
    return lower, upper


def _tasks(rig: Rig, q_command: Array) -> list[tuple[Mat, Array, Array | float]]:
    """Return Jacobian, wanted velocity and weight of each task but the wrench law."""
    settings, dynamics, stance = rig.settings.dik, rig.dynamics, rig.stance
    of_v = np.eye(rig.model.n_v)
    com_error = stance.com - dynamics.p_com
    posture_weight = np.where(
        rig.model.is_leg, settings.leg_posture_weight, settings.posture_weight
    )
    extra = []
    for task in rig.extra_tasks:
        y = np.zeros(task.size)
        task.velocity(dynamics, stance, q_command, y)
        extra.append((task.jacobian(dynamics), y, task.velocity_weights))
    return [
        *extra,
        (
            dynamics.J_com,
            stance.com_velocity + np.array(settings.com_gain) * com_error,
            np.array(settings.com_weight),
        ),
        (of_v[3:6], settings.base_gain * stance.base_error, settings.base_weight),
        (
            of_v[N_BASE_V:],
            settings.posture_gain * (stance.posture - q_command),
            posture_weight,
        ),
        (of_v, np.zeros(len(of_v)), settings.regularisation),
    ]
