"""Reports of a stabilizer: signals of each tick, status messages, and its result."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from surefoot.robot_io.realtime import RecentTimes, TimingLog
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.ticks.recorder import TickRecorder, TickSink
from surefoot.schemas.arrays import MS_PER_NS, NS_PER_S, Array
from surefoot.schemas.messages import SCHEMA_VERSION, StabilizerStatus
from surefoot.schemas.reasons import EndReason, SensorTrouble, StabilizerState
from surefoot.schemas.result import NO_TIME, ControllerResult
from surefoot.schemas.signals import MISSING, QP_WORDS, WALK_SIGNALS, lay_out
from surefoot.stabilizer.controller import ControllerOutput
from surefoot.stabilizer.walking.feet import FootState, WalkState
from surefoot.stabilizer.walking.gait import Phase

_ARRAYS = (
    *("F_id", "F_meas", "base_pose", "base_twist"),
    *("com", "com_reference", "r", "v_joint"),
)
_PHASES, _FOOT_STATES = list(Phase), list(FootState)
_NUMBERS = ("in_contact", "wrench_qp", "motion_qp", "controller_ms")
_OTHER = len(QP_WORDS) - 1
_QP_NUMBERS = {word: number for number, word in enumerate(QP_WORDS)}
_NO_CONTACTS = (MISSING, MISSING)
TICKS_IN_STATUS = 1024
TIMING_EVERY_STATUSES = 25
"""Ticks between percentiles in a status: they take as long as a small QP."""
SETTLED_S = 1.0
"""Time from which force errors count, as in the robot's own figures [s]."""
F_Z = 2
WRENCH = 6
GOOD = "ok"


class ControllerRecorder:
    """Records a controller's answers; missing quantities are left out."""

    def __init__(
        self,
        sink: TickSink,
        *,
        joints: Sequence[str],
        period_s: float,
        walks: bool = False,
    ) -> None:
        """Begin."""
        names = (*_ARRAYS, *WALK_SIGNALS) if walks else _ARRAYS
        self._walks = walks
        arrays = [lay_out(name, joints=joints) for name in names]
        others = [lay_out(name, joints=joints) for name in _NUMBERS]
        clock = [lay_out(name, joints=joints) for name in ("tick", "time_s")]
        self._recorder = TickRecorder([*clock, *arrays, *others], sink)
        self._nothing = [np.full(len(x.labels), x.missing) for x in arrays]
        self._period_s = period_s
        self._time_s = np.zeros(1)
        self._numbers = np.zeros(sum(len(x.labels) for x in others))

    def add(self, tick: int, output: ControllerOutput, *, duration_ns: int) -> None:
        """Record an answer."""
        self._time_s[0] = tick * self._period_s
        left, right = output.in_contact or _NO_CONTACTS
        self._numbers[:] = (
            left,
            right,
            _QP_NUMBERS.get(output.wrench_qp, _OTHER),
            _QP_NUMBERS.get(output.motion_qp, _OTHER),
            duration_ns * MS_PER_NS,
        )
        told: tuple[Array | None, ...] = (
            output.F_id,
            output.F_meas,
            output.base_pose,
            output.base_twist,
            output.com,
            output.com_reference,
            output.r,
            output.v_joint,
        )
        if self._walks:
            told += _of_walk(output.walk)
        parts = [
            nothing if values is None else values
            for values, nothing in zip(told, self._nothing, strict=True)
        ]
        self._recorder.add(tick, (self._time_s, *parts, self._numbers))


def _of_walk(walk: WalkState | None) -> tuple[Array | None, ...]:
    """Return the signals that a walk adds."""
    if walk is None:
        return (None,) * len(WALK_SIGNALS)
    phase = _PHASES.index(walk.phase)
    left, right = (_FOOT_STATES.index(state) for state in walk.feet)
    return (
        np.array(walk.dcm),
        np.array(walk.dcm_reference),
        np.array(walk.zmp_reference),
        np.array(walk.footholds),
        np.array(walk.goals),
        np.array((phase,)),
        np.array((left, right)),
    )


def recorder_to(
    sink: TickSink | None, robot: Robot, *, walks: bool = False
) -> ControllerRecorder | None:
    """Return a recorder for a robot's controller; None without a sink."""
    if sink is None:
        return None
    return ControllerRecorder(
        sink, joints=robot.joint_names, period_s=robot.period_s, walks=walks
    )


class ControllerTelemetry:
    """Counts and times a controller's ticks, on the bus and in one process alike."""

    def __init__(
        self,
        controller_name: str,
        *,
        period_s: float,
        calibration_s: float = 0.0,
        recorder: ControllerRecorder | None = None,
    ) -> None:
        """Start empty.

        Args:
            controller_name: name in the status.
            period_s: time between two ticks of the robot [s].
            calibration_s: time after a start from which ticks count as balancing [s].
            recorder: records every answer; None for a run that keeps none.
        """
        self._recorder = recorder
        self._name = controller_name
        self._settled_ticks = SETTLED_S / period_s
        self._durations = TimingLog()
        self._recent = RecentTimes(TICKS_IN_STATUS)
        self._recent_ms = NO_TIME
        self._ticks = self._qp_failures = self._stale = self._statuses = 0
        self._skipped = self._slow = 0
        self._period_ns = round(period_s * NS_PER_S)
        self.restarts = 0
        self._calibration_ticks = round(calibration_s / period_s)
        self._since_start = 0
        self._balancing = self._balancing_failures = 0
        self._state, self._end = StabilizerState.ACTIVE, EndReason.NONE
        self._detail = ""
        self._lost: dict[str, SensorTrouble] = {}
        self._degraded = 0
        self._squares_left = self._squares_right = 0.0
        self._settled = 0
        self._walk: WalkState | None = None

    @property
    def has_walked(self) -> bool:
        """Whether a controller has reported a walk; other code relies on it."""
        return self._walk is not None

    def begin(self) -> None:
        """Note that a controller starts."""
        self._since_start = 0

    def add(
        self,
        output: ControllerOutput,
        *,
        tick: int,
        duration_ns: int,
        is_stale: bool,
        skipped: int = 0,
    ) -> None:
        """Add a tick; it is stale if a sensor's message was missing.

        ``skipped`` ticks of the robot since the last answer have had none.
        """
        if self._recorder is not None:
            self._recorder.add(tick, output, duration_ns=duration_ns)
        self._skipped += skipped
        self._slow += duration_ns > self._period_ns
        self._durations.add(duration_ns)
        self._recent.add(duration_ns)
        self._ticks += 1
        self._stale += is_stale
        is_failure = output.qp_status != GOOD
        self._qp_failures += is_failure
        self._since_start += 1
        if self._since_start > self._calibration_ticks:
            self._balancing += 1
            self._balancing_failures += is_failure
        self._walk = output.walk or self._walk
        wanted, measured = output.F_id, output.F_meas
        if (
            self._ticks > self._settled_ticks
            and wanted is not None
            and measured is not None
        ):
            left = float(measured[F_Z] - wanted[F_Z])
            right = float(measured[WRENCH + F_Z] - wanted[WRENCH + F_Z])
            self._squares_left += left * left
            self._squares_right += right * right
            self._settled += 1

    def note(
        self,
        state: StabilizerState,
        end: EndReason,
        detail: str,
        *,
        lost: dict[str, SensorTrouble],
    ) -> None:
        """Note the state of the safety layer, once per tick."""
        self._state, self._end, self._detail = state, end, detail
        if lost:
            self._lost = {**lost, **self._lost}
        self._degraded += state is not StabilizerState.ACTIVE

    def status(
        self,
        output: ControllerOutput,
        *,
        tick: int,
        stamp_ns: int,
        stale: tuple[str, ...],
        lost: dict[str, SensorTrouble],
    ) -> StabilizerStatus:
        """Make the status message of the present tick."""
        if self._statuses % TIMING_EVERY_STATUSES == 0:
            self._recent_ms = self._recent.distribution()
        self._statuses += 1
        state, detail = self._state, self._detail
        if state is StabilizerState.ACTIVE:
            state, detail = _state(output, stale)
        F_id, F_meas = _numbers(output.F_id, 12), _numbers(output.F_meas, 12)
        return StabilizerStatus(
            schema=SCHEMA_VERSION,
            tick=tick,
            stamp_ns=stamp_ns,
            controller=self._name,
            state=state,
            end=self._end,
            lost_sensors=lost,
            detail=detail,
            com=_numbers(output.com, 3),
            com_reference=_numbers(output.com_reference, 3),
            F_id_left=F_id[:WRENCH],
            F_id_right=F_id[WRENCH:],
            F_meas_left=F_meas[:WRENCH],
            F_meas_right=F_meas[WRENCH:],
            in_contact=list(output.in_contact or (True, True)),
            qp_status=output.qp_status,
            tick_median_ms=self._recent_ms.median,
            tick_p99_ms=self._recent_ms.p99,
            tick_max_ms=self._recent_ms.max,
        )

    def result(
        self, end: EndReason, detail: str, *, histogram: bool = False
    ) -> ControllerResult:
        """Return the result of the whole run."""
        ticks = {"controller tick": self._durations} if histogram else {}
        squares = (self._squares_left, self._squares_right)
        return ControllerResult(
            ticks=self._ticks,
            tick_ms=self._durations.distribution(),
            force_error_rms_n=[math.sqrt(x / self._settled) for x in squares]
            if self._settled
            else None,
            qp_failures=self._qp_failures,
            stale_snapshots=self._stale,
            lost_sensors=self._lost,
            balancing_ticks=self._balancing,
            balancing_failures=self._balancing_failures,
            end=end,
            end_detail=detail,
            degraded_ticks=self._degraded,
            skipped_ticks=self._skipped,
            slow_ticks=self._slow,
            restarts=self.restarts,
            histograms={name: log.histogram() for name, log in ticks.items()},
            walk=None if self._walk is None else self._walk.report(),
        )


def _numbers(values: Array | None, size: int) -> list[float]:
    """Return an array of the output for a message; zeros if there is none."""
    return [0.0] * size if values is None else values.tolist()


def _state(
    output: ControllerOutput, stale: tuple[str, ...]
) -> tuple[StabilizerState, str]:
    """Return the state of a controller without losses, and its reason."""
    if output.qp_status != GOOD:
        return StabilizerState.UNSOLVED, f"QP failed: {output.qp_status}"
    if stale:
        return StabilizerState.DEGRADED, f"no news from {', '.join(stale)}"
    return StabilizerState.ACTIVE, ""
