"""Compares accelerometer and foot forces, and finds which sensor has an offset.

At rest the accelerometer alone cannot tell its bias from a lean. The feet tell in two
more ways where up is: by the direction of their force, and by the place on the soles
where it acts, below the centre of mass. Of these three witnesses from three sensors one
may be wrong; the one in the middle is right.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.stabilizer.model import RobotModel

LEAST_SHARE = 0.5
"""Part of the weight that the feet must carry for a comparison."""


OFFSET_SHARES = (0.1, 0.2)
"""Parts of the weight: total error of forces that is not yet an offset, and the one
from which all of it is; less is a payload or a model error [1]."""
OFFSET_MEMORY_S = 2.0
"""Time over which forces are compared [s]."""
OFFSET_LAG_S, OFFSET_ODD_S, OFFSET_ANEW_S = 0.1, 0.1, 0.03
"""Low-pass that detects a sudden offset; time for which it must last, unlike impacts;
time of it that a restarted comparison counts as seen [s]."""
BIAS_LIMIT_M_S2 = 0.5
"""Largest bias of any accelerometer [m/s^2]; a pulled robot seems to have more."""
DOUBT_M_S2 = 0.75
"""Bias of a robot at rest from which it should not balance: what is not corrected would
lean it by 1.5 deg and more [m/s^2]."""
GROUND_BANDWIDTH = 15.0
"""Bandwidth of the ground's horizontal acceleration [rad/s]."""
FEIGNED_M_S2 = 0.15
"""Acceleration that may come from tilt or bias [m/s^2]."""
LASTS_S = 1.0
"""Time after which ground that just pulled the other way is trusted to go on [s]."""
KNOWN_S = 0.5
"""Time until a mean is known; what is far from it is then a push, no bias [s]."""
SUDDEN_M_S2 = 0.1
"""Largest deviation from a known mean with which a reading counts [m/s^2]."""
USUAL_MEMORY_S = 60.0
"""Time in which a difference becomes the usual one [s]."""
USUAL_LAG_S = 0.1
"""Low-pass that detects a sudden difference [s]."""
UNUSUAL_M_S2 = 0.05
"""More than any drift: the robot carries something, is held or hit [m/s^2]."""
ODD_FOR_S = 1.0
"""Time after which a sudden difference is the new usual one [s]."""
FIRST_NOISE_M_S2 = 0.008
"""Noise of the mean of the first readings; more comes from settling feet [m/s^2]."""
CALM_FOR_S = 0.3
"""Pause after a sudden difference or feet in the air until the next counts [s]."""


class FeltMotion:
    """Compares what the accelerometer feels with what the feet feel.

    Newton's law for the whole robot: the sum of the foot forces is its mass times the
    specific force of its centre of mass. Without spin, that force points from the
    centre of pressure to the CoM. The accelerometer feels the same, except for its
    motion relative to the CoM, which the joints tell.

    Attributes:
        by_force: specific force by the accelerometer minus that by the foot forces,
            world axes [m/s^2].
        by_pressure: (3,) the same by the centre of pressure; z is zero [m/s^2].
        relative: acceleration of the accelerometer relative to the CoM, by the joints
            [m/s^2].
        offsets: error of left and right normal force; zero unless their sum is far off
            [N].
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
        ticks: int = 1,
    ) -> bool:
        """Compare one tick, with the base's origin at rest in the world's origin.

        Plain numbers are used: for three each they cost a third of arrays.

        Args:
            felt: specific force by the accelerometer, world axes [m/s^2].
            v_imu: velocity of the accelerometer [m/s].
            com: centre of mass [m].
            v_com: velocity of the centre of mass [m/s].
            soles: (3, 3) rotation and position of left and right sole [m].
            wrenches: (12,) measured sole wrenches, sole frames [N, N m]; None: unknown.
            ticks: number of ticks since the last comparison.

        Returns:
            Whether the feet carry enough, so that ``by_force`` and ``by_pressure`` are
            new.
        """
        a_x, a_y, a_z = v_imu[0] - v_com[0], v_imu[1] - v_com[1], v_imu[2] - v_com[2]
        b_x, b_y, b_z = self._apart or (a_x, a_y, a_z)
        self._apart = a_x, a_y, a_z
        rate = self._rate / ticks
        r_x, r_y, r_z = (a_x - b_x) * rate, (a_y - b_y) * rate, (a_z - b_z) * rate
        self.relative = r_x, r_y, r_z
        if wrenches is None:
            return False
        f_x = f_y = f_z = turn_x = turn_y = height = 0.0
        for (R, (x, y, z)), start in zip(soles, (0, 6), strict=True):
            g_x, g_y, g_z = R.dot(wrenches[start : start + 3]).tolist()
            m_x, m_y, _ = R.dot(wrenches[start + 3 : start + 6]).tolist()
            f_x, f_y, f_z = f_x + g_x, f_y + g_y, f_z + g_z
            # Vertical force times its lever, plus the soles' moments.
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
        """Learn the offsets of the force sensors from one tick's comparison.

        The sum of the normal forces tells how much is wrong; the place where they seem
        to act tells on which foot. With b the excess force of a foot and a its distance
        from the CoM along the line between the feet,

            b_left + b_right = excess,   a_left b_left + a_right b_right = aside

        Args:
            com: centre of mass, as for :meth:`compare` [m].
            soles: poses of the soles, as for :meth:`compare`.
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
        """Restart the comparison when a force suddenly gets an offset.

        The usual two seconds are too long: meanwhile the foot yields to a false force.
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
    """Horizontal acceleration of the ground under the feet.

    Ground that swings quickly is better left to move under the robot: after each
    reversal its acceleration is trusted again only gradually.

    The legs tell the velocity w of the CoM over the feet, the accelerometer the CoM's
    acceleration h in the world. The difference of h and w' is the acceleration a of the
    ground. An observer of bandwidth b compares them without differentiating:

        w' = h - a + 2 b e,   a' = -b^2 e,   e = w_seen - w

    Attributes:
        acceleration: acceleration of the ground, world axes; zero within what tilt and
            bias may cause [m/s^2].
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
            seen: velocity of the centre of mass over the feet [m/s].
            firm: whether both feet stand, so that the legs can be trusted.
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

    Each witness compares, at every tick, the specific force by the accelerometer with
    that of the CoM as the feet show it. Their means are kept: of all readings at first,
    later of the last ``memory_s``. A drift shows in these, but a push, however hard,
    does not.

    Attributes:
        bias: (3,) in base axes; z is left to the height [m/s^2].
        seen: (2,) the same without a limit.
    """

    def __init__(self, *, memory_s: float, period_s: float) -> None:
        """Begin without a bias.

        Args:
            memory_s: time for which readings count [s].
            period_s: time between two of them [s].
        """
        self._least = period_s / memory_s
        self._known = round(KNOWN_S / period_s)
        self._count = 0
        self._by_force = [0.0, 0.0]
        self._by_pressure = [0.0, 0.0]
        self.bias: Vec3 = np.zeros(3)
        self.seen = [0.0, 0.0]

    def learn(
        self,
        by_force: Sequence[float],
        by_pressure: Sequence[float],
        R_world_base: Sequence[Sequence[float]],
    ) -> None:
        """Take one tick's comparison.

        Args:
            by_force: (3,) specific force by the accelerometer minus that by the feet's
                horizontal forces, world axes [m/s^2].
            by_pressure: (3,) the same by the centre of pressure [m/s^2].
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
            # The third witness is the accelerometer itself, at zero.
            middle = sorted((0.0, self._by_force[axis], self._by_pressure[axis]))[1]
            self.seen[axis] = middle
            self.bias[axis] = min(max(middle, -BIAS_LIMIT_M_S2), BIAS_LIMIT_M_S2)


class UsualDifference:
    """Separates a difference of the vertical accelerations from the usual one.

    In the rest, feet and accelerometer may be averaged. A bounce must count as a whole
    or not at all: its blows and rests cancel, but parts of them would drive the height
    away. So nothing is reported until a bounce has been over for a while.

    Attributes:
        usual: usual difference, accelerometer minus feet [m/s^2].
        change: change of ``usual`` in the last tick, by drift, or within the noise of
            the first readings [m/s^2].
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
        """Take a difference at a kept posture; None: unknown [m/s^2]."""
        self._count += 1
        if difference is not None:
            self.usual += (difference - self.usual) / self._count

    def unusual(self, difference: float | None) -> float:
        """Return the unusual part of a difference, without bounces [m/s^2].

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
