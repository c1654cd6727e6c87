"""One commander at a time, by name."""

from __future__ import annotations

from surefoot.robot_io.conformance.check_result import Findings
from surefoot.robot_io.conformance.probe import Probe
from surefoot.robot_io.identity import PARTS
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import RequestRefusal

INTRUDER = "someone-else"
OTHER_DESCRIPTION = "-".join(["0" * 8] * len(PARTS))
STATUS_RATE_HZ = 50.0
STATUS_LEAST_SHARE = 0.7
STATUS_LOOK_S = 0.5
LEFT_S = 2.0


def check_status(probe: Probe, findings: Findings) -> None:
    """Check that status comes in time and allows the run.

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
    """Take the lease, and try to get past it as someone else.

    Raises:
        RunBrokenOffError: the lease cannot be had.
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


def check_enabling(probe: Probe, findings: Findings) -> None:
    """Enable the robot.

    Raises:
        RunBrokenOffError: it does not follow.
    """
    enabled = probe.start()
    follows = probe.stream_until_active()
    mode = probe.status.mode if probe.status is not None else "silent"
    findings.need(
        "mode.enable",
        enabled.accepted and follows,
        got=enabled.detail or str(mode),
        expected="active, once the holder of the lease asks",
    )


def check_left(probe: Probe, findings: Findings) -> None:
    """Leave the robot as it was found: in HOLD, free, without a fault."""
    probe.ask("mode", "hold")
    probe.ask("lease", "release")
    is_left = probe.wait_status(
        lambda s: s.mode is RobotMode.HOLD and not s.commander, timeout_s=LEFT_S
    )
    commander = probe.status.commander if probe.status is not None else ""
    mode = probe.status.mode if probe.status is not None else "silent"
    findings.add(
        "left",
        is_left is not None,
        got=f"{mode}, {commander or 'nobody'} commands",
        expected="hold, nobody commands, as at the start",
    )
