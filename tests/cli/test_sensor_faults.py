"""Sensor faults of a scenario act alike in one process and on the bus."""

from __future__ import annotations

import json
from pathlib import Path

from tests.command import Surefoot

SCENARIO = """
name = "fault"
duration_s = 0.8
[sensors]
force_noise_n = 2.0
gyro_noise_rad_s = 0.002
accel_noise_m_s2 = 0.05
[[fault]]
sensor = "imu"
kind = "drop"
start_s = 0.4
duration_s = 10.0
"""


def test_a_silent_sensor_is_named_and_the_robot_stays_up(
    surefoot: Surefoot, tmp_path: Path
) -> None:
    """A foot that goes on degraded: test_two_terminals.py and the tests of playback."""
    path = tmp_path / "fault.toml"
    path.write_text(SCENARIO)
    inline = surefoot("run", path, "--inline", "--json")
    bus = surefoot("run", path, "--json")
    assert inline.returncode == 1, inline.stderr
    assert bus.returncode == 1, bus.stderr
    one, two = json.loads(inline.stdout), json.loads(bus.stdout)
    for result in (one, two):
        assert not result["fell"]
        assert result["lost_sensors"] == {"imu": "missing"}
        assert (result["outcome"], result["end"]) == ("held", "sensor_lost")
    assert two["degraded_ticks"] > 0
    assert one["log_sha256"] == two["log_sha256"]
