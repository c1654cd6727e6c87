"""How the feet feel the centre of mass accelerate, and which sensor is off then.

A robot at rest cannot tell a biased accelerometer from a lean by that sensor alone.
Its feet tell two more things about where up is: the direction of the force they feel,
and where on the soles they feel it, below the centre of mass. Three witnesses then, of
three different sensors: whichever is off, the one in the middle is not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.stabilizer.model import RobotModel

LEAST_SHARE = 0.5
"""Of the weight that the feet must carry, to tell anything."""


OFFSET_SHARES = (0.1, 0.2)
"""Of the weight: what forces may be off in all, and from where on it is all an offset;
less is a payload or a model's error [1]."""
OFFSET_MEMORY_S = 2.0
"""Over which they are compared [s]."""
OFFSET_LAG_S, OFFSET_ODD_S, OFFSET_ANEW_S = 0.1, 0.1, 0.03
"""Low-pass by which a sudden one is noticed; for how long it must last, as impacts do
not; how much of it the comparison that begins anew has seen then [s]."""
BIAS_LIMIT_M_S2 = 0.5
"""More than any accelerometer is off by [m/s^2]; a robot that is pulled at looks so."""
GROUND_BANDWIDTH = 15.0
"""Of the ground's acceleration along the level [rad/s]."""
FEIGNED_M_S2 = 0.15
"""So much may be tilt or bias [m/s^2]."""
LASTS_S = 1.0
"""Ground that has just pulled the other way is believed to go on after so long [s]."""
KNOWN_S = 0.5
"""After so long a mean is known, and what is far from it is a push, no bias [s]."""
SUDDEN_M_S2 = 0.1
"""By so much at most a reading counts as off the mean from then on [m/s^2]."""
USUAL_MEMORY_S = 60.0
"""How long a difference takes to be the new usual one."""
USUAL_LAG_S = 0.1
"""Low-pass by which a sudden one is noticed [s]."""
UNUSUAL_M_S2 = 0.05
"""No sensor's drift: the robot carries something, is held or hit [m/s^2]."""
ODD_FOR_S = 1.0
"""After so long what came suddenly is the new usual."""
FIRST_NOISE_M_S2 = 0.008
"""By so much noise may be off in the first readings; more is feet that settle."""
CALM_FOR_S = 0.3
"""So long after a sudden difference, and after feet in the air, the next one counts."""


class FeltMotion:
    """Compares what the accelerometer feels with what the feet feel.

    Newton, for all of the robot: the sum of the feet's forces is its mass times the
    specific force of its centre of mass. Without spin, that force points from the
    centre of pressure to the centre of mass. The accelerometer feels the same but for
    the motion of the one against the other, which the joints tell.

    Attributes:
        by_force: the accelerometer's specific force less that by the forces,
            world axes [m/s^2].
        by_pressure: (3,) the same by where the soles are pressed; z is zero.
        relative: acceleration of the accelerometer against the centre of mass, by
            the joints [m/s^2].
        offsets: what the left and the right normal force are too large by: zero
            unless their sum is off by far [N].
    """

    def __init__(self, model: RobotModel, *, period_s: float) -> None:
        """Allocate."""
        self._mass = model.mass
        self._least = LEAST_SHARE * model.weight
        self._rate = 1.0 / period_s
        self._apart: tuple[float, float, float] | None = None
        self._dt = period_s
        self._least_gain = period_s / OFFSET_MEMORY_S
        self._count = 0
        self._sudden = self._odd_s = 0.0
        self._excess = self._aside = 0.0
        self.offsets = [0.0, 0.0]
        self.relative = (0.0, 0.0, 0.0)
        self.by_force = (0.0, 0.0, 0.0)
        self.by_pressure = (0.0, 0.0, 0.0)

    def compare(
        self,
        *,
        felt: Sequence[float],
        v_imu: Sequence[float],
        com: Sequence[float],
        v_com: Sequence[float],
        soles: Sequence[tuple[Mat, Sequence[float]]],
        wrenches: Array | None,
    ) -> bool:
        """Take one tick, with the base's origin at rest in the world's origin.

        Numbers instead of arrays: of three each, they cost a third.

        Args:
            felt: specific force by the accelerometer, world axes [m/s^2].
            v_imu: velocity of the accelerometer [m/s].
            com: centre of mass [m].
            v_com: its velocity [m/s].
            soles: (3, 3) rotation and position of left and right sole [m].
            wrenches: (12,) measured at the soles, sole frames; None: not known.

        Returns:
            Whether anything was felt: ``by_force`` and ``by_pressure`` are new.
        """
        a_x, a_y, a_z = v_imu[0] - v_com[0], v_imu[1] - v_com[1], v_imu[2] - v_com[2]
        b_x, b_y, b_z = self._apart or (a_x, a_y, a_z)
        self._apart = a_x, a_y, a_z
        rate = self._rate
        r_x, r_y, r_z = (a_x - b_x) * rate, (a_y - b_y) * rate, (a_z - b_z) * rate
        self.relative = r_x, r_y, r_z
        if wrenches is None:
            return False
        f_x = f_y = f_z = turn_x = turn_y = height = 0.0
        for (R, (x, y, z)), start in zip(soles, (0, 6), strict=True):
            g_x, g_y, g_z = R.dot(wrenches[start : start + 3]).tolist()
            m_x, m_y, _ = R.dot(wrenches[start + 3 : start + 6]).tolist()
            f_x, f_y, f_z = f_x + g_x, f_y + g_y, f_z + g_z
            # Vertical force times its distance, and what the soles' moments add.
            turn_x += (com[0] - x) * g_z + m_y + z * g_x
            turn_y += (com[1] - y) * g_z - m_x + z * g_y
            height += z * g_z
        if f_z < self._least:
            return False
        height /= f_z
        turn_x -= height * f_x
        turn_y -= height * f_y
        over_mass = 1.0 / self._mass
        h_x, h_y, h_z = felt[0] - r_x, felt[1] - r_y, felt[2] - r_z
        self.by_force = (
            h_x - f_x * over_mass,
            h_y - f_y * over_mass,
            h_z - f_z * over_mass,
        )
        leverage = over_mass / (com[2] - height)
        self.by_pressure = h_x - turn_x * leverage, h_y - turn_y * leverage, 0.0
        return True

    def learn_offsets(
        self, com: Sequence[float], soles: Sequence[tuple[Mat, Sequence[float]]]
    ) -> None:
        """Take one tick's comparison for what a force sensor is off by.

        The sum of the normal forces tells how much, where they seem to be pressed tells
        which foot: with b what a foot feels too much and a its distance from the centre
        of mass along the line between the feet,

            b_left + b_right = excess,   a_left b_left + a_right b_right = aside

        Args:
            com: as for :meth:`compare`.
            soles: likewise.
        """
        (_, left), (_, right) = soles
        com_x, com_y, com_z = com
        d_x, d_y = left[0] - right[0], left[1] - right[1]
        apart = math.hypot(d_x, d_y)
        p_x, p_y, _ = self.by_pressure
        arm = self._mass * (com_z - 0.5 * (left[2] + right[2])) / apart
        aside = -arm * (p_x * d_x + p_y * d_y)
        excess = -self._mass * self.by_force[2]
        self._look_for_sudden(excess)
        self._count += 1
        gain = max(1.0 / self._count, self._least_gain)
        self._excess += gain * (excess - self._excess)
        self._aside += gain * (aside - self._aside)
        begins, ends = OFFSET_SHARES
        off = abs(self._excess) / (2.0 * self._least) - begins
        if off <= 0.0:
            self.offsets[:] = 0.0, 0.0
            return
        share = min(1.0, off / (ends - begins)) / apart
        a_left = ((com_x - left[0]) * d_x + (com_y - left[1]) * d_y) / apart
        self.offsets[0] = share * ((a_left + apart) * self._excess - self._aside)
        self.offsets[1] = share * (self._aside - a_left * self._excess)

    def _look_for_sudden(self, excess: float) -> None:
        """Begin the comparison anew when a force is off that was not.

        Two seconds are too long: meanwhile the foot yields to what it does not feel.
        """
        gap = excess - self._excess
        self._sudden += self._dt / OFFSET_LAG_S * (gap - self._sudden)
        if abs(self._sudden) < 2.0 * self._least * OFFSET_SHARES[1]:
            self._odd_s = 0.0
            return
        self._odd_s += self._dt
        if self._odd_s > OFFSET_ODD_S:
            self._count = round(OFFSET_ANEW_S / self._dt)
            self._sudden = self._odd_s = 0.0


class GroundAcceleration:
    """How the ground under the feet speeds up along the level.

    Ground that swings to and fro quickly is better let go under the robot: after each
    turn it is believed anew, by and by.

    The legs tell the velocity w of the centre of mass over the feet, the accelerometer
    its acceleration h in the world; what w does not gain, the ground does. An observer
    of bandwidth b compares them, so that neither is differentiated:

        w' = h - a + 2 b e,   a' = -b^2 e,   e = w_seen - w

    Attributes:
        acceleration: of the ground, world axes; nothing within what tilt and biases
            may feign [m/s^2].
    """

    def __init__(self, *, period_s: float) -> None:
        """Begin at rest."""
        self._dt = period_s
        self._raw = [0.0, 0.0]
        self._speed: list[float] | None = None
        self._pulled = [[0.0, 0.0], [0.0, 0.0]]  # by axis, back and ahead: how lately
        self._forget = math.exp(-period_s / LASTS_S)
        self.acceleration = [0.0, 0.0]

    def update(
        self, felt: Sequence[float], seen: Sequence[float], *, firm: bool
    ) -> None:
        """Advance by a tick.

        Args:
            felt: acceleration of the centre of mass by the accelerometer [m/s^2].
            seen: its velocity over the feet [m/s].
            firm: whether the feet stand, so that the legs tell.
        """
        if not firm or self._speed is None:
            self._speed = [seen[0], seen[1]]
            self._raw[:] = self.acceleration[:] = 0.0, 0.0
            return
        dt, b = self._dt, GROUND_BANDWIDTH
        for axis in (0, 1):
            e = seen[axis] - self._speed[axis]
            raw = self._raw[axis]
            self._speed[axis] += dt * (felt[axis] - raw + 2.0 * b * e)
            raw -= dt * b * b * e
            self._raw[axis] = raw
            sure = max(abs(raw) - FEIGNED_M_S2, 0.0)
            memory, ahead = self._pulled[axis], int(raw > 0.0)
            memory[0] *= self._forget
            memory[1] *= self._forget
            if sure:
                memory[ahead] = 1.0
            believed = sure * (1.0 - memory[1 - ahead])
            self.acceleration[axis] = math.copysign(believed, raw)


class HorizontalBias:
    """Learns the accelerometer's bias along the base's x and y.

    Each witness is a comparison, at every tick, of the specific force that the
    accelerometer reports with that of the centre of mass as the feet show it. Their
    means are kept: of all readings at first, later of the last ``memory_s``, in which
    a drift shows but a push, however hard, does not.

    Attributes:
        bias: (3,) in base axes; z is left to the height [m/s^2].
    """

    def __init__(self, *, memory_s: float, period_s: float) -> None:
        """Begin without a bias.

        Args:
            memory_s: how long readings count.
            period_s: time between two of them [s].
        """
        self._least = period_s / memory_s
        self._known = round(KNOWN_S / period_s)
        self._count = 0
        self._by_force = [0.0, 0.0]
        self._by_pressure = [0.0, 0.0]
        self.bias: Vec3 = np.zeros(3)

    def learn(
        self,
        by_force: Sequence[float],
        by_pressure: Sequence[float],
        R_world_base: Sequence[Sequence[float]],
    ) -> None:
        """Take one tick's comparison.

        Args:
            by_force: (3,) specific force of the accelerometer less that which the
                feet's horizontal forces show, world axes [m/s^2].
            by_pressure: (3,) the same by where the soles are pressed.
            R_world_base: rows of the base's rotation.
        """
        self._count += 1
        gain = max(1.0 / self._count, self._least)
        x_axis, y_axis, _ = R_world_base
        for mean, seen in (
            (self._by_force, by_force),
            (self._by_pressure, by_pressure),
        ):
            x, y = seen[0], seen[1]
            for axis in (0, 1):
                in_base = x_axis[axis] * x + y_axis[axis] * y
                off = in_base - mean[axis]
                if self._count > self._known:
                    off = min(max(off, -SUDDEN_M_S2), SUDDEN_M_S2)
                mean[axis] += gain * off
        for axis in (0, 1):
            # The third witness is the accelerometer: not off at all.
            middle = sorted((0.0, self._by_force[axis], self._by_pressure[axis]))[1]
            self.bias[axis] = min(max(middle, -BIAS_LIMIT_M_S2), BIAS_LIMIT_M_S2)


class UsualDifference:
    """Tells a difference of the vertical accelerations from what is usual.

    In what remains, feet and accelerometer may be averaged. Of a bounce all counts or
    nothing: blows and rests have no effect together, but parts of them would drive the
    height away. So nothing is told until it has been over for a while.

    Attributes:
        usual: what the accelerometer feels more than the feet as a rule [m/s^2].
        change: of it in the last tick, by drift, or as far as noise of the first
            readings may have been off [m/s^2].
    """

    def __init__(self, *, period_s: float) -> None:
        """Begin without a difference.

        Args:
            period_s: time between two updates [s].
        """
        self._dt = period_s
        self._count = 0
        self._sudden = self._odd_s = 0.0
        self._calm_s = CALM_FOR_S
        self._better = self._known = 0.0
        self.usual = self.change = 0.0

    def calibrate(self, difference: float | None) -> None:
        """Take one of a robot that keeps its posture; None: not known [m/s^2]."""
        self._count += 1
        if difference is not None:
            self.usual += (difference - self.usual) / self._count

    def unusual(self, difference: float | None) -> float:
        """Return what is not usual in a difference, and no bounce either [m/s^2].

        Args:
            difference: as for :meth:`calibrate`.
        """
        self.change = 0.0
        if difference is None:
            self._calm_s = 0.0
            return 0.0
        unusual = difference - self.usual
        self._sudden += self._dt / USUAL_LAG_S * (unusual - self._sudden)
        if abs(self._sudden) > UNUSUAL_M_S2:
            self._calm_s = 0.0
            self._odd_s += self._dt
            if self._odd_s > ODD_FOR_S:
                self.usual += self._sudden
                self._sudden = 0.0
                self._count = round(USUAL_LAG_S / self._dt)
            return 0.0
        self._odd_s = 0.0
        self._calm_s += self._dt
        if self._calm_s < CALM_FOR_S:
            return 0.0
        self._count += 1
        least = self._dt / USUAL_MEMORY_S
        gain = max(1.0 / self._count, least)
        self.usual += gain * unusual
        before = self._known
        self._better += (gain - least) * unusual
        self._known = min(max(self._better, -FIRST_NOISE_M_S2), FIRST_NOISE_M_S2)
        self.change = least * unusual + self._known - before
        return unusual
