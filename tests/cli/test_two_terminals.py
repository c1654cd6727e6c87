"""Robot and stabilizer started separately, as on two hosts."""

from __future__ import annotations

import signal
from pathlib import Path

import msgspec
import pytest

from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import EndReason, ModeCause
from surefoot.schemas.result import ControllerResult, PlantResult
from tests.cli.conftest import Start
from tests.command import scenario_file
from tests.nodes.test_nodes import is_running, observer
from tests.support import PATIENCE_S, free_port, wait_until


@pytest.mark.parametrize("pace", ["--lockstep", "--realtime"])
def test_both_sides_tell_their_part(
    start: Start,
    short_scenario: Path,
    patient_walker: Path,
    endpoint_file: Path,
    pace: str,
) -> None:
    words = [pace, "--json", "--robot", patient_walker, "--endpoints", endpoint_file]
    robot = start("robot", short_scenario, *words)
    stabilizer = start("stabilizer", "--controller", "hold", *words)
    plant = msgspec.json.decode(
        robot.communicate(timeout=PATIENCE_S)[0], type=PlantResult
    )
    controller = msgspec.json.decode(
        stabilizer.communicate(timeout=PATIENCE_S)[0], type=ControllerResult
    )
    assert (robot.returncode, stabilizer.returncode) == (0, 0)
    assert plant.ticks == 300
    assert not plant.fell
    assert plant.end is ModeCause.RUN_OVER
    assert controller.end is EndReason.RUN_OVER
    assert controller.end_detail == plant.end_detail == "0.3 s"
    if pace == "--lockstep":
        assert controller.ticks == plant.ticks
        assert plant.gate.mode is RobotMode.ACTIVE
        assert plant.deadline_misses == controller.stale_snapshots == 0
        assert plant.refused == plant.clipped == {}


def test_a_stabilizer_in_its_own_terminal_tells_of_a_lost_sensor(
    start: Start, endpoint_file: Path, tmp_path: Path
) -> None:
    meet = ("--endpoints", endpoint_file)
    fault = 'sensor = "left_ankle_ft"\nkind = "drop"\nstart_s = 0.1\nduration_s = 1\n'
    scenario = scenario_file(tmp_path, 0.3, more=f"[[fault]]\n{fault}")
    robot = start("robot", scenario, *meet)
    stabilizer = start("stabilizer", *meet)
    table = stabilizer.communicate(timeout=PATIENCE_S)[0]
    assert "stood 0.3 s" in robot.communicate(timeout=PATIENCE_S)[0]
    assert (robot.returncode, stabilizer.returncode) == (0, 0)
    log = (tmp_path / "stabilizer.log").read_text()
    assert "left_ankle_ft missing, not believed" in log
    assert "sensors lost" in table
    assert "run over" in table


def test_a_robot_nobody_came_for_ends_on_ctrl_c(start: Start, tmp_path: Path) -> None:
    locator = f"tcp/127.0.0.1:{free_port()}"
    robot = start("robot", "standing", "--listen", locator)
    log = tmp_path / "robot.log"
    wait_until(
        lambda: f"waits for a stabilizer at {locator}" in log.read_text(),
        what="the robot to wait",
    )
    robot.send_signal(signal.SIGINT)
    robot.communicate(timeout=PATIENCE_S)
    assert robot.returncode == 130
    assert "Traceback" not in log.read_text()


def test_ctrl_c_brings_the_robot_to_rest_and_gives_the_lease_back(
    start: Start, tmp_path: Path
) -> None:
    scenario = scenario_file(tmp_path, 3600.0)
    endpoints = Endpoints(
        listen=[locator := f"tcp/127.0.0.1:{free_port()}"], connect=[locator]
    )
    robot = start("robot", scenario, "--listen", locator)
    stabilizer = start("stabilizer", "--connect", locator, "--json")
    with observer(endpoints) as when:
        when(is_running, what="the run")
        stabilizer.send_signal(signal.SIGINT)
        stdout = stabilizer.communicate(timeout=PATIENCE_S)[0]
        held = when(lambda s: s.mode is RobotMode.HOLD, what="HOLD")
    assert stabilizer.returncode == 130
    result = msgspec.json.decode(stdout, type=ControllerResult)
    assert (result.end, result.end_detail) == (EndReason.STOPPED, "SIGINT")
    assert held.cause in (ModeCause.REQUESTED, ModeCause.RELEASED)
    assert "Traceback" not in (tmp_path / "stabilizer.log").read_text()
    robot.send_signal(signal.SIGINT)
    robot.communicate(timeout=PATIENCE_S)
    assert robot.returncode == 130
