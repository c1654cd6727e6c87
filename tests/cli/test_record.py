"""Records of real runs, read by an independent reader."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

from surefoot.errors import UsageError
from surefoot.recording.read import read_record
from surefoot.recording.write import McapFile
from surefoot.schemas.json_schema import json_schema
from surefoot.schemas.messages import JointState
from surefoot.schemas.topics import TICK_SENSORS
from tests.cli.conftest import Start
from tests.command import Surefoot, command, environment
from tests.once import short_run
from tests.support import PATIENCE_S, wait_until
from tests.surefoot.playback.conftest import standing
from tests.surefoot.recording.mcap_reading import (
    attached,
    channels,
    messages,
    metadata,
)

TICKS = 3_000
PROCESS = re.compile(r"recorder, process (\d+)")


def test_nothing_is_lost_in_seconds_faster_than_real_time(
    surefoot: Surefoot, tmp_path: Path
) -> None:
    words = ["run", standing(tmp_path, TICKS * 1e-3), "--controller", "hold", "--json"]
    done = surefoot(*words, "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["ticks"] == TICKS
    path = tmp_path / "run" / "run.mcap"
    received: dict[str, list[int]] = {}
    stamps: dict[str, list[int]] = {}
    sequences: list[int] = []
    for message in messages(path):
        received.setdefault(message.channel, []).append(message.content["tick"])
        stamps.setdefault(message.channel, []).append(message.log_time)
        if message.channel == "joint_command":
            sequences.append(message.content["sequence"])
    for name in (*TICK_SENSORS, "joint_command"):
        assert received[name] == list(range(TICKS)), name
    assert sequences == list(range(TICKS))
    for times in stamps.values():
        assert all(earlier <= later for earlier, later in pairwise(times))
    counts = {
        name: json.loads(text)
        for name, text in metadata(path)["surefoot/counts"].items()
    }
    assert all(
        counts[name]["messages"] == len(received.get(name, [])) for name in counts
    )
    assert [counts[name]["missing"] for name in TICK_SENSORS] == [0] * 4
    # The same run without bus and recorder gives the same log.
    bare = json.loads(surefoot(*words, "--inline").stdout)
    assert bare["log_sha256"] == result["log_sha256"]


def test_a_record_tells_all_a_run_depends_on(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    out = short_run(tmp_path_factory)
    files = attached(out / "run.mcap")
    for name in ("settings.toml", "scenario.toml", "run.json"):
        assert files[name] == (out / name).read_bytes()
    assert json.loads(files["run.json"])["seed"] == 5
    assert b"<robot" in files["robot.urdf"]
    assert json.loads(files["robot.json"])["servo"]["profile"]
    versions = json.loads(files["versions.json"])
    assert versions["packages"]["eclipse-zenoh"]
    described = channels(out / "run.mcap")
    for name, channel in described.items():
        assert channel.encoding == "json", name
        assert channel.schema["type"] == "object", name
        assert "$ref" not in json.dumps(channel.schema), name
    assert described["joints"].schema == json_schema(JointState)
    assert described["joints"].metadata["units"].startswith("SI")


def test_recording_apart_with_the_bytes_of_the_bus(
    start: Start, short_scenario: Path, endpoint_file: Path, tmp_path: Path
) -> None:
    meet = ("--endpoints", endpoint_file)
    out = tmp_path / "raw.mcap"
    partial = out.with_name("raw.mcap.partial")
    start("robot", short_scenario, *meet)
    words = ("--raw", "--json", *meet)
    recorder = start("record", "--out", out, *words)
    wait_until(partial.exists, what="the recorder to connect")
    stabilizer = start("stabilizer", "--controller", "hold", *meet)
    stdout, _ = recorder.communicate(timeout=PATIENCE_S)
    assert (stabilizer.wait(PATIENCE_S), recorder.returncode) == (0, 0)
    assert not partial.exists()
    told = {entry["channel"]: entry for entry in json.loads(stdout)}
    kept = [m for m in messages(out) if m.channel == "joints"]
    assert told["joints"]["messages"] == len(kept) == 300
    assert [msgspec.msgpack.decode(m.data)["tick"] for m in kept] == list(range(300))
    assert channels(out)["joints"].encoding == "msgpack"


def test_ctrl_c_leaves_a_whole_file(
    start: Start, short_scenario: Path, endpoint_file: Path, tmp_path: Path
) -> None:
    meet = ("--endpoints", endpoint_file)
    out, log = tmp_path / "part.mcap", tmp_path / "record.log"
    start("robot", short_scenario, *meet)
    recorder = start("record", "--out", out, *meet)
    # Said once the first status is there: from then on nothing is missed.
    wait_until(lambda: "ready" in log.read_text(), what="the recorder")
    recorder.send_signal(signal.SIGINT)
    recorder.communicate(timeout=PATIENCE_S)
    assert recorder.returncode == 130
    assert "Traceback" not in log.read_text()
    assert "status" in {m.channel for m in messages(out)}


def test_a_full_disk_ends_the_recording_with_one_message(
    start: Start, endpoint_file: Path, tmp_path: Path
) -> None:
    """The kernel's limit on file size stands in for a disk: the same write fails."""
    meet = ("--endpoints", endpoint_file)
    out = tmp_path / "full.mcap"
    robot = start("robot", standing(tmp_path, 1.0), *meet, "--json")
    words = " ".join(command("record", "--out", out, *meet))
    # Ignored, the signal of the limit becomes an error of the write.
    with subprocess.Popen(
        ["bash", "-c", f"trap '' XFSZ; ulimit -f 600; exec {words}"],
        env=environment(),
        text=True,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
    ) as recorder:
        partial = out.with_name("full.mcap.partial")
        wait_until(partial.exists, what="the recorder to connect")
        stabilizer = start("stabilizer", "--controller", "hold", *meet)
        _, stderr = recorder.communicate(timeout=PATIENCE_S)
    told, _ = robot.communicate(timeout=PATIENCE_S)
    assert recorder.returncode == 3, stderr
    assert f"cannot record to {out}" in stderr
    assert "Traceback" not in stderr
    assert not out.exists()
    assert (stabilizer.wait(PATIENCE_S), robot.returncode) == (0, 0)
    assert json.loads(told)["ticks"] == 1000


@pytest.mark.parametrize("name", ["a.bag", "nowhere/a.mcap"])
def test_a_name_that_cannot_be_is_a_usage_error(
    surefoot_here: Surefoot, name: str
) -> None:
    done = surefoot_here("record", "--out", name, "--connect", "tcp/127.0.0.1:1")
    assert done.returncode == 2
    assert name in done.stderr


def recorded(path: Path, *, overwrite: bool) -> McapFile:
    return McapFile(
        path,
        channels=["joints"],
        keys={"joints": "joints"},
        attachments=[],
        raw=False,
        overwrite=overwrite,
    )


@pytest.mark.parametrize("name", ["mine.mcap", "mine.mcap.partial"])
def test_only_a_record_is_replaced(tmp_path: Path, name: str) -> None:
    mine = tmp_path / name
    mine.write_text("my own notes")
    with pytest.raises(UsageError, match="no record of surefoot"):
        recorded(tmp_path / "mine.mcap", overwrite=True)
    assert mine.read_text() == "my own notes"


def test_what_is_no_file_is_refused_before_anything_is_recorded(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "folder")
    os.mkfifo(tmp_path / "pipe")
    before = sorted(tmp_path.iterdir())
    for name in ("folder", "link", "pipe"):
        with pytest.raises(UsageError, match="no file"):
            recorded(tmp_path / name, overwrite=True)
    assert sorted(tmp_path.iterdir()) == before


def test_a_file_that_came_meanwhile_is_left(tmp_path: Path) -> None:
    path = tmp_path / "mine.mcap"
    with (
        pytest.raises(OSError, match=r"meanwhile; what was written so far is in"),
        recorded(path, overwrite=False),
    ):
        path.write_text("my own notes")
    assert path.read_text() == "my own notes"
    assert not read_record(tmp_path / "mine.mcap.partial").is_cut_off
