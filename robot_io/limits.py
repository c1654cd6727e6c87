"""Keeps commanded postures inside the robot's limits."""

from __future__ import annotations

import numpy as np

from robot_io.robot import Robot
from robot_io.verdict import Limit
from schemas.arrays import Array

ROUNDING_RAD = 1e-9
"""A command beyond a limit by less is cut to it without a word: a controller that
asks for exactly the limit must not be reported for its last bit."""


class CommandLimits:
    """Position, velocity and step limits of one tick's command.

    All are relative to the command of the tick before, not to the measured posture: a
    servo lags, and a limit against what it has reached would halve the speed.
    """

    def __init__(self, robot: Robot) -> None:
        """Reads the limits of a robot."""
        margin = robot.file.gate.position_margin_rad
        self._lower = robot.lower + margin
        self._upper = robot.upper - margin
        self._by_velocity = robot.velocity_limit * robot.period_s
        self._by_step = np.full(robot.n_a, robot.file.gate.step_limit_rad)
        self._reach = np.minimum(self._by_velocity, self._by_step)
        self._low = np.empty(robot.n_a)
        self._high = np.empty(robot.n_a)
        self._excess = np.empty(robot.n_a)

    def clip(self, wanted: Array, before: Array, *, out: Array) -> tuple[Limit, ...]:
        """Moves from one posture toward another as far as the limits allow.

        Args:
            wanted: (n_a,) finite [rad].
            before: (n_a,) command of the tick before [rad].
            out: (n_a,) what is allowed [rad]: never further than a step from
                ``before``, inside the range whenever ``before`` is.

        Returns:
            The limits that cut something off.
        """
        np.maximum(wanted, self._lower, out=out)
        np.minimum(out, self._upper, out=out)
        np.subtract(before, self._reach, out=self._low)
        np.add(before, self._reach, out=self._high)
        np.maximum(out, self._low, out=out)
        np.minimum(out, self._high, out=out)
        if out.tobytes() == wanted.tobytes():  # nearly always; the fastest to ask
            return ()
        np.abs(wanted - out, out=self._excess)
        if self._excess.max() <= ROUNDING_RAD:
            return ()
        return self._diagnose(wanted, before)

    def worst_joint(self) -> tuple[int, float]:
        """Index of the joint cut most in the last clip, and by how much [rad]."""
        index = int(self._excess.argmax())
        return index, float(self._excess[index])

    def _diagnose(self, wanted: Array, before: Array) -> tuple[Limit, ...]:
        inside = np.clip(wanted, self._lower, self._upper)
        move = np.abs(inside - before) - ROUNDING_RAD
        found = {
            Limit.POSITION: np.abs(wanted - inside) > ROUNDING_RAD,
            Limit.VELOCITY: move > self._by_velocity,
            Limit.STEP: move > self._by_step,
        }
        return tuple(limit for limit, joints in found.items() if joints.any())
