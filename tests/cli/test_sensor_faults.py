"""Sensor faults of a scenario act alike in one process and on the bus."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.command import Surefoot

SCENARIO = """
name = "fault"
duration_s = 0.8
[sensors]
force_noise_n = 2.0
gyro_noise_rad_s = 0.002
accel_noise_m_s2 = 0.05
[[fault]]
sensor = "{sensor}"
kind = "drop"
start_s = 0.4
duration_s = 10.0
"""


# A foot that goes on degraded is also run on the bus by the tests of playback.
@pytest.mark.usual("imu-sensor_lost-held-1")
@pytest.mark.parametrize(
    ("sensor", "end", "outcome", "code"),
    [
        ("left_ankle_ft", "run_over", "stood", 0),
        ("imu", "sensor_lost", "held", 1),
    ],
)
def test_a_silent_sensor_is_named_and_the_robot_stays_up(
    surefoot: Surefoot,
    tmp_path: Path,
    sensor: str,
    end: str,
    outcome: str,
    code: int,
) -> None:
    path = tmp_path / "fault.toml"
    path.write_text(SCENARIO.format(sensor=sensor))
    inline = surefoot("run", path, "--inline", "--json")
    bus = surefoot("run", path, "--json")
    assert inline.returncode == code, inline.stderr
    assert bus.returncode == code, bus.stderr
    one, two = json.loads(inline.stdout), json.loads(bus.stdout)
    for result in (one, two):
        assert not result["fell"]
        assert result["lost_sensors"] == {sensor: "missing"}
        assert (result["outcome"], result["end"]) == (outcome, end)
    assert two["degraded_ticks"] > 0
    assert one["log_sha256"] == two["log_sha256"]
