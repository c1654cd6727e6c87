"""The conformance run passes a sound robot, and names the fault of a broken one."""

from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.robot_io.conformance.run import check_conformance
from surefoot.robot_io.realtime import Pace
from surefoot.robot_io.robot import load_robot
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.result import PlantResult
from surefoot.schemas.scenario import scenario_from_table
from surefoot.sim_robot.robot_loop import run_robot
from tests.awkward_robot import AWKWARD, make_awkward
from tests.command import Surefoot
from tests.nodes.processes import NOISE, running
from tests.patient_robot import JUDGED, judged_walker, patient_robot_file
from tests.robot_io.conformance import broken
from tests.robot_io.conformance.verdict import (
    OF_THE_MACHINE,
    check_passes_but_for_time,
)
from tests.support import PATIENCE_S

SENSOR_FAULTS = [
    (
        (broken.wrong_sign, broken.wxyz),
        {"left_ankle_ft.sign", "right_ankle_ft.sign", "feet.weight", "imu.attitude"},
    ),
    (
        (broken.dead_gyroscope, broken.imu_of_another_clock),
        {"imu.alive", "clock"},
    ),
    (
        (broken.degrees, broken.in_g, broken.stuck_force),
        {"joints.position", "joints.range", "imu.gravity", "right_ankle_ft.alive"},
    ),
    ((broken.tick_stands_still,), {f"{name}.tick" for name in broken.CHANNELS}),
    ((broken.stuck_imu,), {"imu.alive"}),
    ((broken.not_finite,), {"joints.format"}),
]
"""Pairs of faults on one robot that do not hide each other."""
GATE_FAULTS = [
    (broken.NoWatchdog, "reactions", {"watchdog.hold", "watchdog.fault"}),
    (broken.NoLease, "", {"lease.second", "lease.mode"}),
    (broken.AcceptsNan, "refusals", {"command.not_finite"}),
    (broken.AcceptsReplays, "refusals", {"command.sequence"}),
    (broken.IgnoresEstop, "reactions", {"estop.reaction"}),
]


def failures(
    endpoints: Endpoints,
    *sections: str,
    twists: tuple[broken.Twist, ...] = (),
    gate: type[CommandGate] = CommandGate,
    period_factor: int = 1,
) -> set[str]:
    """Return the names of the checks that fail on such a robot."""
    with running(broken.broken_robot, endpoints, twists, gate, period_factor):
        report = check_conformance(
            judged_walker(),
            endpoints=endpoints,
            sections=sections,
            timeout_s=PATIENCE_S,
        )
    assert report.passed is all(finding.passed for finding in report.findings)
    return {finding.name for finding in report.findings if not finding.passed}


def judged_robot(path: str, endpoints: Endpoints) -> PlantResult:
    table = {"name": "judged", "duration_s": 3600.0, "sensors": NOISE}
    return run_robot(
        load_robot(path),
        scenario_from_table(table, source="test"),
        seed=0,
        endpoints=endpoints,
        pace=Pace.REALTIME,
        wait_s=PATIENCE_S,
    )


def test_the_simulated_robot_passes_however_its_sensors_and_base_are_mounted(
    surefoot_here: Surefoot, endpoints: Endpoints, tmp_path: Path
) -> None:
    """The Walker itself: the example of a driver, test_driver.py."""
    turned = make_awkward(tmp_path, AWKWARD).robot
    path = str(patient_robot_file(tmp_path, turned.path, **JUDGED))
    with running(judged_robot, path, endpoints):
        words = ["--connect", *endpoints.connect, "--wait", PATIENCE_S]
        done = surefoot_here("check-robot", "--robot", path, *words, "--json")
    check_passes_but_for_time(done)


@pytest.mark.usual("twists0-expected0", "twists1-expected1", "twists3-expected3")
@pytest.mark.parametrize(("twists", "expected"), SENSOR_FAULTS)
def test_a_faulty_sensor_is_named(
    endpoints: Endpoints, twists: tuple[broken.Twist, ...], expected: set[str]
) -> None:
    found = failures(endpoints, "sensors", twists=twists)
    assert expected <= found


@pytest.mark.usual("AcceptsNan-refusals-expected2", "IgnoresEstop-reactions-expected4")
@pytest.mark.parametrize(("gate", "section", "expected"), GATE_FAULTS)
def test_a_faulty_gate_is_named(
    endpoints: Endpoints, gate: type[CommandGate], section: str, expected: set[str]
) -> None:
    assert expected <= failures(endpoints, section, gate=gate)


def test_half_the_rate_is_seen(endpoints: Endpoints) -> None:
    found = failures(endpoints, "sensors", period_factor=2)
    assert {"joints.rate", "imu.rate"} <= found


def test_wrong_wiring_is_seen(endpoints: Endpoints) -> None:
    found = failures(
        endpoints, "wiring", twists=(broken.feet_swapped, broken.joints_swapped)
    )
    wired = {name for name in found if not name.endswith(OF_THE_MACHINE)}
    assert wired == {"feet.order", "joints.order"}


def test_a_robot_that_took_us_for_late_is_not_judged_and_is_left_as_it_was(
    endpoints: Endpoints,
) -> None:
    found = failures(endpoints, "wiring", gate=broken.GivesUsUp)
    assert "commands.rate" in found
    assert all(name.endswith(OF_THE_MACHINE) for name in found)


def test_a_broken_robot_exits_with_1_and_names_the_line(
    surefoot_here: Surefoot, endpoints: Endpoints, tmp_path: Path
) -> None:
    with running(broken.broken_robot, endpoints, (broken.in_g,), CommandGate, 1):
        words = ["--connect", *endpoints.connect, "--wait", PATIENCE_S]
        words += ["--robot", patient_robot_file(tmp_path, **JUDGED)]
        done = surefoot_here("check-robot", *words, "--only", "sensors")
    assert done.returncode == 1
    failed = [line for line in done.stdout.splitlines() if "FAILED" in line]
    (line,) = (line for line in failed if not any(n in line for n in OF_THE_MACHINE))
    assert "imu.gravity" in line
    assert "in g?" in line
