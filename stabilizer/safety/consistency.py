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
SUDDEN_SHARE: Final = 0.25
"""Way of the pressure in a tick that is sudden, as a part of the sole's half, for a
foot that carries half of the weight [1]."""
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
    """Tells moments that would take a foot's pressure outside of its sole.

    Of the wrench at the sole, without the weight below the sensor, let f_z be the
    normal force and m_y the pitch moment; then abs(m_y) <= f_z * half length, and alike
    for roll. A law that follows a false moment turns the foot until the reading is
    possible again, so the check speaks at once. Pressure that gets outside little by
    little is believed: a foot tips, and its sensor has a constant offset.
    """

    def __init__(self, model: RobotModel, *, margin: float) -> None:
        """Precompute the maps from both sensors to the soles.

        Args:
            model: the robot.
            margin: distance outside of a sole that is still believed [m]. Below half of
                the robot's weight it counts as if the foot carried that much: on a
                light foot, noise and the foot's own inertia move the pressure further.
        """
        self._map: Mat = np.zeros((6, 12))
        self._weight: Array = np.zeros(6)
        self._wrench: Array = np.zeros(12)
        self._pressed: Array = np.zeros(6)
        self._halves = model.half_sizes
        self._margin, self._light = margin, LIGHT_SHARE * model.weight
        self._believed = [(math.inf, math.inf, math.inf)] * 2
        for side, (T, plate) in enumerate(
            zip(model.T_sensor_sole, model.plates, strict=True)
        ):
            rows, columns = slice(3 * side, 3 * side + 3), slice(6 * side, 6 * side + 6)
            # Normal force, roll and pitch moment.
            shift = wrench_shift(T.rotation, T.translation)[2:5]
            lift = plate.mass * GRAVITY * T.rotation[:, 2]  # of a level foot
            self._map[rows, columns] = shift
            self._weight[rows] = shift @ np.concatenate(
                (lift, np.cross(plate.com, lift))
            )

    def outside(self, snapshot: Snapshot, doubted: Feet = NEITHER) -> Feet:
        """Return whether left and right foot report pressure outside of the sole.

        Args:
            snapshot: the readings.
            doubted: feet whose pressure has been outside. It must come well within, by
                :data:`RETURN_SHARE`: a false moment may be possible at times.
        """
        wrench = self._wrench
        wrench[:6], wrench[6:] = snapshot.ft_left, snapshot.ft_right
        self._map.dot(wrench, out=self._pressed)
        self._pressed += self._weight
        left, right = self._pressed[:3].tolist(), self._pressed[3:].tolist()
        return (
            self._is_outside(0, left, is_doubted=doubted[0]),
            self._is_outside(1, right, is_doubted=doubted[1]),
        )

    def _is_outside(self, side: int, pressed: list[float], *, is_doubted: bool) -> bool:
        """Judge a foot, and keep what is believed."""
        normal, roll, pitch = pressed[0], abs(pressed[1]), abs(pressed[2])
        normal_before, roll_before, pitch_before = self._believed[side]
        half_length, half_width = self._halves[side]
        light, carried = self._light, max(normal, 0.0)
        outside = self._margin * max(normal, light)
        if is_doubted:  # a load as in an impact would excuse any moment
            carried, outside = min(carried, light), self._margin * light
            roll, pitch = roll / RETURN_SHARE, pitch / RETURN_SHARE
        # More load may bring more moment at once.
        known = max(normal - normal_before, 0.0) + SUDDEN_SHARE * light
        is_outside = (
            roll > carried * half_width + outside
            and (is_doubted or roll - roll_before > known * half_width)
        ) or (
            pitch > carried * half_length + outside
            and (is_doubted or pitch - pitch_before > known * half_length)
        )
        if not is_outside and roll + pitch < math.inf:
            self._believed[side] = normal, roll, pitch
        return is_outside
