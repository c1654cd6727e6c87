"""``surefoot margins`` and its errors."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from surefoot.cli.app import app
from surefoot.controllers import compute_margins, loop_delay_ms, loop_notice
from surefoot.robot_io.robot import find_robot, load_robot, make_robot
from surefoot.run_plan import make_plan
from surefoot.runs import simulate
from surefoot.schemas.scenario import Delay, Scenario
from surefoot.schemas.scenario_robot import SensorDelays

RUNNER = CliRunner()


def test_margins_are_one_json_object_for_scripts() -> None:
    answer = RUNNER.invoke(app, ["margins", "--servo-profile", "harmonic", "--json"])
    assert answer.exit_code == 0
    found = json.loads(answer.stdout)
    assert found["servo_profile"] == "harmonic"
    assert [axis["axis"] for axis in found["axes"]] == 2 * [
        *("x", "y", "z", "roll", "pitch", "yaw")
    ]


def test_a_delay_between_two_ticks_is_refused() -> None:
    answer = RUNNER.invoke(app, ["margins", "--delay", "1.5"])
    assert answer.exit_code != 0
    assert "whole number of ticks" in str(answer.exception)


def test_a_delay_may_be_written_as_ticks_are_printed() -> None:
    walker = load_robot("walker")
    file = msgspec.structs.replace(walker.file, rate_hz=333.0)
    robot = make_robot(file, path=walker.path, urdf_path=walker.urdf_path)
    found = compute_margins(robot, delay_ms=6.006)
    assert found.delay_ms == pytest.approx(2e3 / 333.0)


def test_what_all_sensors_are_late_by_together_is_the_loops() -> None:
    robot = load_robot("walker")
    apart = SensorDelays(imu=2.0, force_torque=4.0, joints=3.0)
    assert loop_delay_ms(Delay(command_ms=2.0, sensor_ms=apart), robot) == 4.0
    assert loop_delay_ms(Delay(sensor_ms=1.0, jitter_ms=3.0), robot) == 2.0
    assert loop_delay_ms(Delay(command_ms=0.0), robot) == 0.0


def test_a_loop_later_than_is_borne_is_told_with_what_to_set() -> None:
    late = Scenario(
        name="late", duration_s=1.0, delay=Delay(command_ms=3.0, sensor_ms=3.0)
    )
    said = loop_notice(make_plan(late))
    assert "6 ms late" in said
    assert "bears 3 ms" in said
    assert "dik.loop_delay_s=0.006" in said
    assert "gate" not in said
    assert not loop_notice(make_plan(late, settings={"dik.loop_delay_s": 0.006}))
    assert not loop_notice(make_plan(late, controller="zmp"))


def test_a_gate_that_would_end_the_run_is_told_whatever_the_gains(
    tmp_path: Path,
) -> None:
    late = Scenario(name="late", duration_s=1.0, delay=Delay(command_ms=4.0))
    told = {"dik.loop_delay_s": 0.004}
    for plan in (
        make_plan(late, settings=told),
        make_plan(late, controller="zmp"),
    ):
        said = loop_notice(plan)
        assert "sway" not in said
        assert "gate ends a run whose commands are over 3.5 ms late" in said
    assert "gate.max_loop_delay_s = 0.0045 does not" in said
    later = Scenario(name="late", duration_s=1.0, delay=Delay(command_ms=9.0))
    said = loop_notice(make_plan(later, settings={"dik.loop_delay_s": 0.009}))
    assert "max_loop_delay_s = 0.0095 and gate.max_command_age_s = 0.0095" in said
    file = find_robot("walker")
    text = file.read_text()
    text = text.replace("max_loop_delay_s = 0.0035", "max_loop_delay_s = 0.0045")
    (tmp_path / "walker.urdf").write_bytes((file.parent / "walker.urdf").read_bytes())
    (tmp_path / "patient.toml").write_text(text)
    robot = tmp_path / "patient.toml"
    assert not loop_notice(make_plan(late, robot=robot, settings=told))
    run = simulate(robot, late, settings=told, record=False)
    assert run.result.outcome == "stood"
