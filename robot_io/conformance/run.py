"""The whole conformance run."""

from __future__ import annotations

import os
from collections.abc import Collection

from surefoot.robot_io.conformance.lease_checks import (
    check_enabling,
    check_lease,
    check_left,
    check_refusals,
    check_status,
)
from surefoot.robot_io.conformance.message_checks import check_messages, check_values
from surefoot.robot_io.conformance.motion_checks import (
    check_estop,
    check_foot_order,
    check_joint_order,
    check_motion,
    check_watchdog,
)
from surefoot.robot_io.conformance.probe import Probe, probing
from surefoot.robot_io.conformance.skeleton import (
    ConformanceReport,
    Findings,
    RunBrokenOffError,
)
from surefoot.robot_io.robot import Robot
from surefoot.schemas.endpoints import Endpoints

SECTIONS = ("sensors", "wiring", "refusals", "reactions")
LOOK_S = 1.0


def check_conformance(
    robot: Robot,
    *,
    endpoints: Endpoints,
    sections: Collection[str] = SECTIONS,
    timeout_s: float = 10.0,
) -> ConformanceReport:
    """Try a live robot that stands on both feet, in HOLD, commanded by nobody.

    It takes the lease, enables the robot, has it hold its posture and gives it back as
    it was. No joint is asked to move by more than 0.7 mrad, and only in ``wiring``.
    Limits on position, velocity and step are not tried: a robot that lacked them would
    move. Lease and status are always checked.

    Args:
        robot: what its files say.
        endpoints: where to dial; with TLS, as a stabilizer.
        sections: what to try besides.
        timeout_s: how long the robot may take to answer at first [s].

    Returns:
        What was found.

    Raises:
        EndpointError: a locator is malformed.
        RobotUnreachableError: no robot there.
        RobotMismatchError: the robot there has another description, or there are two.
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
    check_enabling(probe, findings)
    if "sensors" in sections:
        recording = probe.stream(LOOK_S)
        check_messages(probe.robot, recording, findings)
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
