"""How the feet feel the centre of mass accelerate."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from surefoot.schemas.arrays import Array, Vec3
from surefoot.stabilizer.model import RobotModel

LEAST_SHARE = 0.5
"""Of the weight that the feet must carry, to tell anything."""


OFFSET_SHARES = (0.1, 0.2)
"""Of the weight: what forces may be off in all, and from where on it is all an offset;
less is a payload or a model's error [1]."""
OFFSET_MEMORY_S = 2.0
"""Over which they are compared [s]."""


class FeltMotion:
    """Compares what the accelerometer feels with what the feet feel.

    Newton, for all of the robot: the sum of the feet's forces is its mass times the
    specific force of its centre of mass. Without spin, that force points from the
    centre of pressure to the centre of mass. The accelerometer feels the same but for
    the motion of the one against the other, which the joints tell.

    Attributes:
        by_force: (3,) the accelerometer's specific force less that by the forces,
            world axes [m/s^2].
        by_pressure: (3,) the same by where the soles are pressed; z is zero.
        relative: (3,) acceleration of the accelerometer against the centre of mass, by
            the joints [m/s^2].
        offsets: (2,) what the left and the right normal force are too large by: zero
            unless their sum is off by far [N].
    """

    def __init__(self, model: RobotModel, *, period_s: float) -> None:
        """Allocate."""
        self._soles = model.sole_ids
        self._mass = model.mass
        self._least = LEAST_SHARE * model.weight
        self._rate = 1.0 / period_s
        self._apart: Vec3 | None = None
        self._least_gain = period_s / OFFSET_MEMORY_S
        self._count = 0
        self._excess = self._aside = 0.0
        self.offsets: Array = np.zeros(2)
        self.relative: Vec3 = np.zeros(3)
        self.by_force: Vec3 = np.zeros(3)
        self.by_pressure: Vec3 = np.zeros(3)

    def compare(
        self, data: pin.Data, *, felt: Vec3, v_imu: Vec3, wrenches: Array | None
    ) -> bool:
        """Take one tick.

        Args:
            data: kinematics of the tick with the base's origin at rest in the world's
                origin, soles and centre of mass included.
            felt: (3,) specific force by the accelerometer, world axes [m/s^2].
            v_imu: (3,) velocity of the accelerometer, as in ``data`` [m/s].
            wrenches: (12,) measured at the soles, sole frames; None: not known.

        Returns:
            Whether anything was felt: ``by_force`` and ``by_pressure`` are new.
        """
        apart = v_imu - data.vcom[0]
        before = apart if self._apart is None else self._apart
        self._apart = apart
        np.subtract(apart, before, out=self.relative)
        self.relative *= self._rate
        if wrenches is None:
            return False
        com = data.com[0].tolist()
        f_x = f_y = f_z = turn_x = turn_y = height = 0.0
        for frame, start in zip(self._soles, (0, 6), strict=True):
            placement = data.oMf[frame]
            R = placement.rotation
            x, y, z = placement.translation.tolist()
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
        felt_here = felt - self.relative
        self.by_force[:] = f_x * over_mass, f_y * over_mass, f_z * over_mass
        np.subtract(felt_here, self.by_force, out=self.by_force)
        leverage = over_mass / (com[2] - height)
        self.by_pressure[:] = turn_x * leverage, turn_y * leverage, felt_here.item(2)
        np.subtract(felt_here, self.by_pressure, out=self.by_pressure)
        return True

    def learn_offsets(self, data: pin.Data) -> None:
        """Take one tick's comparison for what a force sensor is off by.

        The sum of the normal forces tells how much, where they seem to be pressed tells
        which foot: with b what a foot feels too much and a its distance from the centre
        of mass along the line between the feet,

            b_left + b_right = excess,   a_left b_left + a_right b_right = aside

        Args:
            data: as for :meth:`compare`.
        """
        left, right = (data.oMf[frame].translation for frame in self._soles)
        com_x, com_y, com_z = data.com[0].tolist()
        d_x, d_y = (left[:2] - right[:2]).tolist()
        apart = math.hypot(d_x, d_y)
        p_x, p_y, _ = self.by_pressure.tolist()
        arm = self._mass * (com_z - 0.5 * (left[2] + right[2])) / apart
        aside = -arm * (p_x * d_x + p_y * d_y)
        self._count += 1
        gain = max(1.0 / self._count, self._least_gain)
        excess = -self._mass * self.by_force.item(2)
        self._excess += gain * (excess - self._excess)
        self._aside += gain * (aside - self._aside)
        begins, ends = OFFSET_SHARES
        off = abs(self._excess) / (2.0 * self._least) - begins
        if off <= 0.0:
            self.offsets[:] = 0.0
            return
        share = min(1.0, off / (ends - begins)) / apart
        a_left = ((com_x - left[0]) * d_x + (com_y - left[1]) * d_y) / apart
        self.offsets[0] = share * ((a_left + apart) * self._excess - self._aside)
        self.offsets[1] = share * (self._aside - a_left * self._excess)
