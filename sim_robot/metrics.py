"""Figures, record and digest of a run's ticks: how well the robot stood and walked."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from surefoot.robot_io.snapshot import Snapshot, SnapshotLayout, readings
from surefoot.robot_io.ticks.recorder import TickRecorder, TickSink
from surefoot.schemas.arrays import MM_PER_M, Array, Vec3
from surefoot.schemas.reasons import FallCriterion
from surefoot.schemas.signals import lay_out
from surefoot.sim_robot.state_view import PlantTruth, PlantView

COM_FROM_S = 1.0
"""Start of CoM errors and force deviations: the ground begins to move then [s]."""
PEAK_FROM_S = 0.2
"""Start of force peaks [s]."""
CONTACT_LOST_N = 5.0
"""A foot with less normal force has lost the ground [N]."""
AIRBORNE_S = 0.05
"""A foot off the ground for longer was lifted; otherwise it has bounced [s]."""
TOUCHDOWN_S = 0.1
"""Time after a touchdown in which force peaks belong to it [s]."""
_TIME_TOLERANCE = 1e-9
FALL_HEIGHT_RATIO = 0.6
"""Ratio of base height above the soles to that of standing below which it is a fall."""
FALL_TILT_RAD = math.radians(60.0)
FALL_CLEARANCE_M = 0.03
"""Links above the ankles this close to the height of the lower sole are down [m]."""
_UPRIGHT = math.cos(FALL_TILT_RAD)


class PlantMetrics:
    """Running sums over ticks; memory does not grow with the run."""

    def __init__(self, reference: Vec3, *, weight: float, period_s: float) -> None:
        """Start all sums at zero.

        Args:
            reference: (3,) centre of mass of the reference stance, x and y from the
                midpoint of the soles, z in the world [m].
            weight: the robot's true weight [N].
            period_s: control period [s].
        """
        self._period_s = period_s
        self._half_weight = 0.5 * weight
        self._com_from = _first_tick(COM_FROM_S, period_s)
        self._peak_from = _first_tick(PEAK_FROM_S, period_s)
        self._reference = reference.tolist()
        self._squares = [0.0, 0.0, 0.0]
        self._largest = [0.0, 0.0, 0.0]
        self._counted = 0
        self._least_upright = 1.0
        self._force_squares = [0.0, 0.0]
        self._force_peak = [0.0, 0.0]
        self._has_peaks = False
        self._lost_ticks = [0, 0]
        self._gap_ticks = [0, 0]
        self._longest_gap = [0, 0]

    def update(self, state: PlantTruth | PlantView, *, tick: int) -> None:
        """Add one tick; each tick once."""
        self._least_upright = min(self._least_upright, state.upright)
        forces = state.normal_forces
        self._has_peaks = tick >= self._peak_from
        for foot, force in enumerate(forces):
            if force < CONTACT_LOST_N:
                self._lost_ticks[foot] += 1
                self._gap_ticks[foot] += 1
                if self._gap_ticks[foot] > self._longest_gap[foot]:
                    self._longest_gap[foot] = self._gap_ticks[foot]
            else:
                self._gap_ticks[foot] = 0
            if self._has_peaks and force > self._force_peak[foot]:
                self._force_peak[foot] = force
        if tick >= self._com_from:
            self._count_errors(state)

    def figures(self) -> dict[str, Any]:
        """Return the figures so far, by their names in PlantResult.

        Deviations are those of the vertical force in the world, not of the normal
        force: on tilted ground the normal force is below half the weight even at rest.
        """
        count = self._counted

        def counted(values: Array, unit: float = 1.0) -> list[float] | None:
            return (unit * values).tolist() if count else None

        def rms(squares: list[float]) -> Array:
            return np.sqrt(np.array(squares) / max(count, 1))

        return {
            "com_error_rms_mm": counted(rms(self._squares), MM_PER_M),
            "com_error_max_mm": counted(np.array(self._largest), MM_PER_M),
            "base_tilt_max_deg": math.degrees(
                math.acos(max(-1.0, self._least_upright))
            ),
            "force_deviation_rms_n": counted(rms(self._force_squares)),
            "force_peak_n": list(self._force_peak) if self._has_peaks else None,
            "contact_lost_s": (np.array(self._lost_ticks) * self._period_s).tolist(),
            "contact_gap_s": (np.array(self._longest_gap) * self._period_s).tolist(),
        }

    def _count_errors(self, state: PlantTruth | PlantView) -> None:
        self._counted += 1
        for axis, value in enumerate(_com_over_soles(state)):
            error = abs(value - self._reference[axis])
            self._squares[axis] += error * error
            if error > self._largest[axis]:
                self._largest[axis] = error
        for foot, force in enumerate(state.vertical_forces):
            deviation = force - self._half_weight
            self._force_squares[foot] += deviation * deviation


class WalkMetrics:
    """Running figures over ticks; memory does not grow with the run.

    Attributes:
        distance: horizontal distance of the soles' midpoint from its start [m].
        touchdown_peak: largest normal force of a touchdown, left and right [N].
    """

    def __init__(self, *, period_s: float) -> None:
        """Start at the robot's present place."""
        self._airborne = AIRBORNE_S / period_s
        self._touchdown = round(TOUCHDOWN_S / period_s)
        self._begin: tuple[float, float] | None = None
        self._off = [0, 0]
        self._since = [self._touchdown, self._touchdown]
        self.distance = 0.0
        self.touchdown_peak = [0.0, 0.0]

    def update(self, state: PlantTruth | PlantView) -> None:
        """Add one tick; each tick once."""
        left_x, left_y, _ = state.sole_left.tolist()
        right_x, right_y, _ = state.sole_right.tolist()
        x, y = 0.5 * (left_x + right_x), 0.5 * (left_y + right_y)
        begin = self._begin = self._begin or (x, y)
        self.distance = math.hypot(x - begin[0], y - begin[1])
        for foot, force in enumerate(state.normal_forces):
            self._since[foot] += 1
            if force < CONTACT_LOST_N:
                self._off[foot] += 1
                continue
            if self._off[foot] > self._airborne:
                self._since[foot] = 0
            self._off[foot] = 0
            if self._since[foot] < self._touchdown:
                peak = max(self.touchdown_peak[foot], force)
                self.touchdown_peak[foot] = peak


def _com_over_soles(state: PlantTruth | PlantView) -> tuple[float, float, float]:
    """Return the CoM: x and y from the midpoint of the soles, z in the world [m]."""
    # Plain floats are faster than arrays for three numbers.
    x, y, z = state.com.tolist()
    left_x, left_y, _ = state.sole_left.tolist()
    right_x, right_y, _ = state.sole_right.tolist()
    return x - 0.5 * (left_x + right_x), y - 0.5 * (left_y + right_y), z


def _first_tick(time_s: float, period_s: float) -> int:
    return math.ceil(time_s / period_s - _TIME_TOLERANCE)


class Fall(NamedTuple):
    """A fall and the criterion that showed it.

    Attributes:
        criterion: the criterion.
        detail: the same in words, with the link or the figure.
    """

    criterion: FallCriterion
    detail: str


class FallDetector:
    """Detects a fall by comparing the robot with its stance at the start."""

    def __init__(self, view: PlantView) -> None:
        """Take the present height as the standing height."""
        self._view = view
        base, left, right, *_ = view.heights()
        self._standing_height = base - 0.5 * (left + right)
        self._least_height = FALL_HEIGHT_RATIO * self._standing_height

    def check(self) -> bool:
        """Return whether the robot is low, leans or touches down with a link."""
        base, left, right, *links = self._view.heights()
        # A state that is not a number fails one of these: that is a fall, too.
        standing = (
            self._view.upright > _UPRIGHT
            and base - 0.5 * (left + right) > self._least_height
            and min(links) > min(left, right) + FALL_CLEARANCE_M
        )
        return not standing

    def diagnose(self) -> Fall:
        """Return the criterion of a fall that :meth:`check` has found."""
        base, left, right, *links = self._view.heights()
        upright, height = self._view.upright, base - 0.5 * (left + right)
        if not math.isfinite(upright + sum(links) + height):
            return Fall(FallCriterion.NOT_FINITE, "the state is not a number any more")
        if min(links) <= min(left, right) + FALL_CLEARANCE_M:
            name = self._view.upper_names[int(np.argmin(links))]
            return Fall(FallCriterion.TOUCH, f"{name} is down at the soles")
        if height <= self._least_height:
            share = 100.0 * height / self._standing_height
            detail = f"the base is at {share:.0f} % of its height over the soles"
            return Fall(FallCriterion.HEIGHT, detail)
        angle = math.degrees(math.acos(min(max(upright, -1.0), 1.0)))
        return Fall(FallCriterion.TILT, f"the base leans by {angle:.0f} deg")


SENSED = (
    *("q", "dq", "effort", "q_command"),
    *("quat_xyzw", "angular_velocity", "linear_acceleration", "ft_left", "ft_right"),
)
TRUE = (
    *("true_com", "true_com_velocity", "true_base_pose"),
    *("true_sole_left", "true_sole_right", "true_F"),
)
PLATFORM_POSE = "true_platform_pose"
BLOCK_ROWS = 64
"""Number of ticks hashed at a time; the digest does not depend on it."""


class RobotRecorder:
    """Records the signals of the robot's side of a run, tick by tick.

    They are its sensors, the command that its servos follow, and the true state.
    """

    def __init__(
        self, sink: TickSink, *, joints: Sequence[str], platforms: int, period_s: float
    ) -> None:
        """Begin."""
        names = [*SENSED, *TRUE, *([PLATFORM_POSE] if platforms else [])]
        layouts = [
            lay_out(name, joints=joints, platforms=platforms)
            for name in ("tick", "time_s", *names)
        ]
        self._recorder = TickRecorder(layouts, sink)
        self._period_s = period_s
        self._time_s = np.zeros(1)

    def add(self, truth: PlantTruth, snapshot: Snapshot, q_command: Array) -> None:
        """Record one tick; each tick once, in order."""
        self._time_s[0] = truth.tick * self._period_s
        platforms = [
            part
            for platform in truth.platforms
            for part in (platform.position, platform.quat_xyzw)
        ]
        self._recorder.add(
            truth.tick,
            (
                self._time_s,
                snapshot.q,
                snapshot.dq,
                snapshot.effort,
                q_command,
                snapshot.quat_xyzw,
                snapshot.angular_velocity,
                snapshot.linear_acceleration,
                snapshot.ft_left,
                snapshot.ft_right,
                truth.com,
                truth.com_velocity,
                truth.base_position,
                truth.base_quat_xyzw,
                truth.sole_left,
                truth.sole_right,
                truth.F_left,
                truth.F_right,
                *platforms,
            ),
        )


class RunDigest:
    """SHA-256 over the sensors and the command of every tick.

    Each tick adds, as little-endian float64, all readings in the order of the sensor
    table, then the posture commanded to the servos. Stamps and timings are left out.
    """

    def __init__(self, *, joints: int) -> None:
        """Start without ticks."""
        self._sha = hashlib.sha256()
        width = SnapshotLayout(joints).size + joints
        self._rows = np.empty((BLOCK_ROWS, width), dtype="<f8")
        self._count = 0

    def add(self, snapshot: Snapshot, q_command: Array) -> None:
        """Add one tick."""
        row = self._rows[self._count]
        np.concatenate((*readings(snapshot), q_command), out=row)
        self._count += 1
        if self._count == BLOCK_ROWS:
            self._sha.update(self._rows.data)
            self._count = 0

    def hexdigest(self) -> str:
        """Return the digest of all ticks so far."""
        whole = self._sha.copy()
        whole.update(self._rows[: self._count].data)
        return whole.hexdigest()
