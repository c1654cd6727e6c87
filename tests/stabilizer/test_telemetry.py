from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from surefoot.robot_io.robot import load_robot
from surefoot.schemas.codec import decode, encode
from surefoot.schemas.messages import StabilizerStatus
from surefoot.schemas.reasons import EndReason
from surefoot.stabilizer.controller import ControllerOutput, HoldController
from surefoot.stabilizer.telemetry import SETTLED_S, ControllerTelemetry
from tests.robot_io.sensor_messages import snapshot_at

PERIOD_S = 0.01
SETTLED_TICKS = round(SETTLED_S / PERIOD_S)


@pytest.fixture
def telemetry() -> ControllerTelemetry:
    return ControllerTelemetry("test", period_s=PERIOD_S)


def output(*, left_n: float = 0.0, right_n: float = 0.0) -> ControllerOutput:
    """Return an output whose measured normal forces differ from the desired ones."""
    wanted, measured = np.arange(12.0), np.arange(12.0)
    measured[2] += left_n
    measured[8] += right_n
    return ControllerOutput(
        q_command=np.zeros(28),
        F_id=wanted,
        F_meas=measured,
        com=np.array([0.0, 0.0, 0.9]),
        com_reference=np.array([0.0, 0.0, 1.0]),
        in_contact=(True, False),
    )


def test_force_errors_count_once_settled(telemetry: ControllerTelemetry) -> None:
    for _ in range(SETTLED_TICKS):
        telemetry.add(output(left_n=1e6), tick=0, duration_ns=1, is_stale=False)
    for left_n in (3.0, -4.0):
        each = output(left_n=left_n, right_n=2.0)
        telemetry.add(each, tick=0, duration_ns=1, is_stale=False)
    result = telemetry.result(EndReason.RUN_OVER, "")
    assert result.force_error_rms_n == pytest.approx([math.sqrt(12.5), 2.0])
    assert result.ticks == SETTLED_TICKS + 2


def test_a_run_too_short_to_settle_has_no_force_error(
    telemetry: ControllerTelemetry,
) -> None:
    telemetry.add(output(left_n=5.0), tick=0, duration_ns=1, is_stale=False)
    assert telemetry.result(EndReason.RUN_OVER, "").force_error_rms_n is None


def test_failures_and_stale_snapshots_are_counted(
    telemetry: ControllerTelemetry,
) -> None:
    good = output()
    bad = replace(good, wrench_qp="infeasible")
    for each, is_stale in ((good, False), (bad, True), (bad, False)):
        telemetry.add(each, tick=0, duration_ns=2_000_000, is_stale=is_stale)
    result = telemetry.result(EndReason.STOPPED, "why")
    assert (result.qp_failures, result.stale_snapshots) == (2, 1)
    assert result.tick_ms.max == pytest.approx(2.0)
    assert (result.end, result.end_detail) == (EndReason.STOPPED, "why")


def test_status_tells_both_feet_and_what_is_missing(
    telemetry: ControllerTelemetry,
) -> None:
    each = output(right_n=1.0)
    telemetry.add(each, tick=0, duration_ns=1_000_000, is_stale=True)
    status = telemetry.status(each, tick=5, stamp_ns=6, stale=("imu",), lost={})
    assert status.F_id_left + status.F_id_right == list(range(12))
    assert status.F_meas_right[2] == 9.0
    assert status.in_contact == [True, False]
    assert (status.state, status.detail) == ("degraded", "no news from imu")
    assert status.tick_median_ms == pytest.approx(1.0)
    assert decode(encode(status), StabilizerStatus) == status


def test_holding_means_the_posture_it_started_from() -> None:
    walker = load_robot("walker")
    controller = HoldController(walker.n_a)
    started_from = walker.nominal.copy()
    controller.start(snapshot_at(0), started_from)
    started_from += 1.0
    for tick in range(3):
        answer = controller.step(snapshot_at(tick))
        assert np.array_equal(answer.q_command, walker.nominal)
