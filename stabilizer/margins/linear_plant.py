"""The robot on its feet, linear: what the soles feel when the joints are commanded.

Small motions about the nominal stance: rigid bodies, servos, and soles on hard ground
that stands still. Servos and contacts are stepped as the simulator steps them, damping
implicitly, at 1 kHz: a servo's own loop runs about as fast.

    H a = S^T (kp (s - q_J) - (kd + b) v_J) - G dq + P^T f
    P a + R f = - 2 w P v - w^2 P dq (of the normals only)

dq is the deviation in the tangent space, s the set-points the servos act on, G the
change of gravity's generalised force with the mean wrenches kept, P the Jacobian of the
corners of both soles, f the forces there. The corners' springs have the stiffness
w^2 / R; along the sole they do not slip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Mat
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.model import N_BASE_V, RobotModel

STEP_S = 0.001
"""Longest step of servos and contacts [s]."""
SETTLING_RAD_S = 250.0
"""w, how fast a contact settles [rad/s]."""
FRICTION_RATIO = 10.0
"""How much stiffer contacts are along the sole."""
DIFFERENCE = 1e-5
"""Step of finite differences [m, rad]."""


@dataclass(frozen=True)
class LinearPlant:
    """x_next = A x + B u, F = C x, u held from tick to tick.

    Attributes:
        A: (n, n) of x = (dq, v, s, F), s the leg joints' set-points.
        B: (n, n_legs) of the positions commanded to the leg joints; the others stay.
        C: (12, n) wrenches of the ground on the soles during the last step, sole
            frames [N, N m].
        legs: which joints are commanded, model order.
        n_v: size of dq and of v.
    """

    A: Mat
    B: Mat
    C: Mat
    legs: NDArray[np.intp]
    n_v: int


def linear_plant(
    robot: Robot,
    model: RobotModel,
    dynamics: Dynamics,
    *,
    F_mean: Array,
    contact_stiffness: float,
    lag_s: float,
) -> LinearPlant:
    """Linearise the robot in its nominal stance.

    Args:
        robot: gives the servos.
        model: the same robot.
        dynamics: at the nominal stance, at rest.
        F_mean: (12,) wrenches the soles feel there.
        contact_stiffness: of one sole on its ground, along its normal [N/m].
        lag_s: of the set-points [s].
    """
    n_v, legs = model.n_v, np.flatnonzero(model.is_leg)
    m = len(legs)
    substeps = max(1, math.ceil(robot.period_s / STEP_S - 1e-9))
    dt = robot.period_s / substeps
    gain = -math.expm1(-dt / lag_s) if lag_s > 0.0 else 1.0
    q, v, s = slice(0, n_v), slice(n_v, 2 * n_v), slice(2 * n_v, 2 * n_v + m)
    F = slice(s.stop, s.stop + 12)
    a, wrench = _forces(
        robot, model, dynamics, F_mean=F_mean, stiffness=contact_stiffness, dt=dt
    )
    # First the set-points move, then the robot.
    follow, B_follow = np.eye(F.stop), np.zeros((F.stop, m))
    follow[s, s] = (1.0 - gain) * np.eye(m)
    B_follow[s] = gain * np.eye(m)
    move = np.eye(F.stop)
    move[v, : s.stop] += dt * a
    move[q] += dt * move[v]
    move[F, : s.stop], move[F, F] = wrench, 0.0
    A, B = np.eye(F.stop), np.zeros((F.stop, m))
    for _ in range(substeps):
        A, B = move @ follow @ A, move @ (follow @ B + B_follow)
    C = np.zeros((12, F.stop))
    C[:, F] = np.eye(12)
    return LinearPlant(A, B, C, legs, n_v)


def _forces(
    robot: Robot,
    model: RobotModel,
    dynamics: Dynamics,
    *,
    F_mean: Array,
    stiffness: float,
    dt: float,
) -> tuple[Mat, Mat]:
    """Accelerations and wrenches by (dq, v, s): (n_v, n) and (12, n)."""
    n_v, legs = model.n_v, np.flatnonzero(model.is_leg)
    m, n = len(legs), 2 * n_v + len(legs)
    H_inv, J = dynamics.H_inv.copy(), dynamics.J_contact.copy()
    H = dynamics.inertia_matrix()
    kp, kd = robot.kp[model.to_model], (robot.kd + robot.damping)[model.to_model]
    smooth = np.zeros((n_v, n))
    smooth[:, :n_v] = -_gravity(model, dynamics, F_mean)
    joints = np.arange(N_BASE_V, n_v)
    smooth[joints, joints] -= kp
    smooth[joints, n_v + joints] = -kd
    smooth[N_BASE_V + legs, 2 * n_v + np.arange(m)] = kp[legs]
    corners = _corners(model)
    P = corners @ J
    is_normal = np.arange(len(P)) % 3 == 2
    regular = SETTLING_RAD_S**2 / (0.25 * stiffness)
    R = np.where(is_normal, regular, regular / FRICTION_RATIO)
    wanted = np.zeros((len(P), n))
    wanted[is_normal, :n_v] = -(SETTLING_RAD_S**2) * P[is_normal]
    wanted[:, n_v : 2 * n_v] = -2.0 * SETTLING_RAD_S * P
    f = np.linalg.solve(P @ H_inv @ P.T + np.diag(R), wanted - P @ H_inv @ smooth)
    damped = H.copy()
    damped[joints, joints] += dt * kd
    acceleration = np.linalg.solve(damped, smooth + P.T @ f)
    return np.asarray(acceleration, dtype=np.float64), corners.T @ f


def _corners(model: RobotModel) -> Mat:
    """Velocities of the soles' corners by the sole twists, (24, 12)."""
    blocks = []
    for side, (length, width) in enumerate(model.half_sizes):
        for x in (length, -length):
            for y in (width, -width):
                block = np.zeros((3, 12))
                own = slice(6 * side, 6 * side + 6)
                block[:, own] = np.hstack((np.eye(3), -pin.skew(np.array([x, y, 0.0]))))
                blocks.append(block)
    return np.vstack(blocks)


def _gravity(model: RobotModel, dynamics: Dynamics, F_mean: Array) -> Mat:
    """Change of gravity's and the mean wrenches' generalised force, (n_v, n_v)."""
    n_v = model.n_v
    q, still = dynamics.q.copy(), np.zeros(n_v)
    change = np.empty((n_v, n_v))
    for i in range(n_v):
        forces = []
        for sign in (DIFFERENCE, -DIFFERENCE):
            step = still.copy()
            step[i] = sign
            dynamics.update(pin.integrate(model.pin_model, q, step), still)
            forces.append(dynamics.c - dynamics.J_contact.T @ F_mean)
        change[:, i] = (forces[0] - forces[1]) / (2.0 * DIFFERENCE)
    dynamics.update(q, still)
    return change
