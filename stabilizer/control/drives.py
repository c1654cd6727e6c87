"""Drives with lag: their inverse, and how fast force feedback may be with them.

A drive is modelled by its servo profile: a set-point L that moves at a limited speed,
and a set-point S behind it with a lag, S += g (L - S) in every tick. To bring S to the
wanted position in the next tick, the command sent is

    L = S + (q_wanted - S) / g

The part that the speed limit cuts off is given back to q_wanted (back-calculation).
Otherwise the inverse would keep asking for it and bounce between its limits.

Bouncing feet need softer drives: while a foot bounces, part of the inverse is left out.

A wrench error e moves a sole by Lambda_c^-1 |K|^-1 e. Servos and contact form a spring
k_s between commanded and real sole, which answers with a wrench. So the loop is an
integrator. Its fastest mode has the speed k, the largest eigenvalue of k_s Lambda_c^-1
|K|^-1. Sampled every dt, with d ticks of delay, the loop oscillates for speeds from

    k dt = 2 sin(pi / (2 (2 d + 1)))

upwards. ``needed_stiffness`` returns the factor on K that leaves a margin of 6 dB to
this on every axis; docs/margins.md has the margins of the whole loop.
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
"""Least motion of a sole per radian of a joint [m, rad]."""
MARGIN = 2.12
"""Oscillating over allowed speed of the fastest mode: 6 dB, and 0.5 for single axes."""
DAMPED = 1.06
"""Slowing of the fastest mode by the servos' damping; only the longest delay that is
borne makes use of it."""
ROUNDING_TICKS = 1e-6


class DriveInverse:
    """Model of the drives and its inverse, for all joints.

    Attributes:
        sent: (n_a,) command sent to the drives [rad].
        lead: how many times farther the command goes than the wanted motion of a tick
            [1].
        reached: (n_a,) set-points that the model reaches with it [rad].
    """

    def __init__(self, profile: ServoProfile, *, most: Array, period_s: float) -> None:
        """Start at rest at zero; see :meth:`take_over`.

        Args:
            profile: speed limit and lag.
            most: (n_a,) largest change of a command from tick to tick [rad].
            period_s: from tick to tick [s].
        """
        joints = most.size
        self._gain = -math.expm1(-period_s / profile.lag_s) if profile.lag_s else 1.0
        self.lead = 1.0 / self._gain - 1.0
        self._reach = np.full(joints, profile.velocity_limit_rad_s * period_s)
        self.sent: Array = np.zeros(joints)
        self.reached: Array = np.zeros(joints)
        self._low, self._high = np.zeros(joints), np.zeros(joints)
        self._asked = np.zeros(joints)
        self._most, self._waited = most, 0

    @property
    def lags(self) -> bool:
        """Whether the drives have a lag to compensate."""
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
            q_wanted: (n_a,) wanted set-points [rad]; corrected in place by the part out
                of reach.
            share: part of the inverse to use, from none (0) to all of it (1).

        Returns:
            (n_a,) ``sent``, reused by the next call.
        """
        asked, reach = self._asked, self._reach
        if self._waited:
            reach = np.minimum(reach * (1 + self._waited), self._most)
            self._waited = 0
        np.subtract(q_wanted, self.reached, out=asked)
        asked *= share * self.lead
        asked += q_wanted
        np.subtract(self.sent, reach, out=self._low)
        np.add(self.sent, reach, out=self._high)
        np.maximum(asked, self._low, out=self.sent)
        np.minimum(self.sent, self._high, out=self.sent)
        is_beyond = self.sent != asked
        self._move()
        if share > 0.0 and is_beyond.any():
            back = share * (self.reached - q_wanted)
            q_wanted += np.where(is_beyond, back, 0.0)
        return self.sent

    def wait(self) -> None:
        """Let a tick pass without a command; the drives go on towards the last one."""
        self._waited += 1
        self._move()

    def _move(self) -> None:
        np.subtract(self.sent, self.reached, out=self._asked)
        self._asked *= self._gain
        self.reached += self._asked


def fastest_mode(dynamics: Dynamics, *, kp: Array, contact_stiffness: float) -> float:
    """Compute the speed of the fastest mode with the default K.

    Args:
        dynamics: at the nominal stance.
        kp: (n_a,) stiffness of the servos, model order [N m/rad].
        contact_stiffness: stiffness of one sole on its ground, along its normal [N/m].

    Returns:
        k [1/s].

    Raises:
        RobotFileError: the legs cannot move both soles independently.
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
    # Immediate effect of torques on the wrenches, Gamma_c; then per sole.
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
    """Return the give of a sole on its corner springs, x y z roll pitch yaw, (6,)."""
    roll, pitch = normal * half_width**2, normal * half_length**2
    return 1.0 / np.array([normal, normal, normal, roll, pitch, roll + pitch])


def needed_stiffness(speed: float, *, delay_ticks: int, period_s: float) -> float:
    """Compute the factor on K that this loop needs, 1 or more.

    Args:
        speed: of the fastest mode with the default K [1/s].
        delay_ticks: delay from a reading to the step in which its answer acts.
        period_s: from tick to tick [s].
    """
    sways = 2.0 * math.sin(math.pi / (2.0 * (2.0 * delay_ticks + 1.0)))
    return max(1.0, MARGIN * speed * period_s / sways)


def borne_delay(robot: Robot, settings: ControllerSettings) -> int:
    """Compute the longest loop delay that leaves the fastest mode calm [ticks].

    K is as large as ``dik.loop_delay_s`` requires.
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
