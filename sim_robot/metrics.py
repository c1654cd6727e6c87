"""How well the robot stands, from the truth of every tick."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from schemas.arrays import Array, Vec3
from sim_robot.truth import PlantTruth

COM_FROM_S = 1.0
"""CoM errors and force deviations count from here on: ground begins to move."""
PEAK_FROM_S = 0.2
"""Force peaks count from here on."""
CONTACT_LOST_N = 5.0
"""A foot pressed less than this has lost the ground."""
_TIME_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class StandingFigures:
    """Figures of a run; see :class:`schemas.result.PlantResult`.

    Attributes:
        com_error_rms: (3,) [m].
        com_error_max: (3,) largest magnitude [m].
        base_tilt_max: [rad].
        force_deviation_rms: (2,) normal force against half the weight [N].
        force_peak: (2,) normal force [N].
        contact_lost_s: (2,) [s].
    """

    com_error_rms: Vec3
    com_error_max: Vec3
    base_tilt_max: float
    force_deviation_rms: Array
    force_peak: Array
    contact_lost_s: Array


class PlantMetrics:
    """Running sums over ticks; its memory does not grow with the run."""

    def __init__(self, start: PlantTruth, *, weight: float, period_s: float) -> None:
        """Takes the reference from how the robot stands.

        Args:
            start: truth at tick 0, at rest.
            weight: the robot's true weight [N].
            period_s: control period.
        """
        self._period_s = period_s
        self._half_weight = 0.5 * weight
        self._com_from = _first_tick(COM_FROM_S, period_s)
        self._peak_from = _first_tick(PEAK_FROM_S, period_s)
        self._reference = start.com.copy()
        self._reference[:2] -= 0.5 * (start.sole_left + start.sole_right)[:2]
        self._error = np.empty(3)
        self._squares = np.zeros(3)
        self._largest = np.zeros(3)
        self._counted = 0
        self._least_upright = 1.0
        self._force_squares = [0.0, 0.0]
        self._force_peak = [0.0, 0.0]
        self._lost_ticks = [0, 0]

    def update(self, truth: PlantTruth) -> None:
        """Takes in one tick; each tick once."""
        qx, qy = truth.base_quat_xyzw.item(0), truth.base_quat_xyzw.item(1)
        upright = 1.0 - 2.0 * (qx * qx + qy * qy)
        if upright < self._least_upright:
            self._least_upright = upright
        forces = truth.F_left.item(2), truth.F_right.item(2)
        for foot, force in enumerate(forces):
            if force < CONTACT_LOST_N:
                self._lost_ticks[foot] += 1
            if truth.tick >= self._peak_from and force > self._force_peak[foot]:
                self._force_peak[foot] = force
        if truth.tick >= self._com_from:
            self._count_errors(truth, forces)

    def figures(self) -> StandingFigures:
        """What the run amounts to so far; zero where nothing has counted yet."""
        count = max(self._counted, 1)
        return StandingFigures(
            com_error_rms=np.sqrt(self._squares / count),
            com_error_max=self._largest.copy(),
            base_tilt_max=math.acos(max(-1.0, self._least_upright)),
            force_deviation_rms=np.sqrt(np.array(self._force_squares) / count),
            force_peak=np.array(self._force_peak),
            contact_lost_s=np.array(self._lost_ticks) * self._period_s,
        )

    def _count_errors(self, truth: PlantTruth, forces: tuple[float, float]) -> None:
        """Adds up errors: x, y against the soles, z against the world."""
        error = self._error
        np.add(truth.sole_left, truth.sole_right, out=error)
        error *= -0.5
        error[2] = 0.0
        error += truth.com
        error -= self._reference
        self._counted += 1
        np.abs(error, out=error)
        np.maximum(self._largest, error, out=self._largest)
        error *= error
        self._squares += error
        for foot, force in enumerate(forces):
            deviation = force - self._half_weight
            self._force_squares[foot] += deviation * deviation


def _first_tick(time_s: float, period_s: float) -> int:
    return math.ceil(time_s / period_s - _TIME_TOLERANCE)
