"""The whole conformance run, with the checks of leases and refused commands.

It plays a stabilizer against a live robot and returns a report.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Collection

import numpy as np

from surefoot.robot_io.conformance.evidence import (
    ConformanceReport,
    Findings,
    RunBrokenOffError,
)
from surefoot.robot_io.conformance.message_checks import check_messages, check_values
from surefoot.robot_io.conformance.motion_checks import (
    check_estop,
    check_foot_order,
    check_joint_order,
    check_motion,
    check_watchdog,
    enable,
)
from surefoot.robot_io.conformance.probe import Probe, probing
from surefoot.robot_io.identity import PARTS
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.robot_side.mode_machine import Refusal
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import SCHEMA_VERSION, RobotMode
from surefoot.schemas.reasons import RequestRefusal

SECTIONS = ("sensors", "wiring", "refusals", "reactions")
LOOK_S = 1.0
INTRUDER = "someone-else"
OTHER_DESCRIPTION = "-".join(["0" * 8] * len(PARTS))
STATUS_RATE_HZ = 50.0
STATUS_LEAST_SHARE = 0.7
STATUS_LOOK_S = 0.5
LEFT_S = 2.0
FAR_TICKS = 1000
TRIES = 20
LEAST_REFUSED = 15
"""Least number of refused tries. A busy network may lose some; none may be followed."""
STREAM_S = 0.1
PATIENCE = 10
"""Streams within which a busy robot must have received and counted the bad commands."""
SAME_RAD = 1e-9


def check_conformance(
    robot: Robot,
    *,
    endpoints: Endpoints,
    sections: Collection[str] = SECTIONS,
    timeout_s: float = 10.0,
) -> ConformanceReport:
    """Check a live robot that stands on both feet, in HOLD, commanded by nobody.

    The run takes the lease, enables the robot, holds its posture and leaves it as it
    was. It asks no joint to move by more than 0.7 mrad, and only in ``wiring``. Limits
    on position, velocity and step are not tried: a robot without them would move. Lease
    and status are always checked.

    Args:
        robot: the robot of the files.
        endpoints: where to dial; with TLS, as a stabilizer.
        sections: further checks to run.
        timeout_s: longest wait for the robot's first answer [s].

    Returns:
        All findings.

    Raises:
        EndpointError: a locator is malformed.
        RobotUnreachableError: no robot is there.
        RobotMismatchError: the robot has another description, or there are two robots.
    """
    findings = Findings()
    identity = f"check-robot-{os.getpid()}"
    with probing(
        robot, endpoints=endpoints, identity=identity, timeout_s=timeout_s
    ) as probe:
        has_lease = False
        try:
            check_status(probe, findings)
            has_lease = True
            _try_all(probe, findings, sections)
        except RunBrokenOffError:
            pass
        finally:
            if has_lease:
                check_left(probe, findings)
        check_motion(probe, findings)
    return ConformanceReport(
        robot=robot.file.name,
        passed=all(finding.passed for finding in findings.all),
        findings=findings.all,
    )


def _try_all(probe: Probe, findings: Findings, sections: Collection[str]) -> None:
    check_lease(probe, findings)
    enable(probe, findings, "mode.enable")
    if "sensors" in sections:
        recording = probe.stream(LOOK_S)
        check_messages(probe.robot, recording, findings, status=probe.status)
        check_values(probe.robot, recording, probe.q_held, findings)
    if "wiring" in sections:
        check_joint_order(probe, findings)
        if probe.robot.file.virtual_ft is None:
            check_foot_order(probe, findings)
    if "refusals" in sections:
        check_refusals(probe, findings)
    if "reactions" in sections:
        check_watchdog(probe, findings)
        check_estop(probe, findings)


def check_status(probe: Probe, findings: Findings) -> None:
    """Check that status messages come in time and that the run may begin.

    Raises:
        RunBrokenOffError: the robot is off, in fault or commanded by someone else.
    """
    rate = probe.count_statuses(STATUS_LOOK_S) / STATUS_LOOK_S
    findings.add(
        "status.rate",
        rate > STATUS_LEAST_SHARE * STATUS_RATE_HZ and not probe.status_errors,
        got=f"{rate:.0f} Hz {probe.status_error}".strip(),
        expected=f"{STATUS_RATE_HZ:g} Hz, following the schema",
    )
    status = probe.status
    assert status is not None
    findings.need(
        "status.mode",
        status.mode is RobotMode.HOLD,
        got=f"{status.mode} {status.detail}".strip(),
        expected="hold, before anyone commands; reset a fault first",
    )
    findings.need(
        "status.commander",
        not status.commander,
        got=f"{status.commander or 'nobody'} commands",
        expected="nobody; stop who does first",
    )


def check_lease(probe: Probe, findings: Findings) -> None:
    """Take the lease, and try to bypass it as another commander.

    Raises:
        RunBrokenOffError: the robot does not give the lease.
    """
    without = probe.ask("mode", "enable")
    findings.add(
        "lease.needed",
        not without.accepted,
        got="enabled without a lease" if without.accepted else without.detail,
        expected="no mode without the lease",
    )
    other = probe.ask("lease", "take", description=OTHER_DESCRIPTION)
    findings.add(
        "lease.description",
        other.refusal is RequestRefusal.WRONG_ROBOT,
        got=other.detail or "commanded by another robot file than its own",
        expected="refused, naming what differs",
    )
    if other.accepted:
        probe.ask("lease", "release")
    taken = probe.ask("lease", "take")
    findings.need(
        "lease.take",
        taken.accepted,
        got=taken.detail or "taken",
        expected="a free lease goes to who asks",
    )
    second = probe.ask("lease", "take", who=INTRUDER)
    findings.add(
        "lease.second",
        second.refusal is RequestRefusal.LEASE,
        got=second.detail or "a second commander got it, too",
        expected=f"refused as {RequestRefusal.LEASE}: {probe.identity} holds it",
    )
    mode = probe.ask("mode", "enable", who=INTRUDER)
    findings.add(
        "lease.mode",
        not mode.accepted,
        got=mode.detail or "someone else enabled the robot",
        expected="only the holder changes the mode",
    )
    if second.accepted:
        probe.ask("lease", "release", who=INTRUDER)
        probe.ask("lease", "take")
    unknown = probe.ask("mode", "dance")
    findings.add(
        "mode.unknown",
        unknown.refusal is RequestRefusal.UNKNOWN_ACTION,
        got=unknown.detail or "accepted",
        expected=f"refused as {RequestRefusal.UNKNOWN_ACTION}",
    )


def check_left(probe: Probe, findings: Findings) -> None:
    """Leave the robot as it was found: in HOLD, free, without a fault caused by us."""
    is_left = _give_back(probe)
    why = probe.was_too_late
    if why:
        probe.ask("lease", "take")
        probe.ask("mode", "reset")
        is_left = _give_back(probe)
    commander = probe.status.commander if probe.status is not None else ""
    mode = probe.status.mode if probe.status is not None else "silent"
    findings.add(
        "left",
        is_left,
        got=f"{mode}, {commander or 'nobody'} commands"
        + (f", once reset ({why})" if why else ""),
        expected="hold, nobody commands, as at the start",
    )


def _give_back(probe: Probe) -> bool:
    """Hold and release; return whether the robot holds and nobody commands it."""
    probe.ask("mode", "hold")
    probe.ask("lease", "release")
    is_left = probe.wait_status(
        lambda s: s.mode is RobotMode.HOLD and not s.commander, timeout_s=LEFT_S
    )
    return is_left is not None


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
        tick = probe.tick
        probe.stream(STREAM_S, extra=next_bad)
        grown = _counts(probe) - before
        if sent == TRIES <= grown.total() or probe.tick == tick:
            break  # all are told of, or the robot has fallen silent
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
    """Check that no command is followed in HOLD, not even the commander's."""
    probe.ask("mode", "hold")
    before = _counts(probe)
    sent = 0

    def count_sent(count: int) -> None:
        nonlocal sent
        sent += 1

    for _ in range(PATIENCE):  # a busy machine sends few in one stream
        tick = probe.tick
        probe.stream(STREAM_S, extra=count_sent)
        if sent >= TRIES or probe.tick == tick:
            break
    refused = (_counts(probe) - before).total()
    mode = probe.status.mode if probe.status is not None else "silent"
    findings.add(
        "command.mode",
        refused >= LEAST_REFUSED and mode is RobotMode.HOLD,
        got=f"{sent} sent, {refused} refused in {mode}",
        expected="commands in hold are refused",
    )


def _counts(probe: Probe) -> Counter[str]:
    """Return the refusals so far, after all sent commands have been checked."""
    for _ in range(2):
        probe.wait_status(lambda status: True, timeout_s=STREAM_S)
    return Counter(probe.status.refused if probe.status is not None else {})
