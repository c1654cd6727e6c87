"""A record of a minute at full rate lacks nothing, by an independent reader."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import pytest

from tests.command import run_surefoot
from tests.patient_robot import patient_robot_file
from tests.support import PATIENCE_S
from tests.surefoot.playback.conftest import standing
from tests.surefoot.recording.mcap_reading import channels, messages

MINUTE_TICKS = 60_000
SENSORS = ("joints", "imu", "left_ankle_ft", "right_ankle_ft")


@pytest.mark.slow
@pytest.mark.parametrize("pace", ["lockstep", "realtime"])
def test_a_minute_is_on_the_record_tick_by_tick(tmp_path: Path, pace: str) -> None:
    out = tmp_path / "run"
    words = (
        *("run", standing(tmp_path, 60.0), f"--{pace}", "--out", out, "--json"),
        *("--robot", patient_robot_file(tmp_path, hold_after_s=30.0, lease_s=60.0)),
    )
    done = run_surefoot(*words, patience_s=3.0 * PATIENCE_S)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["ticks"] == MINUTE_TICKS
    record = out / "run.mcap"
    ticks: dict[str, list[int]] = {}
    stamps: dict[str, list[int]] = {}
    sequences: list[int] = []
    for message in messages(record):
        ticks.setdefault(message.channel, []).append(message.content["tick"])
        stamps.setdefault(message.channel, []).append(message.log_time)
        if message.channel == "joint_command":
            sequences.append(message.content["sequence"])
    for name in SENSORS:
        assert ticks[name] == list(range(MINUTE_TICKS)), name
    # The robot may be gone before its last tick is answered.
    assert sequences == list(range(len(sequences)))
    if pace == "lockstep":
        assert len(sequences) >= MINUTE_TICKS - 1
    for name, times in stamps.items():
        assert all(earlier <= later for earlier, later in pairwise(times)), name
    for name, described in channels(record).items():
        assert described.encoding == "json", name
        assert described.schema["type"] == "object", name
        assert "$ref" not in json.dumps(described.schema), name
