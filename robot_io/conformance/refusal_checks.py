"""Bad commands: each one is refused and counted. None asks for a motion."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable

import numpy as np

from surefoot.robot_io.conformance.check_result import Findings
from surefoot.robot_io.conformance.lease_checks import INTRUDER
from surefoot.robot_io.conformance.probe import Probe
from surefoot.robot_io.robot_side.mode_machine import Refusal
from surefoot.schemas.messages import SCHEMA_VERSION, RobotMode

FAR_TICKS = 1000
TRIES = 20
LEAST_REFUSED = 15
"""Of the tries; a busy network may lose one, a robot must never follow one."""
STREAM_S = 0.1
PATIENCE = 10
"""Streams in which a busy robot may take in the bad commands, and count them."""
SAME_RAD = 1e-9


def check_refusals(probe: Probe, findings: Findings) -> None:
    """Send bad commands between good ones; the robot must be ACTIVE."""
    posture = probe.q_held.tolist()
    replayed = probe.command()
    bad: dict[str, Callable[[], bytes]] = {
        "malformed": lambda: b"\x00 no command \xff",
        "schema": lambda: probe.command(schema=SCHEMA_VERSION + 1),
        "lease": lambda: probe.command(commander=INTRUDER),
        "sequence": lambda: replayed,
        "late": lambda: probe.command(tick=max(0, probe.tick - FAR_TICKS)),
        "future": lambda: probe.command(tick=probe.tick + FAR_TICKS),
        "size": lambda: probe.command(q=posture[:-1]),
        "not_finite": lambda: probe.command(q=[math.nan, *posture[1:]]),
    }
    for name, make in bad.items():
        _check_one(probe, name, make, findings)
    _check_held(probe, findings)


def _check_one(
    probe: Probe, name: str, make: Callable[[], bytes], findings: Findings
) -> None:
    before, errors = _counts(probe), probe.status_errors
    sent = 0

    def next_bad(count: int) -> bytes | None:
        nonlocal sent
        if sent == TRIES:
            return None
        sent += 1
        return make()

    grown: Counter[str] = Counter()
    for _ in range(PATIENCE):
        probe.stream(STREAM_S, extra=next_bad)
        grown = _counts(probe) - before
        if sent == TRIES <= grown.total():
            break
    if name != Refusal.LATE:  # a busy machine answers late by itself
        del grown[Refusal.LATE]
    refused = sum(grown.values())
    status = probe.status
    followed = (
        probe.status_errors > errors
        or status is None
        or np.abs(np.array(status.q_command) - probe.q_held).max() > SAME_RAD
    )
    reasons = ", ".join(f"{reason} {count}" for reason, count in grown.items())
    findings.add(
        f"command.{name}",
        refused >= LEAST_REFUSED and not followed,
        got=f"{sent} sent, {reasons or 'none'} refused"
        + (", and the robot follows something else" if followed else ""),
        expected="all refused and counted on status, the posture kept",
    )


def _check_held(probe: Probe, findings: Findings) -> None:
    """Check that in HOLD no command is followed, not even the commander's."""
    probe.ask("mode", "hold")
    before = _counts(probe)
    probe.stream(STREAM_S)
    refused = (_counts(probe) - before).total()
    mode = probe.status.mode if probe.status is not None else "silent"
    findings.add(
        "command.mode",
        refused >= LEAST_REFUSED and mode is RobotMode.HOLD,
        got=f"{refused} refused in {mode}",
        expected="commands in hold are refused",
    )


def _counts(probe: Probe) -> Counter[str]:
    """Return the refusals so far, once all that was sent has been checked."""
    for _ in range(2):
        probe.wait_status(lambda status: True, timeout_s=STREAM_S)
    return Counter(probe.status.refused if probe.status is not None else {})
