"""Silence of the commander and the e-stop: how soon the robot reacts."""

from __future__ import annotations

import time

from surefoot.robot_io.conformance.check_result import Findings
from surefoot.robot_io.conformance.probe import Probe
from surefoot.schemas.messages import RobotMode

TOLERANCE_S = 0.15
"""For the way of a status, and for ticks of a busy machine."""
FAULT_TOLERANCE = 1.3
STOP_S = 0.1
STREAM_S = 0.2
MS_PER_S = 1e3


def check_watchdog(probe: Probe, findings: Findings) -> None:
    """Enable, fall silent and wait; leave the robot in HOLD, the lease ours.

    Raises:
        RunBrokenOffError: the robot cannot be brought back.
    """
    gate = probe.robot.file.gate
    _enable(probe, findings, "watchdog.enable")
    begin_s = time.monotonic()
    held_s = probe.wait_status(
        lambda s: s.mode is not RobotMode.ACTIVE,
        timeout_s=gate.hold_after_s + 4.0 * TOLERANCE_S,
    )
    findings.add(
        "watchdog.hold",
        held_s is not None and held_s < gate.hold_after_s + TOLERANCE_S,
        got=_reaction(held_s, "stays active"),
        expected=f"not active any more after {gate.hold_after_s * MS_PER_S:g} ms "
        f"without a command (+ {TOLERANCE_S * MS_PER_S:g} ms)",
    )
    limit_s = FAULT_TOLERANCE * gate.fault_after_s + TOLERANCE_S
    is_fault = (
        held_s is not None
        and probe.wait_status(
            lambda s: s.mode is RobotMode.FAULT, timeout_s=limit_s - held_s
        )
        is not None
    )
    fault_s = time.monotonic() - begin_s
    findings.add(
        "watchdog.fault",
        is_fault,
        got=_reaction(fault_s if is_fault else None, "no fault"),
        expected=f"fault after {gate.fault_after_s:g} s of silence",
    )
    _recover(probe, findings, "watchdog.reset")


def check_estop(probe: Probe, findings: Findings) -> None:
    """Stop the robot without a lease in the asker's name; leaves it in HOLD.

    Raises:
        RunBrokenOffError: the robot cannot be brought back.
    """
    _enable(probe, findings, "estop.enable")
    begin_s = time.monotonic()
    stopped = probe.ask("estop", "", who="a-bystander")
    is_fault = probe.is_mode(RobotMode.FAULT, timeout_s=STOP_S)
    took_s = time.monotonic() - begin_s
    findings.add(
        "estop.reaction",
        stopped.accepted and is_fault and took_s < STOP_S + TOLERANCE_S,
        got=stopped.detail or _reaction(took_s if is_fault else None, "no fault"),
        expected=f"fault within {(STOP_S + TOLERANCE_S) * MS_PER_S:g} ms, for anyone",
    )
    again = probe.ask("mode", "enable")
    probe.stream(STREAM_S)
    mode = probe.status.mode if probe.status is not None else "silent"
    findings.add(
        "estop.latched",
        not again.accepted and mode is RobotMode.FAULT,
        got=f"{again.detail or 'enabled'}; {mode}",
        expected="neither enabling nor commanding leaves the fault",
    )
    _recover(probe, findings, "estop.reset")


def _enable(probe: Probe, findings: Findings, name: str) -> None:
    enabled = probe.start()
    follows = probe.stream_until_active()
    mode = probe.status.mode if probe.status is not None else "silent"
    findings.need(
        name,
        enabled.accepted and follows,
        got=enabled.detail or str(mode),
        expected="active",
    )


def _recover(probe: Probe, findings: Findings, name: str) -> None:
    """Take the lease, if it was lost, and reset the fault that was provoked."""
    taken = probe.ask("lease", "take")
    status = probe.status
    if status is not None and status.mode is RobotMode.FAULT:
        answer = probe.ask("mode", "reset")
    else:
        answer = probe.ask("mode", "hold")
    is_held = probe.is_mode(RobotMode.HOLD)
    findings.need(
        name,
        taken.accepted and answer.accepted and is_held,
        got=taken.detail or answer.detail or ("hold" if is_held else "no hold"),
        expected="hold again, once the holder of the lease resets",
    )


def _reaction(took_s: float | None, otherwise: str) -> str:
    return otherwise if took_s is None else f"after {took_s * MS_PER_S:.0f} ms"
