"""The first QP as the paper writes it, in (qdd, tau, F) with equalities.

Written from the paper and the descriptions of the settings, not from our code.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import piqp
from scipy.linalg import block_diag

from surefoot.schemas.arrays import Array, Mat
from surefoot.stabilizer.control.tsid import cone_rows
from surefoot.stabilizer.model import N_BASE_V
from tests.stabilizer.rig import Rig

TOLERANCE = 1e-11
MAX_ITERATIONS = 200
LARGEST, LEAST = 10, 11
"""Cone rows of the largest and the smallest normal force."""


@dataclass(frozen=True)
class Accelerations:
    """Solution: (n_v,) [m/s^2, rad/s^2], (n_a,) [N m], (6 n_c,) [N, N m]."""

    qdd: Array
    tau: Array
    F: Array


class _Cost:
    """Sum of weighted squares ``w |E x - e|^2``."""

    def __init__(self, n: int) -> None:
        self.P = np.zeros((n, n))
        self.c = np.zeros(n)

    def add(self, E: Mat, e: Array, *, weight: Array | float) -> None:
        W = np.diag(np.broadcast_to(weight, len(e)))
        self.P += E.T @ W @ E
        self.c -= E.T @ W @ e


def minimiser(**problem: Array) -> Array:
    """Solve a QP in PIQP's own terms, tightly."""
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = TOLERANCE
    solver.settings.eps_rel = 0.0
    solver.settings.eps_duality_gap_abs = TOLERANCE
    solver.settings.eps_duality_gap_rel = 0.0
    solver.settings.max_iter = MAX_ITERATIONS
    solver.setup(**problem)
    status = solver.solve()
    assert status == piqp.Status.PIQP_SOLVED, status
    x: Array = solver.result.x
    return x


def solve_uncondensed(rig: Rig, in_contact: list[bool]) -> Accelerations:
    """Solve the QP at the rig's present state, with the rig's settings."""
    feet = [side for side in (0, 1) if in_contact[side]]
    rows = [6 * side + row for side in feet for row in range(6)]
    n_v, n_a, n_c = rig.model.n_v, rig.model.n_a, len(rows)
    dynamics = rig.dynamics
    J_contact = dynamics.J_contact[rows]
    S = np.eye(n_v)[N_BASE_V:]
    A = np.block(
        [
            [dynamics.inertia_matrix(), -S.T, -J_contact.T],
            [J_contact, np.zeros((n_c, n_a + n_c))],
        ]
    )
    b = -np.concatenate((dynamics.c, dynamics.Jdot_v_contact[rows]))
    G, h_u = _cones(rig, feet)
    limit = np.concatenate(
        (np.full(n_v, np.inf), rig.model.torque_limit, np.full(n_c, np.inf))
    )
    cost = _cost(rig, feet)
    x = minimiser(P=cost.P, c=cost.c, A=A, b=b, G=G, h_u=h_u, x_l=-limit, x_u=limit)
    qdd, tau, F = np.split(x, [n_v, n_v + n_a])
    return Accelerations(qdd=qdd, tau=tau, F=F)


def _cost(rig: Rig, feet: list[int]) -> _Cost:
    settings, dynamics, stance = rig.settings.tsid, rig.dynamics, rig.stance
    n_v, n_a = rig.model.n_v, rig.model.n_a
    n = n_v + n_a + 6 * len(feet)
    of_qdd, of_tau, of_F = np.split(np.eye(n), [n_v, n_v + n_a])
    cost = _Cost(n)
    com_wanted = (
        stance.com_acceleration
        + np.array(settings.com_kp) * (stance.com - dynamics.p_com)
        + np.array(settings.com_kd) * (stance.com_velocity - dynamics.v_com)
    )
    cost.add(
        dynamics.J_com @ of_qdd,
        com_wanted - dynamics.Jdot_v_com,
        weight=settings.com_weight,
    )
    base_wanted = (
        settings.base_kp * stance.base_error - settings.base_kd * dynamics.v[3:6]
    )
    cost.add(of_qdd[3:6], base_wanted, weight=settings.base_weight)
    posture_wanted = (
        settings.posture_kp * (stance.posture - dynamics.q[7:])
        - settings.posture_kd * dynamics.v[6:]
    )
    follows_ground = np.zeros(n_a, dtype=bool)
    for side in feet:
        follows_ground |= rig.model.leg_joints[side]
    posture_weight = np.where(
        follows_ground, settings.leg_posture_weight, settings.posture_weight
    )
    cost.add(of_qdd[N_BASE_V:], posture_wanted, weight=posture_weight)
    cost.add(of_tau, np.zeros(n_a), weight=settings.torque_weight)
    for task in rig.extra_tasks:
        y = np.zeros(task.size)
        task.acceleration(dynamics, stance, y)
        y -= task.drift(dynamics)
        cost.add(task.jacobian(dynamics) @ of_qdd, y, weight=task.acceleration_weights)
    up = [R[2] for R in dynamics.R_world_sole]
    even = [
        np.concatenate((rig.weight / len(feet) * up[side], np.zeros(3)))
        for side in feet
    ]
    wrench_weight = [settings.force_weight] * 3 + [settings.moment_weight] * 3
    cost.add(of_F, np.concatenate(even), weight=np.array(wrench_weight * len(feet)))
    return cost


def _cones(rig: Rig, feet: list[int]) -> tuple[Mat, Array]:
    settings, model = rig.settings.tsid, rig.model
    cones = []
    for side in feet:
        foot = model.robot.file.foot[side]
        cones.append(cone_rows(settings, foot.half_length_m, foot.half_width_m))
    C = block_diag(*cones)
    d = np.zeros(len(C))
    d[LARGEST :: len(cones[0])] = rig.largest_force
    d[LEAST :: len(cones[0])] = -settings.normal_force_min_n
    G = np.hstack((np.zeros((len(C), model.n_v + model.n_a)), C))
    return G, d
