"""``surefoot margins`` and its errors."""

from __future__ import annotations

import json

from typer.testing import CliRunner

from surefoot.cli.app import app
from surefoot.controllers import loop_notice
from surefoot.run_plan import make_plan
from surefoot.schemas.scenario import Delay, Scenario

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


def test_a_loop_later_than_is_borne_is_told_with_what_to_set() -> None:
    late = Scenario(
        name="late", duration_s=1.0, delay=Delay(command_ms=3.0, sensor_ms=3.0)
    )
    said = loop_notice(make_plan(late))
    assert "6 ms late" in said
    assert "bears 3 ms" in said
    assert "dik.loop_delay_s=0.006" in said
    assert not loop_notice(make_plan(late, settings={"dik.loop_delay_s": 0.006}))
    assert not loop_notice(make_plan(late, controller="zmp"))
