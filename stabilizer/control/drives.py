"""Drives that lag: their inverse, and how quick feedback may be with them.

A drive is taken as its servo profile says: a set-point L that moves at a limited speed,
and one S behind it with a lag, S += g (L - S) in every tick. To have S where it is
wanted in the next tick,

    L = S + (q_wanted - S) / g

is sent. What the speed limit takes away is given back to q_wanted (back-calculation):
an inverse that went on asking for it would bounce between its limits.

Feet that bounce want softer drives: while one does, part of the inverse is left out.

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

from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array
from surefoot.schemas.law_settings import DikSettings
from surefoot.schemas.robot_file import ServoProfile
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.model import N_BASE_V, RobotModel

LEAST_MOTION = 1e-6
"""Of a sole, for a joint that turns by one radian [m, rad]."""
MARGIN = 2.12
"""From the speed at which the fastest mode sways: 6 dB, and 0.5 dB for single axes."""
DAMPED = 1.06
"""So much slower the servos' damping makes the fastest mode; only what is borne at the
very most counts on it."""
ROUNDING_TICKS = 1e-6


class DriveInverse:
    """The drives' model and its inverse, one for all joints.

    Attributes:
        sent: (n_a,) what is commanded to the drives [rad].
        lead: what is sent goes so many times further than is wanted in a tick [1].
        reached: (n_a,) where their set-points are with it, by the model [rad].
    """

    def __init__(self, profile: ServoProfile, *, joints: int, period_s: float) -> None:
        """Start at rest at zero; see :meth:`take_over`.

        Args:
            profile: speed limit and lag.
            joints: n_a.
            period_s: from tick to tick [s].
        """
        self._gain = -math.expm1(-period_s / profile.lag_s) if profile.lag_s else 1.0
        self.lead = 1.0 / self._gain - 1.0
        self._reach = profile.velocity_limit_rad_s * period_s
        self.sent: Array = np.zeros(joints)
        self.reached: Array = np.zeros(joints)
        self._low, self._high = np.zeros(joints), np.zeros(joints)
        self._asked = np.zeros(joints)

    @property
    def lags(self) -> bool:
        """Whether there is anything to make up for."""
        return self._gain < 1.0

    def take_over(self, q_command: Array) -> None:
        """Begin with drives at rest.

        Args:
            q_command: (n_a,) [rad].
        """
        self.sent[:] = self.reached[:] = q_command

    def follow(self, q_wanted: Array, *, share: float) -> Array:
        """Compute what to send in this tick.

        Args:
            q_wanted: (n_a,) where the set-points are wanted [rad]; what is out of
                reach is taken back in it.
            share: of the inverse, from none (0) to all of it (1).

        Returns:
            (n_a,) ``sent``, reused by the next call.
        """
        asked, reach = self._asked, self._reach
        np.subtract(q_wanted, self.reached, out=asked)
        asked *= share * self.lead
        asked += q_wanted
        np.subtract(self.sent, reach, out=self._low)
        np.add(self.sent, reach, out=self._high)
        np.maximum(asked, self._low, out=self.sent)
        np.minimum(self.sent, self._high, out=self.sent)
        is_beyond = self.sent != asked
        np.subtract(self.sent, self.reached, out=asked)
        asked *= self._gain
        self.reached += asked
        if share > 0.0 and is_beyond.any():
            back = share * (self.reached - q_wanted)
            q_wanted += np.where(is_beyond, back, 0.0)
        return self.sent


def fastest_mode(dynamics: Dynamics, *, kp: Array, contact_stiffness: float) -> float:
    """Compute the speed of the fastest mode with the default K.

    Args:
        dynamics: at the nominal stance.
        kp: (n_a,) stiffness of the servos, model order [N m/rad].
        contact_stiffness: of one sole on its ground, along its normal [N/m].

    Returns:
        k [1/s].

    Raises:
        RobotFileError: the legs cannot move both soles as they like.
    """
    model = dynamics.model
    legs = np.flatnonzero(model.is_leg)
    J = dynamics.J_contact
    rank = int(np.linalg.matrix_rank(J, tol=LEAST_MOTION))
    if rank < len(J):
        raise RobotFileError(
            f"{model.robot.path}: base and legs move both soles in {rank} of {len(J)} "
            "directions, and balancing takes all of them: is there a yaw joint at each "
            "hip, or roll below pitch, which turns a foot as well?"
        )
    # What torques do to the wrenches at once, Gamma_c; then by sole instead of joint.
    by_torque = np.linalg.solve(
        dynamics.Lambda_c_inv, J @ (dynamics.H_inv[:, N_BASE_V:] * kp)
    )
    servos = by_torque[:, legs] @ np.linalg.pinv(J[:, N_BASE_V + legs])
    soft = np.concatenate(
        [_give(contact_stiffness, *half) for half in model.half_sizes]
    )
    if np.linalg.matrix_rank(J[:, N_BASE_V + legs], tol=LEAST_MOTION) == len(J):
        both = np.linalg.inv(np.linalg.inv(servos) + np.diag(soft))
    else:  # legs of five joints: stiff by themselves in some directions only
        both = servos @ np.linalg.inv(np.eye(len(J)) + np.diag(soft) @ servos)
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


def borne_delay(robot: Robot, settings: ControllerSettings) -> int:
    """Compute the longest loop delay that leaves the fastest mode calm [ticks].

    K is as large as ``dik.loop_delay_s`` asks for.
    """
    model = RobotModel(robot)
    dynamics = Dynamics(model)
    dynamics.update(model.nominal_configuration(), np.zeros(model.n_v))
    speed = fastest_mode(
        dynamics,
        kp=robot.kp[model.to_model],
        contact_stiffness=settings.contact.stiffness_n_m,
    )
    period_s, ticks = robot.period_s, 1
    told = ticks_of(settings.dik.loop_delay_s, period_s)
    most = needed_stiffness(speed, delay_ticks=told, period_s=period_s)
    most *= DAMPED * MARGIN
    default = np.array(DikSettings().k_force)
    most *= float(np.min(np.array(settings.dik.k_force) / default))
    while needed_stiffness(speed, delay_ticks=ticks + 1, period_s=period_s) < most:
        ticks += 1
    return ticks


def ticks_of(delay_s: float, period_s: float) -> int:
    """Return a delay in ticks, rounded up; one at least."""
    return max(1, math.ceil(delay_s / period_s - ROUNDING_TICKS))
