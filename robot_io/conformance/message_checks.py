"""Do messages come as they should: form, rate, jitter, order, life."""

from __future__ import annotations

import numpy as np

from surefoot.robot_io.conformance.check_result import Findings
from surefoot.robot_io.conformance.probe import Recording
from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array
from surefoot.schemas.sensors import SENSORS, Sensor

RATE_TOLERANCE = 0.1
LOST_SHARE = 0.05
"""Ticks of which a message may be missing."""
JITTER_PERIODS = 0.5
"""Typical error of the period; the worst may reach the watchdog's patience."""
NS_PER_S = 1e9
MS_PER_S = 1e3


def check_messages(robot: Robot, recording: Recording, findings: Findings) -> None:
    """Check each channel by itself; needs a second of messages.

    Raises:
        RunBrokenOffError: a channel is silent, so nothing can be said of its values.
    """
    for entry in SENSORS:
        name = entry.name
        _check_form(name, recording, findings)
        ticks = recording.column(name, "tick")
        stamps_s = recording.column(name, "stamp_ns") / NS_PER_S
        _check_order(name, ticks, stamps_s, findings)
        _check_rate(robot, name, ticks, stamps_s, findings)
        if entry.side is None or robot.file.virtual_ft is None:
            _check_life(entry, recording, findings)
    _check_jitter(robot, recording, findings)


def _check_form(name: str, recording: Recording, findings: Findings) -> None:
    count, bad = len(recording.messages[name]), recording.malformed[name]
    why = f", {bad} unreadable: {recording.error[name]}" if bad else ""
    findings.need(
        f"{name}.format",
        count > 1 and not bad,
        got=f"{count} messages{why}",
        expected="messages that follow the schema, finite, one number per joint",
    )


def _check_order(name: str, ticks: Array, stamps_s: Array, findings: Findings) -> None:
    steps, gaps = np.diff(ticks), np.diff(stamps_s)
    findings.add(
        f"{name}.tick",
        bool((steps > 0).all()),
        got=f"steps of {steps.min()} to {steps.max()}",
        expected="counts up with every message",
    )
    findings.add(
        f"{name}.stamp",
        bool((gaps >= 0.0).all() and gaps.max() > 0.0),
        got=f"steps of {gaps.min() * MS_PER_S:.3f} to {gaps.max() * MS_PER_S:.3f} ms",
        expected="never goes back; a reading sent again keeps its stamp",
    )


def _check_rate(
    robot: Robot, name: str, ticks: Array, stamps_s: Array, findings: Findings
) -> None:
    wanted = robot.file.rate_hz
    span_s = max(float(stamps_s[-1] - stamps_s[0]), 1e-9)
    rate = (len(ticks) - 1) / span_s
    lost = 1.0 - len(ticks) / max(float(ticks[-1] - ticks[0]) + 1.0, float(len(ticks)))
    findings.add(
        f"{name}.rate",
        abs(rate / wanted - 1.0) < RATE_TOLERANCE and lost < LOST_SHARE,
        got=f"{rate:.1f} Hz, {lost:.1%} of the ticks missing",
        expected=f"{wanted:g} Hz, a message at every tick",
    )


def _check_life(entry: Sensor, recording: Recording, findings: Findings) -> None:
    name = entry.name
    values = np.hstack([recording.column(name, each) for each in entry.attributes])
    changing = np.ptp(values, axis=0) > 0.0
    findings.add(
        f"{name}.alive",
        bool(changing.any()),
        got=f"{changing.sum()} of {values.shape[1]} numbers change at all",
        expected="a sensor's last digits move; equal ones for a second are stuck",
    )


def _check_jitter(robot: Robot, recording: Recording, findings: Findings) -> None:
    stamps_s = recording.column("joints", "stamp_ns") / NS_PER_S
    ticks = recording.column("joints", "tick")
    period_s = robot.period_s
    errors = np.abs(np.diff(stamps_s) - np.diff(ticks) * period_s)
    median, p99 = np.quantile(errors, (0.5, 0.99))
    limit_s = robot.file.gate.hold_after_s
    findings.add(
        "joints.jitter",
        bool(median < JITTER_PERIODS * period_s and p99 < limit_s),
        got=f"median {median * MS_PER_S:.3f} ms, 99 % {p99 * MS_PER_S:.3f} ms",
        expected=f"below {JITTER_PERIODS * period_s * MS_PER_S:g} and "
        f"{limit_s * MS_PER_S:g} ms, the watchdog's patience",
    )
