"""``surefoot margins`` and its errors."""

from __future__ import annotations

import json

from typer.testing import CliRunner

from surefoot.cli.app import app

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
