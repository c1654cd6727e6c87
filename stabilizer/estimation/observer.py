"""Observer: from raw sensors to the state that a controller works with.

Ages count from the newest reading of the same snapshot, by the stamps of measuring. A
delay that all sensors share cannot be seen here; it is part of ``dik.loop_delay_s``.

Every controller has an observer, so that all see the same robot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array, Mat
from surefoot.schemas.messages import ForceTorque
from surefoot.schemas.reasons import SensorTrouble
from surefoot.schemas.sensors import SENSORS
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.dynamics import NORMAL, SOLE_ROWS
from surefoot.stabilizer.estimation.contact import Anchors, ContactMonitor
from surefoot.stabilizer.estimation.estimator import Estimator
from surefoot.stabilizer.estimation.wrenches import WrenchCompensation
from surefoot.stabilizer.model import GRAVITY, RobotModel

WINDOW_S = 0.1
"""Time over which ages are gathered: longer than the period of a slow sensor [s]."""
FORGOTTEN_WINDOWS = 10
"""Number of such windows for which a larger age counts on."""
NS_PER_S = 1e9

FORCES = tuple(
    index for index, entry in enumerate(SENSORS) if entry.message is ForceTorque
)
MOTION = tuple(index for index in range(len(SENSORS)) if index not in FORCES)
AT_REST, NO_OFFSETS = (0.0, 0.0), (0.0, 0.0)
"""Ground acceleration [m/s^2] and force offsets [N] of an estimator that knows none."""
HURRIED_S = 0.1
"""Time after which calibration may end early on fast turning ground [s]."""


class ReadingAges:
    """Recent ages of readings: largest of the forces, mean of the others.

    Attributes:
        forces_s: largest age of any force reading in the last second [s].
        motion_s: mean age of the oldest of the other readings [s].
    """

    def __init__(self, *, period_s: float) -> None:
        """Begin with age zero."""
        self._ticks = max(1, round(WINDOW_S / period_s))
        self._largest = [0.0] * FORGOTTEN_WINDOWS
        self._count, self._sum = 0, 0.0
        self.forces_s = 0.0
        self.motion_s = 0.0

    def add(self, snapshot: Snapshot) -> bool:
        """Note the ages of a tick's readings.

        Returns:
            Whether the result has changed.
        """
        measured = snapshot.measured_ns
        newest = max(measured)
        forces_s = (newest - min([measured[index] for index in FORCES])) / NS_PER_S
        motion_s = (newest - min([measured[index] for index in MOTION])) / NS_PER_S
        self._sum += motion_s
        self._count += 1
        self._largest[-1] = max(self._largest[-1], forces_s)
        is_older = forces_s > self.forces_s
        if is_older:
            self.forces_s = forces_s
        if self._count < self._ticks:
            return is_older
        self.forces_s = max(self._largest)
        self.motion_s = self._sum / self._count
        self._largest = [*self._largest[1:], 0.0]
        self._count, self._sum = 0, 0.0
        return True


class StateEstimator(Protocol):
    """Estimates base and joints; :class:`Estimator` is one.

    What else of :class:`Estimator` it has is used, too: ``anchors`` (without them no
    steps are taken), ``ground_acceleration``, ``force_offsets``, ``pass_over``,
    ``doubt`` and ``gyro_is_off``.

    Attributes:
        q: (7 + n_a,) configuration in the stance frame, joints in model order.
        v: (6 + n_a,) velocity, base twist in base first.
        R_world_base: (3, 3) base rotation.
        ground_height: height of the ground between the soles, from nominal [m].
    """

    q: Array
    v: Array
    R_world_base: Mat
    ground_height: float

    def calibrate(self, snapshot: Snapshot, *, wrenches: Array | None) -> bool | None:
        """Take one reading of a robot that keeps its posture.

        Args:
            snapshot: reading of all sensors.
            wrenches: (12,) last measured wrenches of the ground on left and right sole,
                sole frames; None before the first, or with a sensor left out [N, N m].

        Returns:
            Whether the robot should be held no longer than it must.
        """

    def update(self, snapshot: Snapshot, *, wrenches: Array | None) -> None:
        """Advance by one tick."""


class SoleKinematics(Protocol):
    """Kinematics that a controller computes anyway, with the soles' rotations.

    Attributes:
        R_world_sole: rotation of left and right sole.
    """

    R_world_sole: list[Mat]

    def update(self, q: Array, v: Array) -> None:
        """Compute everything at a state.

        Args:
            q: (7 + n_a,) configuration.
            v: (n_v,) velocity, base twist in base first.
        """


@dataclass(slots=True)
class ObservedState:
    """State by the observer. Reused by the next tick: copy what you keep.

    Attributes:
        q: (7 + n_a,) configuration in the stance frame, joints in model order.
        v: (6 + n_a,) velocity, base twist in base first.
        R_world_base: (3, 3) base rotation.
        ground_height: height of the ground between the soles, from nominal [m].
        ground_acceleration: (2,) horizontal acceleration of the ground, world axes
            [m/s^2].
        F_meas: (12,) measured wrenches of the ground on left and right sole, sole
            frames [N, N m].
        in_contact: whether left and right foot stand.
        allowed: (2,) largest normal force to ask of each foot [N].
        is_calibrating: whether tilt and gyroscope bias are still being measured.
        active_s: time since the end of calibration, negative until then [s].
    """

    q: Array
    v: Array
    R_world_base: Mat
    ground_height: float
    ground_acceleration: Sequence[float]
    F_meas: Array
    in_contact: list[bool]
    allowed: Array
    is_calibrating: bool
    active_s: float


class Observer:
    """Estimator, sole wrenches and contacts of one robot, from start to end of a run.

    Attributes:
        estimator: estimates base and joints.
        wrenches: takes off the weight below the ankle sensors.
        contacts: decides which feet stand.
        state: state at the last tick.
        lost: whether the left and the right ankle sensor are left out.
    """

    def __init__(
        self,
        model: RobotModel,
        settings: ControllerSettings,
        kinematics: SoleKinematics,
        *,
        largest_force: float,
        period_s: float,
        estimator: StateEstimator | None = None,
    ) -> None:
        """Allocate everything; begin with :meth:`start`.

        Args:
            model: the robot.
            settings: settings of estimator and contacts.
            kinematics: updated at every tick, as soon as the state is known.
            largest_force: normal force to be asked of a foot that stands [N].
            period_s: time between two ticks [s].
            estimator: used in place of the project's own.
        """
        self._dt = period_s
        self._calibration_s = settings.estimator.calibration_s
        self._since_start_s = 0.0
        self._kinematics = kinematics
        self.estimator: StateEstimator = estimator or Estimator(
            model, settings.estimator, period_s=period_s
        )
        self.wrenches = WrenchCompensation(model)
        self.contacts = ContactMonitor(
            settings.contact, largest_force=largest_force, period_s=period_s
        )
        self._weight = model.mass * GRAVITY
        self._measured: Array | None = None
        self._reported: Array = np.zeros(12)
        self.lost = (False, False)
        self._doubt = ""
        self._instead: Array = np.zeros(12)
        self.state = ObservedState(
            q=self.estimator.q,
            v=self.estimator.v,
            R_world_base=self.estimator.R_world_base,
            ground_height=self.estimator.ground_height,
            ground_acceleration=AT_REST,
            F_meas=self.wrenches.F_meas,
            in_contact=self.contacts.in_contact,
            allowed=self.contacts.allowed,
            is_calibrating=True,
            active_s=-self._calibration_s,
        )

    @property
    def imu_trouble(self) -> tuple[SensorTrouble | None, str]:
        """What is wrong with the IMU, and why in words."""
        if self._doubt:
            return SensorTrouble.INCONSISTENT, self._doubt
        is_off = getattr(self.estimator, "gyro_is_off", False)
        return SensorTrouble.OFFSET if is_off else None, ""

    @property
    def anchors(self) -> Anchors | None:
        """Places where the feet were set down; None if the estimator knows no steps."""
        return getattr(self.estimator, "anchors", None)

    def start(self, snapshot: Snapshot) -> None:
        """Begin on a robot that stands still, once."""
        self.estimator.calibrate(snapshot, wrenches=None)

    def update(self, snapshot: Snapshot) -> ObservedState | None:
        """Advance by one tick.

        Returns:
            The robot's state, the same object every time. None when a reading is not
            finite; then nothing has changed.
        """
        if not _is_finite(snapshot):
            return None
        state, estimator, kinematics = self.state, self.estimator, self._kinematics
        if self._is_calibrating():
            self._calibrate(snapshot)
        else:
            estimator.update(snapshot, wrenches=self._measured)
        state.q, state.v = estimator.q, estimator.v
        state.R_world_base = estimator.R_world_base
        state.ground_height = estimator.ground_height
        state.ground_acceleration = getattr(estimator, "ground_acceleration", AT_REST)
        kinematics.update(state.q, state.v)
        F_meas = self.wrenches.update(
            snapshot.ft_left, snapshot.ft_right, kinematics.R_world_sole
        )
        self._measured = F_meas
        offsets = getattr(estimator, "force_offsets", NO_OFFSETS)
        if any(offsets):
            self._measured = self._reported
            self._reported[:] = F_meas
            F_meas[NORMAL::6] -= offsets
        if any(self.lost):
            self._assume(F_meas)
            self._measured = None
        self.contacts.update(F_meas.item(NORMAL), F_meas.item(6 + NORMAL))
        return state

    def pass_over(self, snapshot: Snapshot) -> ObservedState | None:
        """Take in a tick that gets no answer; it costs little.

        Only the motion is integrated. Kinematics, wrenches and contacts stay those of
        the last answered tick.

        Returns:
            As for :meth:`update`.
        """
        if not _is_finite(snapshot):
            return None
        estimator = self.estimator
        if self._is_calibrating():
            self._calibrate(snapshot)
        elif (pass_over := getattr(estimator, "pass_over", None)) is not None:
            pass_over(snapshot)
        else:
            estimator.update(snapshot, wrenches=self._measured)
        return self.state

    def _is_calibrating(self) -> bool:
        """Begin a tick; return whether tilt and bias are still being measured."""
        state, estimator = self.state, self.estimator
        was_calibrating = state.is_calibrating
        self._since_start_s += self._dt
        state.active_s = self._since_start_s - self._calibration_s
        state.is_calibrating = self._since_start_s < self._calibration_s
        if was_calibrating and not state.is_calibrating:
            self._doubt = getattr(estimator, "doubt", "")
        return state.is_calibrating

    def _calibrate(self, snapshot: Snapshot) -> None:
        hurries = self.estimator.calibrate(snapshot, wrenches=self._measured)
        if hurries and self._since_start_s > HURRIED_S:
            self._calibration_s = self._since_start_s

    def leave_out(self, lost: tuple[bool, bool], *, instead: Array) -> None:
        """Go on without ankle sensors.

        A foot without its sensor is assumed to feel its desired wrench, and to carry
        the load that the other one does not.

        Args:
            lost: whether the left and the right sensor are to be left out.
            instead: (12,) desired wrenches of the feet; read at every tick.
        """
        self.lost, self._instead = lost, instead

    def assume_wanted(self) -> None:
        """Set feet without a sensor to their desired wrench: no wrench error."""
        for side, rows in enumerate(SOLE_ROWS):
            if self.lost[side]:
                self.state.F_meas[rows] = self._instead[rows]

    def _assume(self, F_meas: Array) -> None:
        """Replace the wrenches that are not measured by assumed ones."""
        normals = (F_meas.item(NORMAL), F_meas.item(6 + NORMAL))
        self.assume_wanted()
        for side, rows in enumerate(SOLE_ROWS):
            if self.lost[side] and not self.lost[1 - side]:
                rest = self._weight - max(normals[1 - side], 0.0)
                F_meas[rows.start + NORMAL] = max(rest, 0.0)


def _is_finite(snapshot: Snapshot) -> bool:
    """Return whether all readings used are finite; sums of squares cannot cancel."""
    q, dq = snapshot.q, snapshot.dq
    gyro, accel = snapshot.angular_velocity, snapshot.linear_acceleration
    left, right = snapshot.ft_left, snapshot.ft_right
    total = q.dot(q) + dq.dot(dq) + gyro.dot(gyro) + accel.dot(accel)
    return math.isfinite(total + left.dot(left) + right.dot(right))
