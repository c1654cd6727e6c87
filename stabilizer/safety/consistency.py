"""Readings compared with each other: what no sensor can report if all are right.

The rate of turn and the attitude of an IMU tell the same motion. The ground pushes on a
sole only upwards, so that a foot's wrench acts within its sole.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array, Mat
from surefoot.schemas.settings import SafetySettings
from surefoot.stabilizer.estimation.wrenches import wrench_shift
from surefoot.stabilizer.model import GRAVITY, RobotModel

TURN_MEMORY_S: Final = 0.5
"""Time over which gyroscope and attitude are compared [s]."""
TURN_SHARE: Final = 0.1
"""Part of the angle turned in that time by which they may differ as well [1]."""
TURN_LEARNT_S: Final = 0.3
"""Time after the start in which their usual difference, a bias, is learnt [s]."""
LIGHT_SHARE: Final = 0.5
"""Part of the weight below which a foot counts as light [1]."""
RETURN_SHARE: Final = 0.5
"""Part of the limits within which a doubted foot's pressure is believed again [1]."""
SUDDEN_SHARE: Final = 0.5
SUDDEN_TICK_S: Final = 0.001
"""Way of the pressure in such a tick that is sudden, as a part of the sole's half, for
a foot that carries half of the weight [1, s]. In longer ticks it is up to the half."""
LOAD_ERROR: Final = 1.25
"""Moment over that which a change of force can bring: sensors have scale errors."""
Feet = tuple[bool, bool]
NEITHER: Final[Feet] = (False, False)


class TurnCheck:
    """Compares how the gyroscope and the unit's own attitude see up turn.

    With u the direction of up in the IMU frame, du/dt = u x w. The heading, which some
    units correct by the earth's magnetic field, does not count.

    Attributes:
        are_apart: whether they tell different motions.
    """

    def __init__(self, settings: SafetySettings, *, period_s: float) -> None:
        """Begin before the first reading.

        Args:
            settings: angle allowed, and time for which an odd reading is bridged.
            period_s: the robot's tick [s].
        """
        self.are_apart = False
        self._dt = period_s
        self._most = settings.attitude_gap_rad
        self._patience = round(settings.bridge_s / period_s)
        self._odd = 0
        self._left = round(TURN_LEARNT_S / period_s)
        self._keep = math.exp(-period_s / TURN_MEMORY_S)
        self._up: tuple[float, float, float] | None = None
        self._usual = self._felt = self._apart = (0.0, 0.0, 0.0)
        self._turned = 0.0

    def update(self, snapshot: Snapshot) -> None:
        """Take the readings of a tick."""
        x, y, z = up = up_in_unit(snapshot)
        w_x, w_y, w_z = snapshot.angular_velocity.tolist()
        turn = y * w_z - z * w_y, z * w_x - x * w_z, x * w_y - y * w_x
        keep = 1.0 if self._left else self._keep
        self._felt = _sum(self._felt, _sum(turn, self._usual, -1.0), self._dt)
        self._turned = keep * self._turned + math.hypot(*turn) * self._dt
        self._apart = _sum((0.0, 0.0, 0.0), self._apart, keep)
        if up != self._up:  # a new attitude; the gyroscope may be quicker
            seen = _sum(up, self._up or up, -1.0)
            self._apart = _sum(self._apart, _sum(self._felt, seen, -1.0), 1.0)
            self._felt, self._up = (0.0, 0.0, 0.0), up
        if not self._left:
            most = self._most + TURN_SHARE * self._turned
            is_odd = math.hypot(*self._apart) > most
            self._odd = self._odd + 1 if is_odd else 0
            self.are_apart = self._odd > self._patience
            return
        self._left -= 1
        if self._left == 0:
            self._usual = _sum((0.0, 0.0, 0.0), self._apart, 1.0 / TURN_LEARNT_S)
            self._apart, self._turned = (0.0, 0.0, 0.0), 0.0

    def in_words(self) -> str:
        """What the two tell."""
        angle = math.degrees(math.hypot(*self._apart))
        return f"gyroscope and attitude differ by {angle:.1f} deg"


def up_in_unit(snapshot: Snapshot) -> tuple[float, float, float]:
    """Return the world's up axis in the IMU frame, by the IMU's own attitude."""
    x, y, z, w = snapshot.quat_xyzw.tolist()
    return 2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)


def _sum(
    a: tuple[float, float, float], b: tuple[float, float, float], share: float
) -> tuple[float, float, float]:
    """Return a + share b."""
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


class SoleCheck:
    """Tells false moments: those that suddenly press outside of a sole.

    Of the wrench at the sole, without the weight below the sensor, let f_z be the
    normal force and m_y the pitch moment; then abs(m_y) <= f_z * half length, and alike
    for roll. A law that follows a false moment turns the foot until the reading is
    possible again, so the check speaks at once. Pressure that gets outside little by
    little is believed: a foot tips, and its sensor has a constant offset. So is one
    that comes with a force: a blow, or a matter of :class:`ForceOffsets`.
    """

    def __init__(
        self, model: RobotModel, *, margin: float, offsets: Array | None = None
    ) -> None:
        """Precompute the maps from both sensors to the soles.

        Args:
            model: the robot.
            margin: distance outside of a sole that is still believed [m]. Below half of
                the robot's weight it counts as if the foot carried that much: on a
                light foot, noise and the foot's own inertia move the pressure further.
            offsets: (2, 6) known offsets of left and right sensor, which may change.
        """
        self._map: Mat = np.zeros((14, 12))
        self._weight: Array = np.zeros(14)
        self._offsets: Array = np.zeros((2, 6)) if offsets is None else offsets
        self._wrench: Array = np.zeros((2, 6))
        self._flat = self._wrench.reshape(12)
        self._pressed: Array = np.zeros(14)
        self._halves = model.half_sizes
        self._margin, self._light = margin, LIGHT_SHARE * model.weight
        ticks = model.robot.period_s / SUDDEN_TICK_S
        self._sudden = min(1.0, SUDDEN_SHARE * ticks) * self._light
        self._believed: list[list[float] | None] = [None, None]
        for side, (T, plate) in enumerate(
            zip(model.T_sensor_sole, model.plates, strict=True)
        ):
            rows, columns = slice(7 * side, 7 * side + 7), slice(6 * side, 6 * side + 6)
            # Force, roll and pitch moment; the two moments about the sole's
            # middle at the sensor's height, where forces along the sole have no lever.
            R, p = T.rotation, T.translation
            raised = p - (R[:, 2] @ p) * R[:, 2]
            shift = np.vstack((wrench_shift(R, p)[:5], wrench_shift(R, raised)[3:5]))
            lift = plate.mass * GRAVITY * R[:, 2]  # of a level foot
            self._map[rows, columns] = shift
            self._weight[rows] = shift @ np.concatenate(
                (lift, np.cross(plate.com, lift))
            )

    def outside(self, snapshot: Snapshot, doubted: Feet = NEITHER) -> Feet:
        """Return whether left and right foot report pressure outside of the sole.

        Args:
            snapshot: the readings of a tick; to be called at every tick.
            doubted: feet whose pressure has been outside. It must come well within, by
                :data:`RETURN_SHARE`: a false moment may be possible at times.
        """
        self._wrench[0], self._wrench[1] = snapshot.ft_left, snapshot.ft_right
        self._wrench -= self._offsets
        self._map.dot(self._flat, out=self._pressed)
        self._pressed += self._weight
        numbers = self._pressed.tolist()
        return (
            self._is_outside(0, numbers[:7], is_doubted=doubted[0]),
            self._is_outside(1, numbers[7:], is_doubted=doubted[1]),
        )

    def _is_outside(self, side: int, felt: list[float], *, is_doubted: bool) -> bool:
        """Judge a foot, and keep what is believed."""
        x, y, normal, roll, pitch, raised_roll, raised_pitch = felt
        half_length, half_width = self._halves[side]
        light, carried = self._light, max(normal, 0.0)
        # A false force along the sole presses outside at one height only.
        roll = min(abs(roll), abs(raised_roll))
        pitch = min(abs(pitch), abs(raised_pitch))
        if is_doubted:
            # A load as in an impact would excuse any moment.
            carried = min(carried, light / LIGHT_SHARE)
            margin = self._margin * light
            is_outside = roll > RETURN_SHARE * (
                carried * half_width + margin
            ) or pitch > RETURN_SHARE * (carried * half_length + margin)
        else:
            margin = self._margin * max(normal, light)
            before = self._believed[side] or [x, y, normal, 0.0, 0.0, 0.0, 0.0]
            # More load, or a blow against the foot, may bring more moment at once.
            force = max(normal - before[2], 0.0) + math.hypot(
                x - before[0], y - before[1]
            )
            sudden = LOAD_ERROR * force + self._sudden
            by_roll = math.copysign(1.0, raised_roll) * (raised_roll - before[5])
            by_pitch = math.copysign(1.0, raised_pitch) * (raised_pitch - before[6])
            is_outside = (
                roll > carried * half_width + margin and by_roll > sudden * half_width
            ) or (
                pitch > carried * half_length + margin
                and by_pitch > sudden * half_length
            )
        if not is_outside and normal + roll + pitch < math.inf:
            self._believed[side] = felt
        return is_outside
