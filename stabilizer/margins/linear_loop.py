"""The whole loop, linearised: both QPs, the wrench law and the robot on its feet.

It describes small motions about the nominal stance: rigid bodies, servos, and soles on
hard ground that stands still. Servos and contacts are stepped as in the simulator, with
implicit damping, at 1 kHz: a servo's own loop is about as fast.

    H a = S^T (kp (s - q_J) - (kd + b) v_J) - G dq + P^T f
    P a + R f = - 2 w P v - w^2 P dq (of the normals only)

dq is the deviation in the tangent space, s the set-points of the servos, G the change
of gravity's generalised force at constant mean wrenches, P the Jacobian of the corners
of both soles, f the forces there. The corner springs have the stiffness w^2 / R; along
the sole they do not slip.

The controller's own parts are asked for its answers to small deviations, so a changed
law or weight changes the margins too. The state estimate is assumed exact.

The loop is cut where the wrench errors e_F enter the law. A factor there acts like one
on 1 / |K|.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Mat
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.dynamics import SOLE_ROWS, Dynamics
from surefoot.stabilizer.model import N_BASE_V, RobotModel
from surefoot.stabilizer.whole_body.controller import WholeBodyController

STEP_S = 0.001
"""Longest step of servos and contacts [s]."""
SETTLING_RAD_S = 250.0
"""w, rate at which a contact settles [rad/s]."""
FRICTION_RATIO = 10.0
"""Stiffness of contacts along the sole over that along the normal."""
DIFFERENCE = 1e-5
"""Step of finite differences [m, rad]."""
BOTH = [True, True]


@dataclass(frozen=True)
class LinearPlant:
    """x_next = A x + B u, F = C x, u held from tick to tick.

    Attributes:
        A: (n, n) for x = (dq, v, s, F), with s the joints' set-points.
        B: (n, n_a) for the commanded positions.
        C: (12, n) wrenches of the ground on the soles during the last step, sole
            frames [N, N m].
        n_v: size of dq and of v.
    """

    A: Mat
    B: Mat
    C: Mat
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
        robot: has the servos.
        model: the same robot.
        dynamics: at the nominal stance, at rest.
        F_mean: (12,) mean wrenches of the soles there [N, N m].
        contact_stiffness: stiffness of one sole on its ground, along its normal [N/m].
        lag_s: lag of the set-points [s].
    """
    n_v, m = model.n_v, model.n_a
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
    return LinearPlant(A, B, C, n_v)


def _forces(
    robot: Robot,
    model: RobotModel,
    dynamics: Dynamics,
    *,
    F_mean: Array,
    stiffness: float,
    dt: float,
) -> tuple[Mat, Mat]:
    """Return accelerations and wrenches per (dq, v, s): (n_v, n) and (12, n)."""
    n_v, n = model.n_v, 2 * model.n_v + model.n_a
    H_inv, J = dynamics.H_inv.copy(), dynamics.J_contact.copy()
    H = dynamics.inertia_matrix()
    kp, kd = robot.kp[model.to_model], (robot.kd + robot.damping)[model.to_model]
    smooth = np.zeros((n_v, n))
    smooth[:, :n_v] = -_gravity(model, dynamics, F_mean)
    joints = np.arange(N_BASE_V, n_v)
    smooth[joints, joints] -= kp
    smooth[joints, n_v + joints] = -kd
    smooth[joints, 2 * n_v - N_BASE_V + joints] = kp
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
    """Return the map from sole twists to velocities of the soles' corners, (24, 12)."""
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
    """Return the change of gravity's and the mean wrenches' force, (n_v, n_v)."""
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


class LoopMatrices(NamedTuple):
    """x_next = A x + B e with e = C x, the (12,) wrench errors."""

    A: Mat
    B: Mat
    C: Mat


@dataclass(frozen=True)
class LinearController:
    """Answer of the controller to small deviations; x is the plant's first 2 n_v.

    F_id = F_x x;  v_J = v_x x + v_q q_command + v_r r;
    r = r_e (F - F_id) + r_x x + share (low + lead change), change = blend (J v - low).

    Attributes:
        F_x: (12, 2 n_v).
        v_x: (n_a, 2 n_v).
        v_q: (n_a, n_a).
        v_r: (n_a, 12).
        r_e: (12, 12) for the wrench errors.
        r_x: (12, 2 n_v) pull of the feet to the stance.
        twist: (12, 2 n_v) for the twists of the soles.
        ground: (12,) parts of the twists that are fed forward.
        blend: coefficient of the low-pass, per tick.
        lead: lead of the feed-forward [ticks].
        inverse_lead: lead in q + lead (q - q of the tick before), the command sent to
            the drives [1].
    """

    F_x: Mat
    v_x: Mat
    v_q: Mat
    v_r: Mat
    r_e: Mat
    r_x: Mat
    twist: Mat
    ground: Array
    blend: float
    lead: float
    inverse_lead: float


class LinearLoop:
    """Plant and controller; can be closed with any delay and any gains."""

    def __init__(self, robot: Robot, settings: ControllerSettings) -> None:
        """Linearise both in the nominal stance."""
        self.period_s = robot.period_s
        controller = WholeBodyController(robot, settings)
        model, dynamics = controller.model, controller.dynamics
        dynamics.update(model.nominal_configuration(), np.zeros(model.n_v))
        F_mean = _wrenches(controller).copy()
        self.plant: LinearPlant = linear_plant(
            robot,
            model,
            dynamics,
            F_mean=F_mean,
            contact_stiffness=settings.contact.stiffness_n_m,
            lag_s=robot.servo_profile.lag_s,
        )
        self.law = _linear_controller(controller, settings)

    def cut(self, delay_ticks: int, *, missed: bool = False) -> LoopMatrices:
        """Return the loop, cut at the wrench errors; closed it is A + B C.

        Its state: the plant's, the low-passed sole twists, the commands of the last
        ticks (newest first), and what the servos followed in the last tick.

        Args:
            delay_ticks: delay from a reading to the step in which its answer acts.
            missed: whether no answer acts in this tick; the servos go on as before.
        """
        plant, law, dt = self.plant, self.law, self.period_s
        n_p, m, past = len(plant.A), plant.B.shape[1], delay_ticks + 1
        low = slice(n_p, n_p + 12)
        sent = [slice(at, at + m) for at in range(low.stop, low.stop + m * past, m)]
        newest, due = sent[0], sent[-1]
        before = slice(due.stop, due.stop + m)
        n = before.stop
        A, B, C = np.zeros((n, n)), np.zeros((n, 12)), np.zeros((12, n))
        state = slice(0, 2 * plant.n_v)
        C[:, :n_p] = plant.C
        C[:, state] -= law.F_x
        A[low, state] = law.blend * law.twist
        A[low, low] = (1.0 - law.blend) * np.eye(12)
        # The feed-forward in r is low + (1 + lead) blend (J v - low), by this tick's
        # law.
        fed = (1.0 + law.lead) * law.blend
        forward = law.v_r * law.ground
        A[newest, state] = law.v_x + law.v_r @ law.r_x + fed * forward @ law.twist
        A[newest, low] = (1.0 - fed) * forward
        A[newest, newest] = law.v_q
        A[newest] *= dt
        A[newest, newest] += np.eye(m)
        B[newest] = dt * law.v_r @ law.r_e
        for later, sooner in zip(sent[1:], sent, strict=False):
            A[later, sooner] = np.eye(m)
        # The drives' inverse: the command sent for q after q_before.
        lead = law.inverse_lead
        if missed:
            A[before, before] = np.eye(m)
        elif delay_ticks == 0:
            A[before], B[before] = (1.0 + lead) * A[newest], (1.0 + lead) * B[newest]
            A[before, newest] -= lead * np.eye(m)
        else:
            A[before, sent[-2]] = (1.0 + lead) * np.eye(m)
            A[before, due] -= lead * np.eye(m)
        A[:n_p] = plant.B @ A[before]
        B[:n_p] = plant.B @ B[before]
        A[:n_p, :n_p] += plant.A
        return LoopMatrices(A, B, C)


def _wrenches(controller: WholeBodyController) -> Array:
    """Return F_id at the present state of the controller's dynamics, (12,)."""
    dynamics, stance = controller.dynamics, controller.stance
    stance.compare_base(_rotation(dynamics.q))
    weight = controller.model.mass * 9.81
    controller.tsid.solve(
        dynamics, stance, in_contact=BOTH, allowed=np.full(2, 2.0 * weight)
    )
    return controller.tsid.F_id


def _rotation(q: Array) -> Mat:
    R: Mat = pin.Quaternion(q[3:7]).toRotationMatrix()
    return R


def _linear_controller(
    controller: WholeBodyController, settings: ControllerSettings
) -> LinearController:
    model, dynamics = controller.model, controller.dynamics
    stance, dik = controller.stance, controller.dik
    n_v, n_a, q_0 = model.n_v, model.n_a, dynamics.q.copy()
    zero_r, q_command = np.zeros(12), model.nominal.copy()

    # Without limits: small motions reach those of no joint but a locked one.
    moved = np.delete(np.arange(n_v), N_BASE_V + np.flatnonzero(model.is_locked))

    def joints(r: Array, q_command: Array) -> Array:
        qp = dik.solve(dynamics, stance, r=r, q_command=q_command).problem
        x = np.zeros(n_v)
        x[moved] = np.linalg.solve(qp.P[np.ix_(moved, moved)], -qp.q_lin[moved])
        return x[N_BASE_V:]

    F_x, v_x = np.empty((12, 2 * n_v)), np.empty((n_a, 2 * n_v))
    r_x = np.zeros((12, 2 * n_v))
    leak = settings.dik.stance_leak
    for i in range(2 * n_v):
        found = []
        for sign in (DIFFERENCE, -DIFFERENCE):
            step = np.zeros(2 * n_v)
            step[i] = sign
            q = pin.integrate(model.pin_model, q_0, step[:n_v])
            dynamics.update(q, step[n_v:])
            F = _wrenches(controller).copy()
            pull = np.zeros(12)
            for side, rows in enumerate(SOLE_ROWS):
                offset = stance.p_sole[side] - dynamics.p_sole[side]
                pull[rows.start : rows.start + 2] = (
                    leak * (offset @ dynamics.R_world_sole[side])[:2]
                )
            found.append((F, joints(zero_r, q_command), pull))
        for into, plus, minus in zip((F_x, v_x, r_x), *found, strict=True):
            into[:, i] = (plus - minus) / (2.0 * DIFFERENCE)
    dynamics.update(q_0, np.zeros(n_v))
    stance.compare_base(_rotation(q_0))
    v_r, v_q = np.empty((n_a, 12)), np.empty((n_a, n_a))
    for i in range(12):
        r = np.zeros(12)
        r[i] = DIFFERENCE
        v_r[:, i] = (joints(r, q_command) - joints(-r, q_command)) / (2.0 * DIFFERENCE)
    for i, step in enumerate(DIFFERENCE * np.eye(n_a)):
        change = joints(zero_r, q_command + step) - joints(zero_r, q_command - step)
        v_q[:, i] = change / (2.0 * DIFFERENCE)
    law = controller.law
    twist = np.zeros((12, 2 * n_v))
    twist[:, n_v:] = dynamics.J_contact
    return LinearController(
        F_x=F_x,
        v_x=v_x,
        v_q=v_q,
        v_r=v_r,
        r_e=dynamics.mobility * law.minus_K_inv,
        r_x=r_x,
        twist=twist,
        ground=np.array(settings.ground.gain * 2),
        blend=law.blend,
        lead=law.lead,
        inverse_lead=controller.drives.lead,
    )
