"""Swing foot: its path over the expected ground, and its task in both QPs."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from surefoot.schemas.arrays import Array, Mat
from surefoot.schemas.settings import WalkSettings
from surefoot.stabilizer.control.reference import Stance
from surefoot.stabilizer.control.tasks import Task
from surefoot.stabilizer.dynamics import SOLE_ROWS, Dynamics, SolesAndCom
from surefoot.stabilizer.walking.footsteps import GLIDE_PEAK, RAMP, travel_part

LATE_RAMP_S = 0.06
"""Time in which a foot that finds no ground speeds up [s]."""
PACE_RATE = 10.0
"""Rate at which a foot changes its pace to be down sooner or later [1/s]."""
FASTEST_PACE = 2.0
SHIFT_RATE = 20.0
"""Bandwidth of the critically damped filter on shifts of the target [rad/s]."""


class SwingPath:
    """Horizontal place, heading and height over the expected ground.

    x, y and yaw glide to the target, from rest to rest. The height follows two
    quintics: up to the apex, and down to the ground with a small speed there. If the
    ground is not met, the foot goes on down (:func:`late_descent`).

    Attributes:
        xy: (x, y) [m].
        unshifted: (x, y) without the shift [m].
        xy_rate: velocity of ``xy`` [m/s].
        xy_acceleration: acceleration of ``xy`` [m/s^2].
        yaw: heading [rad].
        yaw_rate: rate of ``yaw`` [rad/s].
        turn: change of the heading from the beginning to the end [rad].
        height: height over the expected ground [m].
        height_rate: rate of ``height`` [m/s].
        height_acceleration: acceleration of ``height`` [m/s^2].
        time: time on the planned path, from its beginning [s].
        duration_s: time from the beginning to the planned touchdown [s].
        start: (x, y) of the beginning [m].
        way: (x, y) direction from the beginning to the target [1].
        apex: greatest height over the expected ground [m].
    """

    def __init__(self, settings: WalkSettings) -> None:
        """Wait for a step."""
        self._settings = settings
        self.xy = self.xy_rate = self.xy_acceleration = (0.0, 0.0)
        self.yaw = self.yaw_rate = 0.0
        self.height = self.height_rate = self.height_acceleration = 0.0
        self.start = self._way = self.unshifted = (0.0, 0.0)
        self._yaw_from = self.turn = 0.0
        self._height_from = self._rise = self.apex = 0.0
        self.duration_s = self._travel_s = 1.0
        self.way = (0.0, 0.0)
        self._travel_from_s = 0.0
        self._shift = self._shift_rate = (0.0, 0.0)
        self.time, self._pace = 0.0, 1.0

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
        climb: float = 0.0,
    ) -> None:
        """Lift off.

        Args:
            xy: place of the foot [m].
            yaw: its heading [rad].
            height: its height over the other foot's ground [m].
            target: place to set it down [m].
            target_yaw: heading at touchdown [rad].
            rise: height of the foothold over the other foot's ground [m].
            lift: height to lift it over the higher of both places [m].
            duration_s: time to the planned touchdown [s].
            climb: height of the foothold over the one that is left, by plan [m].
        """
        self.start = self.xy = self.unshifted = xy
        self._yaw_from = yaw
        self.turn = math.remainder(target_yaw - yaw, math.tau)
        self._height_from, self._rise = height, rise
        self.apex = max(height, rise) + lift
        self.duration_s = duration_s
        self._way = x, y = target[0] - xy[0], target[1] - xy[1]
        far = max(math.hypot(x, y), 1e-6)
        self.way = (x / far, y / far)
        begins, ends = travel_part(climb, lift, self._settings)
        self._travel_from_s = begins * duration_s
        self._travel_s = (ends - begins) * duration_s
        self._shift = self._shift_rate = (0.0, 0.0)
        self.time, self._pace = 0.0, 1.0

    def advance(
        self, t: float, *, duration_s: float, shift: tuple[float, float], dt: float
    ) -> None:
        """Compute the state of the path at a time.

        Args:
            t: time since lift-off [s].
            duration_s: time from lift-off to the touchdown wanted now [s].
            shift: shift of the target by step adjustment [m].
            dt: time since the last call [s].
        """
        self._pass_time(t, duration_s, dt)
        T, pace = self._travel_s, self._pace
        s, s_rate, s_acceleration = glide((self.time - self._travel_from_s) / T)
        s_rate = pace * s_rate / T
        s_acceleration = pace * pace * s_acceleration / (T * T)
        (x, y), (way_x, way_y) = self.start, self._way
        pull_x, pull_y = self._follow_shift(shift, dt)
        (shift_x, shift_y), (rate_x, rate_y) = self._shift, self._shift_rate
        x, y = x + way_x * s + shift_x, y + way_y * s + shift_y
        self.xy, self.unshifted = (x, y), (x - shift_x, y - shift_y)
        self.xy_rate = (way_x * s_rate + rate_x, way_y * s_rate + rate_y)
        self.xy_acceleration = (
            way_x * s_acceleration + pull_x,
            way_y * s_acceleration + pull_y,
        )
        self.yaw, self.yaw_rate = self._yaw_from + self.turn * s, self.turn * s_rate
        self.height, rise, lift = self._height_at(self.time)
        self.height_rate, self.height_acceleration = pace * rise, pace * pace * lift

    def velocity_after(self, ahead_s: float) -> tuple[float, float, float]:
        """Return the velocity after some time, with the present rate of the shift.

        Args:
            ahead_s: time to look ahead; before the planned touchdown at most up to it
                [s].

        Returns:
            Velocity along x and y, and rate of the height over the expected ground
            [m/s].
        """
        t, pace = self.time, self._pace
        if t < self.duration_s:
            t = min(t + pace * ahead_s, self.duration_s)
        else:
            t += ahead_s
        T = self._travel_s
        _, s_rate, _ = glide((t - self._travel_from_s) / T)
        s_rate *= pace
        way_x, way_y = self._way
        _, rate, _ = self._height_at(t)
        return (
            way_x * s_rate / T + self._shift_rate[0],
            way_y * s_rate / T + self._shift_rate[1],
            pace * rate,
        )

    def _follow_shift(
        self, shift: tuple[float, float], dt: float
    ) -> tuple[float, float]:
        """Advance the filter on shifts; return their acceleration [m/s^2]."""
        (x, y), (v_x, v_y) = self._shift, self._shift_rate
        stiff, damped = SHIFT_RATE * SHIFT_RATE, 2.0 * SHIFT_RATE
        a_x = stiff * (shift[0] - x) - damped * v_x
        a_y = stiff * (shift[1] - y) - damped * v_y
        v_x, v_y = v_x + dt * a_x, v_y + dt * a_y
        self._shift, self._shift_rate = (x + dt * v_x, y + dt * v_y), (v_x, v_y)
        return a_x, a_y

    def _pass_time(self, t: float, duration_s: float, dt: float) -> None:
        """Advance along the path: as planned, or so that it ends at the wanted time."""
        if t >= duration_s:
            self.time, self._pace = self.duration_s + (t - duration_s), 1.0
        elif duration_s == self.duration_s and self._pace == 1.0:
            self.time = t
        else:
            needed = (self.duration_s - self.time) / (duration_s - t + dt)
            needed = min(max(needed, 0.0), FASTEST_PACE)
            most = PACE_RATE * dt
            self._pace += min(max(needed - self._pace, -most), most)
            self.time = min(self.time + self._pace * dt, self.duration_s)

    def stay(self, xy: tuple[float, float], yaw: float) -> None:
        """Keep the place of a foot that bounced and goes straight down again."""
        self.xy, self.yaw, self.yaw_rate = xy, yaw, 0.0
        self.xy_rate = self.xy_acceleration = (0.0, 0.0)

    def _height_at(self, t: float) -> tuple[float, float, float]:
        """Return height, speed and acceleration over the expected ground."""
        settings, T = self._settings, self.duration_s
        up = settings.apex_part * T
        if t < up:
            return from_rest(max(t, 0.0), up, self._height_from, self.apex, 0.0)
        if t < T:
            fall = -settings.touchdown_m_s
            return from_rest(t - up, T - up, self.apex, self._rise, fall)
        speed, depth = late_descent(t - T, settings)
        if depth > settings.late_depth_m:
            depth, speed = settings.late_depth_m, 0.0
        return self._rise - depth, -speed, 0.0


class SwingReference:
    """Reference of a swing foot, world axes; written in place.

    Attributes:
        p: (3,) position of the sole [m].
        v: (3,) its velocity, the ground's included [m/s].
        a: (3,) its acceleration [m/s^2].
        v_ahead: (3,) its velocity after the servos' lag [m/s].
        R: (3, 3) orientation of the sole.
        w: (3,) its angular velocity, the ground's included [rad/s].
    """

    def __init__(self) -> None:
        """Begin with zeros."""
        self._all = np.zeros(24)  # side by side, to be written at once
        self.p, self.v, self.a, self.v_ahead, self.w = self._all[:15].reshape(5, 3)
        self.R: Mat = self._all[15:].reshape(3, 3)
        self.R[:] = np.eye(3)

    def write(self, *numbers: float) -> None:
        """Write p, v, a, v_ahead, w and the rows of R: 24 numbers."""
        self._all[:] = numbers


class SwingTask(Task):
    """One foot in the air follows its reference, in sole axes; first QP only.

    In the second QP the foot's twist comes from :meth:`twist` instead of the wrench
    law.
    """

    size = 6
    velocity_weights = None

    def __init__(
        self, side: int, reference: SwingReference, settings: WalkSettings
    ) -> None:
        """Read weights and gains.

        Args:
            side: left or right foot.
            reference: reference of the foot.
            settings: gains and weight.
        """
        self._rows = SOLE_ROWS[side]
        self._side, self._reference = side, reference
        self.acceleration_weights = np.full(6, settings.swing_weight)
        self._kp, self._kd = settings.swing_kp, settings.swing_kd
        self._gain = settings.swing_gain
        self._off, self._turn = np.zeros(3), np.zeros(3)
        self._wanted = np.zeros(3)

    def compare(self, soles: SolesAndCom) -> None:
        """Compute the foot's error; to be called first in every tick.

        Args:
            soles: at the present state.
        """
        reference, side = self._reference, self._side
        np.subtract(reference.p, soles.p_sole[side], out=self._off)
        self._turn = pin.log3(soles.R_world_sole[side].T.dot(reference.R))

    def jacobian(self, dynamics: Dynamics) -> Mat:
        """Return the sole's Jacobian."""
        return dynamics.J_contact[self._rows]

    def drift(self, dynamics: Dynamics) -> Array:
        """Return its drift [m/s^2, rad/s^2]."""
        return dynamics.Jdot_v_contact[self._rows]

    def acceleration(self, dynamics: Dynamics, stance: Stance, out: Array) -> None:
        """Write a PD law plus the path's acceleration [m/s^2, rad/s^2]."""
        reference, side = self._reference, self._side
        R = dynamics.R_world_sole[side]
        wanted, kp, kd = self._wanted, self._kp, self._kd
        np.multiply(self._off, kp, out=wanted)
        wanted += reference.a
        wanted += kd * reference.v
        a_x, a_y, a_z = wanted.dot(R).tolist()
        turn_x, turn_y, turn_z = self._turn.tolist()
        to_x, to_y, to_z = reference.w.dot(R).tolist()
        v_x, v_y, v_z, w_x, w_y, w_z = dynamics.v_sole[self._rows].tolist()
        # The Jacobian's rate is that of the spatial twist, which lacks a point's w x v.
        out[:] = (
            a_x - kd * v_x - (w_y * v_z - w_z * v_y),
            a_y - kd * v_y - (w_z * v_x - w_x * v_z),
            a_z - kd * v_z - (w_x * v_y - w_y * v_x),
            kp * turn_x + kd * (to_x - w_x),
            kp * turn_y + kd * (to_y - w_y),
            kp * turn_z + kd * (to_z - w_z),
        )

    def twist(self, dynamics: Dynamics, out: Array) -> None:
        """Write the sole's desired twist, sole axes.

        Args:
            dynamics: quantities at the present state.
            out: (6,) to be filled [m/s, rad/s].
        """
        reference, gain = self._reference, self._gain
        R = dynamics.R_world_sole[self._side]
        out[:3] = (reference.v_ahead + gain * self._off).dot(R)
        out[3:] = gain * self._turn + reference.w.dot(R)


def late_descent(late_s: float, settings: WalkSettings) -> tuple[float, float]:
    """Return speed [m/s] and depth [m] of a foot that searches for the ground.

    It begins slowly: the ground may be near, and drives answer a touchdown late.

    Args:
        late_s: time since the expected touchdown [s].
        settings: has the speeds at first and after a while.
    """
    slow, gain = settings.touchdown_m_s, settings.late_m_s - settings.touchdown_m_s
    ramp = min(late_s, LATE_RAMP_S)
    speed = slow + gain * ramp / LATE_RAMP_S
    depth = slow * late_s + gain * (late_s - ramp + 0.5 * ramp * ramp / LATE_RAMP_S)
    return speed, depth


def glide(s: float) -> tuple[float, float, float]:
    """Return a motion from 0 to 1, from rest to rest, and two derivatives, at s.

    Its speed rises and falls like half a cosine and is constant between. The peak is a
    fifth lower than a quintic's, since a leg's drives have a speed limit.
    """
    if s <= 0.0:
        return 0.0, 0.0, 0.0
    if s >= 1.0:
        return 1.0, 0.0, 0.0
    if s > 0.5:
        way, rate, acceleration = glide(1.0 - s)
        return 1.0 - way, rate, -acceleration
    fastest = GLIDE_PEAK
    if s > RAMP:
        return fastest * (s - 0.5 * RAMP), fastest, 0.0
    turn = math.pi / RAMP
    return (
        0.5 * fastest * (s - math.sin(turn * s) / turn),
        0.5 * fastest * (1.0 - math.cos(turn * s)),
        0.5 * fastest * turn * math.sin(turn * s),
    )


def from_rest(
    t: float, T: float, p0: float, p1: float, v1: float
) -> tuple[float, float, float]:
    """Return a quintic from rest to a place and a speed, and two derivatives.

    The acceleration is zero at both ends. So a foot that lags by its servos, or meets
    the ground a little early, still has the last speed.

    Args:
        t: time since the beginning [s].
        T: duration [s].
        p0: place at the beginning.
        p1: place at the end.
        v1: speed at the end.
    """
    s, way, last = t / T, p1 - p0, v1 * T
    square = s * s
    # p0 + way (10 s^3 - 15 s^4 + 6 s^5) + last (-4 s^3 + 7 s^4 - 3 s^5)
    a, b, c = 10.0 * way - 4.0 * last, 7.0 * last - 15.0 * way, 6.0 * way - 3.0 * last
    return (
        p0 + square * s * (a + s * (b + s * c)),
        square * (3.0 * a + s * (4.0 * b + s * 5.0 * c)) / T,
        s * (6.0 * a + s * (12.0 * b + s * 20.0 * c)) / (T * T),
    )
