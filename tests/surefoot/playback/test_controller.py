"""Recorded sensors give the same commands again, bit for bit."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from tests.command import Surefoot, cut_short
from tests.once import short_run
from tests.patient_robot import GENTLE, patient_robot_file
from tests.surefoot.playback.conftest import (
    Check,
    record_of,
    standing,
)
from tests.surefoot.playback.records import rewritten
from tests.surefoot.recording.mcap_reading import messages
from tests.surefoot.report.runs import shared_runs

FAULTS = """
[[fault]]
sensor = "left_ankle_ft"
kind = "nan"
start_s = 0.4
duration_s = 0.1

[[fault]]
sensor = "right_ankle_ft"
kind = "drop"
start_s = 0.7
duration_s = 0.1
"""


HALF = ("--until", "0.5")
"""Compares the first half of the record, which is enough for what is in it."""
GOES = 3
"""A recorder on a busy machine may miss a message, and says so."""


def commands(path: Path) -> list[dict[str, Any]]:
    return [m.content for m in messages(path) if m.channel == "joint_command"]


def answered(path: Path, ticks: int) -> int:
    """Return the commands of a run in lockstep; the last one may be missing."""
    count = len(commands(path))
    assert ticks - 1 <= count <= ticks
    return count


@pytest.mark.parametrize(
    ("law", "ticks"), [("whole-body", 1000), ("zmp", 1500), ("hold", 300)]
)
def test_a_run_in_lockstep_is_equal_with_every_controller(
    record: Path,
    tmp_path_factory: pytest.TempPathFactory,
    check: Check,
    law: str,
    ticks: int,
) -> None:
    if law == "zmp":
        record = shared_runs(tmp_path_factory) / "zmp" / "run.mcap"
    elif law == "hold":
        record = short_run(tmp_path_factory) / "run.mcap"
    code, found = check(record)
    assert (code, found["is_equal"]) == (0, True)
    assert found["compared"] == answered(record, ticks)
    (session,) = found["sessions"]
    assert (session["controller"], session["first_tick"]) == (law, 0)
    assert (session["differing"], session["first"]) == (0, None)


def test_real_time_is_equal_with_the_ticks_that_were_answered(
    tmp_path: Path, check: Check
) -> None:
    robot = patient_robot_file(tmp_path, hold_after_s=30.0, lease_s=60.0)
    gentle = [word for each in GENTLE for word in ("--set", each)]
    words = ("--realtime", "--robot", robot, "--controller", "whole-body", *gentle)
    scenario = cut_short("moving-platform-fast", tmp_path, 1.5)
    for go in range(GOES):
        (folder := tmp_path / f"go{go}").mkdir()
        path = record_of(folder, scenario, *words)
        code, found = check(path)
        if not any("lack a sensor's message" in note for note in found["notes"]):
            break
    assert code == 0, found
    ticks = [command["tick"] for command in commands(path)]
    assert found["compared"] == len(ticks) > 0
    (session,) = found["sessions"]
    assert (session["first_tick"], session["last_tick"]) == (ticks[0], ticks[-1])


def test_a_sensor_message_that_the_record_lacks_is_named_as_a_doubt(
    record: Path, tmp_path: Path, check: Check
) -> None:
    def lose(channel: str, message: dict[str, Any]) -> dict[str, Any] | None:
        is_lost = channel == "imu" and message["tick"] == 400
        return None if is_lost else message

    code, found = check(rewritten(record, tmp_path / "lost.mcap", lose), *HALF)
    (session,) = found["sessions"]
    assert (code, session["stale"], session["first"]["tick"]) == (1, 1, 400)
    assert any("1 ticks lack a sensor's message" in note for note in found["notes"])


def test_sensors_that_fail_are_equal(tmp_path: Path, check: Check) -> None:
    """One whose messages hold no numbers, and one that falls silent."""
    path = record_of(tmp_path, standing(tmp_path, 0.9, FAULTS))
    said = [m.content for m in messages(path) if m.channel == "stabilizer"]
    reasons = {status["detail"] for status in said if status["state"] == "degraded"}
    assert reasons == {"left_ankle_ft missing", "right_ankle_ft missing"}
    code, found = check(path)
    assert (code, found["compared"]) == (0, answered(path, 900))


def test_another_gain_is_told_with_the_first_tick_it_shows_at(
    record: Path, surefoot_here: Surefoot, check: Check
) -> None:
    words = (record, "--set", "tsid.com_kp=31", *HALF)
    code, found = check(*words)
    assert (code, found["is_equal"]) == (1, False)
    (session,) = found["sessions"]
    first, largest = session["first"], session["largest"]
    # The robot is held while its sensors are calibrated: nothing shows before.
    assert 290 <= first["tick"] <= 320
    assert session["differing"] <= 500 - first["tick"]
    assert abs(largest["computed"] - largest["recorded"]) >= abs(
        first["computed"] - first["recorded"]
    )
    done = surefoot_here("replay", "--controller", *words)
    assert done.returncode == 1
    assert f"first: tick {first['tick']} " in done.stdout
    assert first["joint"] in done.stdout


def test_the_last_bit_of_one_joint_is_found(
    record: Path, tmp_path: Path, check: Check
) -> None:
    tick, joint = 400, 5
    before = commands(record)[tick]["q"][joint]

    def spoil(channel: str, message: dict[str, Any]) -> dict[str, Any]:
        if channel == "joint_command" and message["tick"] == tick:
            message["q"][joint] = math.nextafter(before, math.inf)
        return message

    code, found = check(rewritten(record, tmp_path / "spoilt.mcap", spoil), *HALF)
    (session,) = found["sessions"]
    assert (code, session["differing"]) == (1, 1)
    assert session["first"] == session["largest"]
    assert session["first"]["tick"] == tick
    assert session["first"]["computed"] == before
    assert session["first"]["recorded"] == math.nextafter(before, math.inf)


def test_a_record_that_is_cut_off_is_compared_as_far_as_it_goes(
    record: Path, tmp_path: Path, check: Check
) -> None:
    cut = tmp_path / "cut.mcap.partial"
    data = record.read_bytes()
    cut.write_bytes(data[: len(data) // 2])
    code, found = check(cut)
    assert code == 0, found
    assert found["is_cut_off"]
    assert 0 < found["compared"] < 1000
    assert any("ends in mid-run" in note for note in found["notes"])


def test_commands_that_the_record_lacks_end_the_comparison(
    record: Path, tmp_path: Path, check: Check
) -> None:
    def lose(channel: str, message: dict[str, Any]) -> dict[str, Any] | None:
        is_lost = channel == "joint_command" and message["tick"] in (400, 401)
        return None if is_lost else message

    code, found = check(rewritten(record, tmp_path / "lost.mcap", lose), *HALF)
    assert (code, found["compared"]) == (0, 400)
    assert any("2 commands" in note and "tick 399" in note for note in found["notes"])


def test_a_record_that_begins_late_says_what_it_lacks(
    record: Path, tmp_path: Path, surefoot_here: Surefoot
) -> None:
    def late(channel: str, message: dict[str, Any]) -> dict[str, Any] | None:
        return message if message["tick"] >= 500 else None

    path = rewritten(record, tmp_path / "late.mcap", late)
    done = surefoot_here("replay", "--controller", path)
    assert done.returncode == 2
    assert "commanded before the record begins (tick 500)" in done.stderr
    assert "Traceback" not in done.stderr


def test_until_compares_the_beginning(record: Path, check: Check) -> None:
    code, found = check(record, "--until", "0.35")
    assert (code, found["compared"]) == (0, 350)
    assert not any("mid-run" in note for note in found["notes"])


@pytest.mark.parametrize(
    "words",
    [
        ("nowhere.mcap", "--controller"),
        ("--controller", "--speed", "2"),
        ("--set", "tsid.com_kp=3"),
        ("--controller", "--set", "tsid.com_kb=3"),
    ],
)
def test_wrong_usage_is_code_2(
    record: Path, surefoot_here: Surefoot, words: tuple[str, ...]
) -> None:
    file = () if words[0].endswith(".mcap") else (record,)
    done = surefoot_here("replay", *file, *words)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
