"""Sensor faults of a scenario take the same way in one process and on the bus."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.command import Surefoot

SCENARIO = """
name = "fault"
duration_s = 1.2
[sensors]
force_noise_n = 2.0
gyro_noise_rad_s = 0.002
accel_noise_m_s2 = 0.05
[[fault]]
sensor = "{sensor}"
kind = "drop"
start_s = 0.6
duration_s = 10.0
"""


@pytest.mark.parametrize(
    ("sensor", "reason"),
    [("left_ankle_ft", "left_ankle_ft missing"), ("imu", "held: imu missing")],
)
def test_a_silent_sensor_is_named_and_the_robot_stands(
    surefoot: Surefoot, tmp_path: Path, sensor: str, reason: str
) -> None:
    path = tmp_path / "fault.toml"
    path.write_text(SCENARIO.format(sensor=sensor))
    inline = surefoot("run", path, "--inline", "--json")
    bus = surefoot("run", path, "--json")
    assert inline.returncode == 0, inline.stderr
    assert bus.returncode == 0, bus.stderr
    one, two = json.loads(inline.stdout), json.loads(bus.stdout)
    assert one["reason"] == reason
    assert not one["fell"]
    assert not two["fell"]
    assert two["degraded_ticks"] > 0
    assert one["log_sha256"] == two["log_sha256"]
