"""The swing foot: its path, and its task in both QPs."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.schemas.walk_settings import WalkSettings
from surefoot.stabilizer.control.reference import Stance
from surefoot.stabilizer.control.tasks import Task
from surefoot.stabilizer.dynamics import SOLE_ROWS, Dynamics

SHIFT_RATE = 20.0
"""Shifts of the target reach the foot through a critically damped filter [rad/s]."""


class SwingPath:
    """Horizontal place, heading and height over the expected ground.

    x, y and yaw follow a quintic to the target, rest to rest. The height follows two
    cubics: up to the apex, and down to the ground with a small speed there; later,
    where the ground was expected and is not, it goes down evenly.

    Attributes:
        xy: (x, y) [m].
        xy_rate: its velocity [m/s].
        xy_acceleration: [m/s^2].
        yaw: [rad].
        yaw_rate: [rad/s].
        height: over the expected ground [m].
        height_rate: [m/s].
        height_acceleration: [m/s^2].
    """

    def __init__(self, settings: WalkSettings) -> None:
        """Wait for a step."""
        self._settings = settings
        self.xy = self.xy_rate = self.xy_acceleration = (0.0, 0.0)
        self.yaw = self.yaw_rate = 0.0
        self.height = self.height_rate = self.height_acceleration = 0.0
        self._from = self._to = (0.0, 0.0)
        self._yaw_from = self._yaw_to = 0.0
        self._height_from = self._rise = self._apex = 0.0
        self._duration_s = 1.0
        self._shift = [0.0, 0.0]
        self._shift_rate = [0.0, 0.0]

    def begin(
        self,
        *,
        xy: tuple[float, float],
        yaw: float,
        height: float,
        target: tuple[float, float],
        target_yaw: float,
        rise: float,
        lift: float,
        duration_s: float,
    ) -> None:
        """Lift off.

        Args:
            xy: where the foot is [m].
            yaw: its heading [rad].
            height: its height over the other foot's ground [m].
            target: where to set it [m].
            target_yaw: with which heading [rad].
            rise: height of the foothold over the other foot's ground [m].
            lift: how high to lift it over the higher of both places [m].
            duration_s: to the planned touchdown.
        """
        self._from, self._to = xy, target
        self._yaw_from = yaw
        self._yaw_to = yaw + math.remainder(target_yaw - yaw, math.tau)
        self._height_from, self._rise = height, rise
        self._apex = max(height, rise) + lift
        self._duration_s = duration_s
        self._shift, self._shift_rate = [0.0, 0.0], [0.0, 0.0]

    def advance(self, t: float, *, shift: tuple[float, float], dt: float) -> None:
        """Compute where the foot belongs at a time.

        Args:
            t: since lift-off [s].
            shift: of the target, by step adjustment [m].
            dt: since the last call [s].
        """
        T = self._duration_s * self._settings.horizontal_part
        s, s_rate, s_acceleration = quintic(t / T)
        s_rate, s_acceleration = s_rate / T, s_acceleration / (T * T)
        xy, rate, acceleration = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
        for i in range(2):
            pull = SHIFT_RATE * SHIFT_RATE * (shift[i] - self._shift[i])
            pull -= 2.0 * SHIFT_RATE * self._shift_rate[i]
            self._shift_rate[i] += dt * pull
            self._shift[i] += dt * self._shift_rate[i]
            way = self._to[i] - self._from[i]
            xy[i] = self._from[i] + way * s + self._shift[i]
            rate[i] = way * s_rate + self._shift_rate[i]
            acceleration[i] = way * s_acceleration + pull
        self.xy, self.xy_rate = (xy[0], xy[1]), (rate[0], rate[1])
        self.xy_acceleration = (acceleration[0], acceleration[1])
        turn = self._yaw_to - self._yaw_from
        self.yaw, self.yaw_rate = self._yaw_from + turn * s, turn * s_rate
        self.height, self.height_rate, self.height_acceleration = self._height_at(t)

    def velocity_at(self, t: float) -> tuple[float, float, float]:
        """Return the velocity at another time, the shift's rate as it is now.

        Args:
            t: since lift-off [s].

        Returns:
            x, y, and of the height over the expected ground [m/s].
        """
        T = self._duration_s * self._settings.horizontal_part
        _, s_rate, _ = quintic(t / T)
        way_x, way_y = self._to[0] - self._from[0], self._to[1] - self._from[1]
        _, rate, _ = self._height_at(t)
        return (
            way_x * s_rate / T + self._shift_rate[0],
            way_y * s_rate / T + self._shift_rate[1],
            rate,
        )

    def stay(self, xy: tuple[float, float], yaw: float) -> None:
        """Keep a place: a foot that bounced goes straight down again."""
        self.xy, self.yaw, self.yaw_rate = xy, yaw, 0.0
        self.xy_rate = self.xy_acceleration = (0.0, 0.0)

    def _height_at(self, t: float) -> tuple[float, float, float]:
        """Return height, speed and acceleration over the expected ground."""
        settings, T = self._settings, self._duration_s
        up = settings.apex_part * T
        if t < up:
            return hermite(t, up, self._height_from, 0.0, self._apex, 0.0)
        if t < T:
            fall = -settings.touchdown_m_s
            return hermite(t - up, T - up, self._apex, 0.0, self._rise, fall)
        speed = settings.late_m_s
        depth = speed * (t - T)
        if depth > settings.late_depth_m:
            depth, speed = settings.late_depth_m, 0.0
        return self._rise - depth, -speed, 0.0


class SwingReference:
    """Where a swing foot should be, world axes; written in place.

    Attributes:
        p: (3,) sole [m].
        v: (3,) its velocity, with the ground's [m/s].
        a: (3,) its acceleration [m/s^2].
        v_ahead: (3,) the velocity by the servos' lag later [m/s].
        R: (3, 3) orientation.
        w: (3,) angular velocity, with the ground's [rad/s].
    """

    def __init__(self) -> None:
        """Begin with zeros."""
        self.p: Vec3 = np.zeros(3)
        self.v: Vec3 = np.zeros(3)
        self.a: Vec3 = np.zeros(3)
        self.v_ahead: Vec3 = np.zeros(3)
        self.R: Mat = np.eye(3)
        self.w: Vec3 = np.zeros(3)


class SwingTask(Task):
    """One foot in the air follows its reference, in sole axes; first QP only.

    In the second QP its twist takes the place of the wrench law's for that foot: see
    :meth:`twist`.
    """

    size = 6
    velocity_weights = None

    def __init__(
        self, side: int, reference: SwingReference, settings: WalkSettings
    ) -> None:
        """Read weights and gains.

        Args:
            side: left or right foot.
            reference: where it should be.
            settings: gains and weight.
        """
        self._rows = SOLE_ROWS[side]
        self._side, self._reference = side, reference
        self.acceleration_weights = np.full(6, settings.swing_weight)
        self._kp, self._kd = settings.swing_kp, settings.swing_kd
        self._gain = settings.swing_gain

    def jacobian(self, dynamics: Dynamics) -> Mat:
        """Return the sole's Jacobian."""
        return dynamics.J_contact[self._rows]

    def drift(self, dynamics: Dynamics) -> Array:
        """Return its drift [m/s^2, rad/s^2]."""
        return dynamics.Jdot_v_contact[self._rows]

    def acceleration(self, dynamics: Dynamics, stance: Stance, out: Array) -> None:
        """Write a PD law with the path's acceleration ahead [m/s^2, rad/s^2]."""
        reference, side = self._reference, self._side
        R = dynamics.R_world_sole[side]
        twist = dynamics.v_sole[self._rows]
        v, w = twist[:3], twist[3:]
        wanted = reference.a + self._kp * (reference.p - dynamics.p_sole[side])
        wanted += self._kd * reference.v
        # The Jacobian's rate is that of the spatial twist: less w x v than a point's.
        out[:3] = wanted @ R - self._kd * v - np.cross(w, v)
        turn = pin.log3(R.T @ reference.R)
        out[3:] = self._kp * turn + self._kd * (reference.w @ R - w)

    def twist(self, dynamics: Dynamics, out: Array) -> None:
        """Write the sole's wanted twist, sole axes.

        Args:
            dynamics: quantities at the present state.
            out: (6,) to be filled [m/s, rad/s].
        """
        reference, side, gain = self._reference, self._side, self._gain
        R = dynamics.R_world_sole[side]
        off = reference.p - dynamics.p_sole[side]
        out[:3] = (reference.v_ahead + gain * off) @ R
        out[3:] = gain * pin.log3(R.T @ reference.R) + reference.w @ R


def quintic(s: float) -> tuple[float, float, float]:
    """Return the rest-to-rest quintic from 0 to 1 with two derivatives, at s."""
    if s <= 0.0:
        return 0.0, 0.0, 0.0
    if s >= 1.0:
        return 1.0, 0.0, 0.0
    square = s * s
    return (
        square * s * (10.0 + s * (6.0 * s - 15.0)),
        30.0 * square * (1.0 + s * (s - 2.0)),
        60.0 * s * (1.0 + s * (2.0 * s - 3.0)),
    )


def hermite(
    t: float, T: float, p0: float, v0: float, p1: float, v1: float
) -> tuple[float, float, float]:
    """Return a cubic between two places and speeds, with two derivatives.

    Args:
        t: time in it [s].
        T: its duration [s].
        p0: place at first.
        v0: speed at first.
        p1: place at last.
        v1: speed at last.
    """
    a = (2.0 * (p0 - p1) + (v0 + v1) * T) / (T * T * T)
    b = (3.0 * (p1 - p0) - (2.0 * v0 + v1) * T) / (T * T)
    return (
        p0 + t * (v0 + t * (b + t * a)),
        v0 + t * (2.0 * b + 3.0 * a * t),
        2.0 * b + 6.0 * a * t,
    )
